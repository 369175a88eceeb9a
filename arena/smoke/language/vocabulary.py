"""Words of the scenario language with their meanings.

The grammar, the referee and docs/reference/scenarios.md use them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from arena.smoke.language.model import Verb
from arena.smoke.language.tokens import UNITS
from arena.wire.px4_mode import AUTO, MAIN

EACH = "each"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Quantity of a vehicle that a condition can compare with a limit, such as height.

    measures: kind of the quantity, such as "distance".  unit: unit in messages.  meaning: text for the reference page.
    """

    measures: str
    unit: str
    meaning: str

    @property
    def si(self) -> float:
        """Factor from `unit` to the SI unit, for example 0.001 for ms."""
        return UNITS[self.unit][1]


@dataclass(frozen=True, kw_only=True)
class Form:
    """Syntax of one action, such as `link delay T V`. T stands for a time and V for a vehicle.

    Users write the words in small letters unchanged. They replace the other words, which PARTS explains.

    verb: name of the action.  form: for example `kill P`.  meaning: text for the reference page.
    lasting: the action may end in `for T`; after that time it is undone.
    """

    verb: Verb
    form: str
    meaning: str
    lasting: bool = False


EXAMPLE = """\
name: offboard loss lands
about: The program of one vehicle is killed. This vehicle must land, and the other one must fly on.
arena: two_quads.yaml
steps:
  - at: uav1.airborne + 3 s
    do: kill program uav1
  - expect: uav1.mode == LAND within 2 s
  - expect: uav1.landed within 10 s
  - expect: not uav2.landed for 3 s
always:
  - separation > 0.8 m
  - inside geofence
  - tracking(uav2) < 0.15 m rms
"""
PHRASES: dict[str, str] = {
    "at: start": "at the first observation of the flight, when the arena is running",
    "at: then": "when the step before is done",
    "at: CONDITION": "when the condition last became true, also if that was before the step before was done",
    "+ T": "a delay, at the end of any entry `at`",
    "expect: CONDITION within T": "the condition must be true at one observation before the time is over",
    "expect: CONDITION for T": "the condition must be true at every observation until the time is over",
    "always: CONDITION": "the condition must be true for every vehicle in flight: from its first take-off until its landing",
}
STATES: dict[str, str] = {
    "airborne": "the lowest point of the vehicle is off the floor (truth)",
    "landed": "the vehicle has flown, is on the floor again (truth) and disarmed (telemetry)",
    "armed": "the vehicle is armed (telemetry)",
    "crashed": "the world reports a crash: the vehicle hit something, came down too fast or tilted too far",
}
QUANTITIES: dict[str, Quantity] = {
    "height": Quantity(
        measures="distance", unit="m", meaning="height of the lowest point above the floor (truth)"
    ),
    "speed": Quantity(measures="speed", unit="m/s", meaning="speed in any direction (truth)"),
    "tilt": Quantity(
        measures="angle", unit="deg", meaning="angle of the body z axis from the vertical (truth)"
    ),
    "estimate error": Quantity(
        measures="distance",
        unit="m",
        meaning="distance of the estimated position (telemetry, at its arrival) from the truth, also on the floor",
    ),
    "battery": Quantity(measures="share", unit="%", meaning="remaining charge (telemetry)"),
    "outside": Quantity(
        measures="distance", unit="m", meaning="distance outside the geofence; negative inside"
    ),
    "touchdown": Quantity(
        measures="speed",
        unit="m/s",
        meaning="speed at the last touchdown; unknown before the first touchdown",
    ),
    "drift": Quantity(
        measures="distance",
        unit="m",
        meaning="horizontal distance from the position at the last action; unknown before the first action",
    ),
}
REAL_TIME_FACTOR = "real time factor"
OTHER_CONDITIONS: dict[str, str] = {
    "V.mode == M": "flight mode (telemetry), with PX4's names; also `!=`, and `or` between several modes",
    "separation > X m": "smallest distance between two vehicles of which at least one is in flight (truth)",
    "tracking(V) < X m": "distance between position (truth) and position setpoint, in OFFBOARD and in the air. "
    "With `rms` at the end: root mean square over the whole flight, allowed only under `always`",
    "inside geofence": "every vehicle in flight is inside the geofence; without a geofence, inside the walls of the arena",
    'event "text"': "the arena logs an event that contains this text",
    "P is STATE": "a process is READY, EXITED, FATAL, ..., as in `arena ps`",
    "arena ended": "all processes of the arena have ended",
    f"{REAL_TIME_FACTOR} > X": "simulated seconds per second of wall time, over the whole flight; allowed only under "
    "`always`. Only this condition depends on the speed of the computer",
}
MODES: tuple[str, ...] = (*(m for m in MAIN.values() if m != "AUTO"), *AUTO.values(), "HOLD")
PROCESS_STATES = ("STOPPED", "STARTING", "READY", "BACKOFF", "STOPPING", "EXITED", "FATAL")
VEHICLE_PROCESSES: dict[str, str] = {
    "program": "program.{}",
    "forwarder": "forward.{}",
    "px4": "px4.{}",
    "link": "link.{}",
}
SINGLE_PROCESSES = ("router", "mocap", "world", "supervisor", "copilot", "recorder")
UNPLANNED_PROCESSES = ("supervisor",)
"""Processes of an arena that are not in its plan."""

PARTS: dict[str, str] = {
    "V": "a vehicle's name, or `each`",
    "W": "another vehicle's name",
    "P": "a process: "
    + ", ".join(f"`{p}`" for p in SINGLE_PROCESSES)
    + ", "
    + ", ".join(f"`{p} V`" for p in VEHICLE_PROCESSES)
    + ", `tool NAME`, or its name in the plan",
    "M": "a mode: "
    + ", ".join(f"`{m}`" for m in MODES)
    + "; with or without `AUTO.` in front. HOLD is the same as LOITER",
    "T": "a time with its unit, `s` or `ms`",
    "X": "a number with its unit",
    "N E D": "three numbers: north, east, down",
    "K": "number of a rotor, from 1",
}
ACTIONS: tuple[Form, ...] = (
    Form(verb="kill", form="kill P", meaning="send SIGKILL"),
    Form(
        verb="hang",
        form="hang P",
        meaning="send SIGSTOP, so that the process exists but does not run",
        lasting=True,
    ),
    Form(verb="resume", form="resume P", meaning="send SIGCONT"),
    Form(verb="restart", form="restart P", meaning="the same as `arena restart`"),
    Form(verb="mocap dropout", form="mocap dropout V", meaning="the rigid body is not tracked", lasting=True),
    Form(
        verb="mocap freeze",
        form="mocap freeze V",
        meaning="the last pose is sent again and again, marked as tracked",
        lasting=True,
    ),
    Form(
        verb="mocap jump",
        form="mocap jump V by N E D m",
        meaning="an offset is added to the poses of the rigid body",
        lasting=True,
    ),
    Form(
        verb="mocap swap",
        form="mocap swap V W",
        meaning="the poses of two rigid bodies are exchanged",
        lasting=True,
    ),
    Form(
        verb="mocap delay",
        form="mocap delay T",
        meaning="the poses of all rigid bodies are delayed",
        lasting=True,
    ),
    Form(
        verb="link loss",
        form="link loss X % V",
        meaning="this share of the datagrams between vehicle and router is lost",
        lasting=True,
    ),
    Form(
        verb="link delay",
        form="link delay T V",
        meaning="datagrams between vehicle and router are delayed in both directions",
        lasting=True,
    ),
    Form(
        verb="ground station loss",
        form="ground station loss",
        meaning="the ground station's heartbeat stops",
        lasting=True,
    ),
    Form(verb="rc loss", form="rc loss V", meaning="the pilot's RC transmitter is off", lasting=True),
    Form(
        verb="battery drain",
        form="drain battery V in T",
        meaning="the battery discharges so fast that a full battery is empty after T",
        lasting=True,
    ),
    Form(
        verb="motor loss",
        form="motor loss V [rotor K]",
        meaning="rotor K gives no thrust; without `rotor K`, rotor 1",
        lasting=True,
    ),
    Form(verb="wind", form="wind N E D m/s", meaning="steady wind in the whole room", lasting=True),
    Form(verb="mode", form="mode V M", meaning="request a flight mode, as a pilot would"),
    Form(verb="land all", form="land all", meaning="the same as `arena land-all`"),
    Form(verb="kill all", form="kill all", meaning="the same as `arena kill-all --yes`"),
    Form(verb="down", form="down", meaning="the same as `arena down`"),
)
IN_MS: tuple[Verb, ...] = ("mocap delay", "link delay")
"""Actions whose number is a time in ms."""
ALLOWANCES: dict[str, str] = {
    "crash V": "the vehicle may crash",
    "fail P": "the process may end with an error, or become FATAL",
    "stay up": "vehicles may still be in the air at the end",
}
OLD_WORDS: dict[str, str] = {"told": "event"}
"""Words of older scenario files that are still accepted -> words that replace them."""

if {form.verb for form in ACTIONS} != set(get_args(Verb)):
    raise ValueError(
        "the table ACTIONS must have exactly one Form (syntax) for each Verb of a scenario action"
    )
