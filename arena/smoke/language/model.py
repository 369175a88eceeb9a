"""What a scenario says and what a referee sees, as data: known to both halves of this room, those who judge and those who fly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Vector = tuple[float, float, float]


# -- what a referee sees ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class VehicleNow:
    """One vehicle at one instant. Truth: p_n of its origin [m] [NED], v_n [m/s] [NED], tilt of its z axis [rad], height of its
    lowest point above the floor [m], airborne by that height. Its own words: mode as PX4 says it ("" unknown), armed and landed
    (None unknown), estimate est_p_n and setpoint target_p_n [m] [NED], battery 0..1, None where not heard in the last second of
    simulation time; one that is not heard and whose rotors stand still is not armed. crashed: the world's verdict, "" for none.
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
        """On the floor, and disarmed by its own word."""
        return not self.airborne and self.armed is False


@dataclass(frozen=True, kw_only=True)
class Now:
    """One look, at simulation time time_s [s]. processes: name -> READY, EXITED, ... as in `arena ps`; events: lines that the
    arena has told since the last look.
    """

    time_s: float
    vehicles: Mapping[str, VehicleNow]
    processes: Mapping[str, str] = field(default_factory=dict)
    events: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Box:
    """Where vehicles may be: lowest and highest north, east, down [m] [NED]."""

    low_n: Vector
    high_n: Vector

    def outside_m(self, p_n: Vector) -> float:
        """How far p_n is outside [m]; negative inside: the distance to the nearest side."""
        return max(max(low - p, p - high) for low, p, high in zip(self.low_n, p_n, self.high_n, strict=True))


# -- what a scenario says -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where it was written."""

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
class Deed:
    """One `do`. processes: plan names, or "supervisor"; vehicles: names, in order; number: in the unit of the verb (share 0..1 of
    link loss, ms of a delay, s until empty, rotor from 1); by: metres of a jump or m/s of the wind [NED]; word: a mode.
    for_s: taken back after so long [s], None: it stays. undo: this is the taking back of the same deed.
    """

    verb: Verb
    place: Place
    processes: tuple[str, ...] = ()
    vehicles: tuple[str, ...] = ()
    number: float = 0.0
    by: Vector = (0.0, 0.0, 0.0)
    word: str = ""
    for_s: float | None = None
    undo: bool = False


Sign = Literal["", "<", ">", "==", "!="]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What may hold or not at an instant. of: airborne, landed, mode, height, separation, ... as in the tables of `grammar`.

    vehicles: of whom; for all of them it must hold. value: in SI (rad, m, m/s, 0..1). words: modes, a state of a process, or
    what was told. processes: plan names. negated: `not`. rms: over the flight in OFFBOARD.
    """

    place: Place
    of: str
    vehicles: tuple[str, ...] = ()
    processes: tuple[str, ...] = ()
    sign: Sign = ""
    value: float = 0.0
    words: tuple[str, ...] = ()
    negated: bool = False
    rms: bool = False


@dataclass(frozen=True, kw_only=True)
class Moment:
    """condition: when it becomes true; None with `then`: after the step before, else the start. after_s: so much later [s]."""

    place: Place
    condition: Condition | None = None
    then: bool = False
    after_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """within_s: it must hold by then at one look; for_s: it must hold at every look until then. One of the two is given."""

    place: Place
    condition: Condition
    within_s: float | None = None
    for_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Step:
    """One entry of `steps`. moment: None: at once, when the step before is done."""

    place: Place
    moment: Moment | None = None
    do: tuple[Deed, ...] = ()
    expect: tuple[Expectation, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rule:
    place: Place
    condition: Condition


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """What is not counted as a failure: crashes of, failures of, and not having landed at the end."""

    crash: frozenset[str] = field(default_factory=frozenset)
    fail: frozenset[str] = field(default_factory=frozenset)
    stay_up: bool = False
