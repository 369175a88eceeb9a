"""What a line of a scenario means: text -> moments, conditions, deeds and rules. Every word and operator is in a table here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.words import Deed, Place

Sign = Literal["", "<", ">", "==", "!="]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What may hold or not at an instant. of: airborne, landed, mode, height, separation, ... as in the tables below.

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
