"""The words of scenarios, in tables that the grammar, the referee and the reference page share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from arena.smoke.language.model import Verb
from arena.smoke.language.tokens import UNITS
from arena.wire.px4_mode import AUTO, MAIN

EACH = "each"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Of one vehicle. measures: a kind of unit; unit: the one that people are shown."""

    measures: str
    unit: str
    meaning: str

    @property
    def si(self) -> float:
        """How much of the SI unit one of `unit` is."""
        return UNITS[self.unit][1]


@dataclass(frozen=True, kw_only=True)
class Form:
    """How one deed is written. Words in small letters are themselves, the others stand for something: see PARTS.

    lasting: whether it may end in `for T s`.
    """

    verb: Verb
    form: str
    meaning: str
    lasting: bool = False


EXAMPLE = """\
name: offboard loss lands
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
    "at: start": "the first look at the flight, when the arena is up",
    "at: then": "when the step before is done",
    "at: CONDITION": "when it became true last, though that was before it is this step's turn",
    "+ T": "after any of these: so much later",
    "expect: CONDITION within T": "it holds at one look by then at the latest",
    "expect: CONDITION for T": "it holds at every look until then",
    "always: CONDITION": "it holds for whoever is in flight: from its first take-off until its landing",
}
STATES: dict[str, str] = {
    "airborne": "its lowest point is off the floor (truth)",
    "landed": "it has flown, is on the floor again (truth) and disarmed (its own word)",
    "armed": "by its own word",
    "crashed": "by the world's verdict: hit something, came down too hard or tilted too far",
}
QUANTITIES: dict[str, Quantity] = {
    "height": Quantity(measures="distance", unit="m", meaning="of its lowest point above the floor (truth)"),
    "speed": Quantity(measures="speed", unit="m/s", meaning="in any direction (truth)"),
    "tilt": Quantity(measures="angle", unit="deg", meaning="of its axis from the vertical (truth)"),
    "estimate error": Quantity(
        measures="distance", unit="m", meaning="from its own estimate of its position to the truth"
    ),
    "battery": Quantity(measures="share", unit="%", meaning="charge that is left, by its own word"),
    "outside": Quantity(
        measures="distance", unit="m", meaning="how far it is outside the geofence; negative inside"
    ),
    "touchdown": Quantity(
        measures="speed", unit="m/s", meaning="its speed when it touched the floor last; unknown before"
    ),
    "drift": Quantity(
        measures="distance",
        unit="m",
        meaning="sideways from where it was at the last deed; unknown before one",
    ),
}
OTHERS: dict[str, str] = {
    "V.mode == M": "its mode by its own word, as PX4 names it; also `!=`, and `or` between several modes",
    "separation > X m": "between the two nearest vehicles, of which one is in flight at least",
    "tracking(V) < X m": "distance of its position from its setpoint (truth) while in OFFBOARD and in the air; "
    "`rms` at the end: over the whole flight, in a rule alone",
    "inside geofence": "each vehicle in flight; where the arena draws no geofence, the walls of the room",
    'told "words"': "the arena has told an event that holds these words",
    "P is STATE": "a process is READY, EXITED, FATAL, ..., as in `arena ps`",
    "arena ended": "its processes are gone",
}
MODES: tuple[str, ...] = (*(m for m in MAIN.values() if m != "AUTO"), *AUTO.values(), "HOLD")
PROCESS_STATES = ("STOPPED", "STARTING", "READY", "BACKOFF", "STOPPING", "EXITED", "FATAL")
OF_VEHICLES: dict[str, str] = {
    "program": "program.{}",
    "forwarder": "forward.{}",
    "logger": "logger.{}",
    "px4": "px4.{}",
    "link": "link.{}",
}
ALONE = ("router", "mocap", "world", "supervisor", "copilot")
UNPLANNED = ("supervisor",)
"""Processes that are there without being in the plan."""

PARTS: dict[str, str] = {
    "V": "a vehicle's name, or `each`",
    "W": "another vehicle's name",
    "P": "a process: "
    + ", ".join(f"`{p}`" for p in ALONE)
    + ", "
    + ", ".join(f"`{p} V`" for p in OF_VEHICLES)
    + ", `tool NAME`, or its name in the plan",
    "M": "a mode: "
    + ", ".join(f"`{m}`" for m in MODES)
    + "; with `AUTO.` before it or without; HOLD is LOITER",
    "T": "a time with its unit, `s` or `ms`",
    "X": "a number with its unit",
    "N E D": "three numbers: north, east, down",
    "K": "a rotor, from 1",
}
DEEDS: tuple[Form, ...] = (
    Form(verb="kill", form="kill P", meaning="SIGKILL"),
    Form(verb="hang", form="hang P", meaning="SIGSTOP: it is there and does nothing", lasting=True),
    Form(verb="resume", form="resume P", meaning="SIGCONT"),
    Form(verb="restart", form="restart P", meaning="as `arena restart` does"),
    Form(verb="mocap dropout", form="mocap dropout V", meaning="its body is not tracked", lasting=True),
    Form(
        verb="mocap freeze",
        form="mocap freeze V",
        meaning="its last pose again and again, as if tracked",
        lasting=True,
    ),
    Form(
        verb="mocap jump",
        form="mocap jump V by N E D m",
        meaning="its poses are off by so much",
        lasting=True,
    ),
    Form(verb="mocap swap", form="mocap swap V W", meaning="each gets the other's pose", lasting=True),
    Form(verb="mocap delay", form="mocap delay T", meaning="poses of all come so much later", lasting=True),
    Form(
        verb="link loss",
        form="link loss X % V",
        meaning="share of the datagrams between it and the router",
        lasting=True,
    ),
    Form(
        verb="link delay", form="link delay T V", meaning="each way, between it and the router", lasting=True
    ),
    Form(verb="ground station loss", form="ground station loss", meaning="its heartbeat stops", lasting=True),
    Form(verb="rc loss", form="rc loss V", meaning="the pilot's radio is off", lasting=True),
    Form(
        verb="battery drain",
        form="drain battery V in T",
        meaning="at a pace that empties a full one in T",
        lasting=True,
    ),
    Form(
        verb="motor loss",
        form="motor loss V [rotor K]",
        meaning="this rotor, else the first, gives no thrust",
        lasting=True,
    ),
    Form(verb="wind", form="wind N E D m/s", meaning="steady, in the whole room", lasting=True),
    Form(verb="mode", form="mode V M", meaning="asks for a mode as a pilot would"),
    Form(verb="land all", form="land all", meaning="as `arena land-all`"),
    Form(verb="kill all", form="kill all", meaning="as `arena kill-all --yes`"),
    Form(verb="down", form="down", meaning="as `arena down`"),
)
IN_MS: tuple[Verb, ...] = ("mocap delay", "link delay")
"""Deeds whose number is in ms."""
MAY: dict[str, str] = {
    "crash V": "it may crash",
    "fail P": "this process may end with an error, or for good",
    "stay up": "vehicles need not have landed at the end",
}

if {form.verb for form in DEEDS} != set(get_args(Verb)):
    raise ValueError("a verb without a form")
