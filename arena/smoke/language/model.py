"""Dataclasses of a scenario's content and of the observations of a flight.

`language`, `referee` and `flying` share them.

This module must not import these packages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

Vector = tuple[float, float, float]


# -- observations of a flight


@dataclass(frozen=True, kw_only=True)
class VehicleState:
    """State of one vehicle at one instant.

    From the ground truth of the world:
    p_n: position of the body origin [m] [NED].  v_n: velocity [m/s] [NED].
    tilt_rad: angle between the body z axis and the vertical [rad].
    height_m: height of the lowest point above the floor [m].  airborne: `height_m` shows that the vehicle is off the floor.
    crashed: crash report of the world, "" if not crashed.

    From the telemetry of the vehicle, if not older than 1 s of simulation time:
    mode: PX4's name of the flight mode, "" if unknown.
    armed: None if unknown; false without telemetry if the rotors stand still.  landed: None if unknown.
    est_p_n: estimated position [m] [NED].  target_p_n: position setpoint [m] [NED].  battery: remaining charge, 0..1.
    """

    name: str
    p_n: Vector
    v_n: Vector
    tilt_rad: float
    height_m: float
    airborne: bool
    mode: str = ""
    armed: bool | None = None
    landed: bool | None = None
    est_p_n: Vector | None = None
    target_p_n: Vector | None = None
    battery: float | None = None
    crashed: str = ""

    @property
    def down(self) -> bool:
        """True if the vehicle is on the floor and disarmed."""
        return not self.airborne and self.armed is False


@dataclass(frozen=True, kw_only=True)
class Observation:
    """State of a flight at one instant.

    time_s: simulation time [s].
    vehicles: name -> state of the vehicle.
    processes: name -> state of the process: READY, EXITED, ..., as in `arena ps`.
    events: events that the arena logged since the observation before.
    wall_s: wall time [s], for the real-time factor; None if not measured.
    """

    time_s: float
    vehicles: Mapping[str, VehicleState]
    processes: Mapping[str, str] = field(default_factory=dict)
    events: tuple[str, ...] = ()
    wall_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Box:
    """Box that vehicles must not leave: the geofence, or the room.

    low_n, high_n: lowest and highest north, east, down [m] [NED].
    """

    low_n: Vector
    high_n: Vector

    def outside_m(self, p_n: Vector) -> float:
        """Return the distance of `p_n` from the box [m]. Inside the box, it is minus the distance to the nearest side."""
        return max(max(low - p, p - high) for low, p, high in zip(self.low_n, p_n, self.high_n, strict=True))


# -- content of a scenario


@dataclass(frozen=True, kw_only=True)
class Place:
    """File and line of an entry in a scenario file, with its text.

    text: the entry as written.
    """

    file: str
    line: int
    text: str


Verb = Literal[
    "kill",
    "hang",
    "resume",
    "restart",  # processes
    "mocap dropout",
    "mocap freeze",
    "mocap jump",
    "mocap swap",
    "mocap delay",
    "link loss",
    "link delay",
    "ground station loss",
    "rc loss",
    "battery drain",
    "motor loss",
    "wind",
    "land all",
    "kill all",
    "down",
    "mode",
]


@dataclass(frozen=True, kw_only=True)
class Action:
    """Action on the arena during a flight, such as a fault. It comes from an entry `do`.

    processes: affected processes, by their names in the plan, or "supervisor".
    vehicles: affected vehicles, in the order of the text.
    number: depends on the verb: fraction of lost datagrams 0..1, delay [ms], time until empty [s], rotor number from 1.
    by: offset of a jump [m] [NED], or wind [m/s] [NED] (3,).
    mode: flight mode; "" for other verbs.
    for_s: time after which the action is undone [s]; None if it is not undone.
    undo: true if this object means to undo the action.
    """

    verb: Verb
    place: Place
    processes: tuple[str, ...] = ()
    vehicles: tuple[str, ...] = ()
    number: float = 0.0
    by: Vector = (0.0, 0.0, 0.0)
    mode: str = ""
    for_s: float | None = None
    undo: bool = False


Operator = Literal["", "<", ">", "==", "!="]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Statement about the flight that is true or false at each instant.

    kind: airborne, mode, height, separation, ...: a key of the tables in `vocabulary`.
    vehicles: vehicles for all of which the statement must be true.
    processes: names in the plan of processes for all of which the statement must be true.
    operator, value: comparison with a value in SI units (rad, m, m/s, 0..1).
    texts: flight modes, a process state, or the text of an event.
    negated: true if written with `not`.
    rms: true if the value is the root mean square over the flight in OFFBOARD.
    """

    place: Place
    kind: str
    vehicles: tuple[str, ...] = ()
    processes: tuple[str, ...] = ()
    operator: Operator = ""
    value: float = 0.0
    texts: tuple[str, ...] = ()
    negated: bool = False
    rms: bool = False


@dataclass(frozen=True, kw_only=True)
class Trigger:
    """Time at which a step begins, from an entry `at`.

    condition: the step begins when this condition becomes true; None for `start` and `then`.
    then: the step begins when the step before is done. Without condition and `then`, it begins at the start of the flight.
    after_s: delay added to that time [s].
    """

    place: Place
    condition: Condition | None = None
    then: bool = False
    after_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Expectation of a scenario (entry `expect`): a condition, and the time in which it must become or stay true.

    One of its two times is set, the second time is None.

    within_s: the condition must be true at least once within this time [s].
    for_s: the condition must be true at every observation during this time [s].
    """

    place: Place
    condition: Condition
    within_s: float | None = None
    for_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Step:
    """Step of a scenario, from an entry of `steps`.

    trigger: None if the step begins as soon as the step before is done.
    """

    place: Place
    trigger: Trigger | None = None
    do: tuple[Action, ...] = ()
    expect: tuple[Expectation, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A condition that must hold during the whole flight, from an entry of `always`."""

    place: Place
    condition: Condition


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """The failures that a scenario accepts, from its entries `may`.

    crash: vehicles that may crash.  fail: processes that may fail.  stay_up: vehicles may be in the air at the end.
    """

    crash: frozenset[str] = field(default_factory=frozenset)
    fail: frozenset[str] = field(default_factory=frozenset)
    stay_up: bool = False


def named_processes(steps: Iterable[Step], always: Iterable[Rule]) -> frozenset[str]:
    """Return the names of the processes that the actions and conditions of a scenario name.

    steps, always: entries of the scenario with these names.
    """
    found: set[str] = set()
    for step in steps:
        for action in step.do:
            found.update(action.processes)
        for expectation in step.expect:
            found.update(expectation.condition.processes)
        if step.trigger is not None and step.trigger.condition is not None:
            found.update(step.trigger.condition.processes)
    for rule in always:
        found.update(rule.condition.processes)
    return frozenset(found)
