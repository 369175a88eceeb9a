"""The data of the scenario language and of the referee: what a scenario asks for, and what is observed of a
flight.

The inner rooms `language`, `referee` and `flying` share it. It must not import any of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Vector = tuple[float, float, float]


# -- what is observed of a flight


@dataclass(frozen=True, kw_only=True)
class VehicleState:
    """A vehicle at one instant.

    From the truth: p_n: position of the body origin [m] [NED]; v_n: velocity [m/s] [NED]; tilt_rad: angle of
        the body z axis from the vertical [rad]; height_m: lowest point above the floor [m]; airborne: off the
        floor, by that height.
    From its telemetry: mode: PX4's name, "" if unknown; armed, landed: None if unknown; est_p_n: estimated
        position; target_p_n: position setpoint [m] [NED]; battery: 0..1. Telemetry older than 1 s of
        simulation time is unknown. A silent vehicle whose rotors stand still is not armed.
    crashed: the world's crash report, "" for none.
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
        """True when the vehicle is on the floor and disarmed."""
        return not self.airborne and self.armed is False


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The state of the flight at one instant.

    time_s: simulation time [s].
    processes: name -> READY, EXITED, ... as in `arena ps`.
    events: lines that the arena logged since the last observation.
    wall_s: wall time [s], for the real-time factor; None if not measured.
    """

    time_s: float
    vehicles: Mapping[str, VehicleState]
    processes: Mapping[str, str] = field(default_factory=dict)
    events: tuple[str, ...] = ()
    wall_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Box:
    """The volume that vehicles may use: lowest and highest north, east, down [m] [NED]."""

    low_n: Vector
    high_n: Vector

    def outside_m(self, p_n: Vector) -> float:
        """Return how far p_n is outside [m]; inside, minus the distance to the nearest side."""
        return max(max(low - p, p - high) for low, p, high in zip(self.low_n, p_n, self.high_n, strict=True))


# -- what a scenario asks for


@dataclass(frozen=True, kw_only=True)
class Place:
    """The line of a scenario file that an entry was written on."""

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
    """An entry of `do`.

    processes: plan names, or "supervisor".
    vehicles: names, in the order of the text.
    number: in the unit of the verb: lost share 0..1, delay [ms], time until empty [s], rotor from 1.
    by: offset of a jump [m] or wind [m/s] [NED] (3,).
    mode: a flight mode, "" for other verbs.
    for_s: undone after this time [s]; None: it stays.
    undo: True for the action that takes this one back.
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
    """A statement that holds or does not hold at an instant.

    kind: airborne, mode, height, separation, ...: a key of the tables in `vocabulary`.
    vehicles: it must hold for all of them.
    processes: plan names.
    operator, value: a comparison, in SI units (rad, m, m/s, 0..1).
    texts: flight modes, a process state, or the text of an event.
    negated: written with `not`.
    rms: root mean square over the flight in OFFBOARD.
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
    """The time at which a step begins: the entry `at`.

    condition: the step begins when it becomes true. Without a condition, the step begins at the start of the
        flight, or with `then` after the step before.
    after_s: delay added to that time [s].
    """

    place: Place
    condition: Condition | None = None
    then: bool = False
    after_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """An entry of `expect`: a condition with exactly one of two times.

    within_s: the condition must hold at one observation until then [s].
    for_s: the condition must hold at every observation until then [s].
    """

    place: Place
    condition: Condition
    within_s: float | None = None
    for_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Step:
    """An entry of `steps`. trigger: None: at once, when the step before is done."""

    place: Place
    trigger: Trigger | None = None
    do: tuple[Action, ...] = ()
    expect: tuple[Expectation, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rule:
    """An entry of `always`."""

    place: Place
    condition: Condition


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """Failures that a scenario accepts: crashes of these vehicles, failures of these processes, vehicles in
    the air at the end.
    """

    crash: frozenset[str] = field(default_factory=frozenset)
    fail: frozenset[str] = field(default_factory=frozenset)
    stay_up: bool = False
