"""What a finding is, what is looked at for one, and what the table of parameters alone can tell: names, types, ranges. Pure."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

from arena.constants import INT32_MAX, INT32_MIN
from arena.params.facts.changes import CHANGES, Change
from arena.params.facts.parameter_table import Parameter, Type, Version, parameters, versions
from arena.params.facts.renames import carry, changes

Severity = Literal["error", "warning", "note"]


class Finding(NamedTuple):
    """error: it will not fly here, or a failsafe does not do what it is there for.  warning: it flies worse, or lands worse,
    than it need.  note: to know.

    value: None where the vehicle does not have the parameter.  what: is wrong.  why: it matters.  fix: what to do.
    """

    severity: Severity
    name: str
    value: float | None
    what: str
    why: str
    fix: str


@dataclass(frozen=True, kw_only=True)
class Room:
    """What the arena has. latency_ms: from exposure to the pose's arrival at the autopilot.  height_m: of the room."""

    vision: bool = True
    gps: bool = False
    sticks: bool = False
    latency_ms: float | None = None
    height_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Look:
    """A vehicle's values, beside what PX4 of its version has where they say nothing."""

    given: Mapping[str, float]
    version: Version
    room: Room
    types: Mapping[str, Type] = field(default_factory=dict)

    @cached_property
    def facts(self) -> Mapping[str, Parameter]:
        return parameters(self.version)

    @cached_property
    def all(self) -> Mapping[str, float]:
        """What is not given is taken to be the version's default."""
        return {**{name: p.default for name, p in self.facts.items()}, **self.given}

    @property
    def minor(self) -> int:
        return self.version.minor

    def value(self, name: str) -> float | None:
        """None where the version has no such parameter."""
        return self.all.get(name) if name in self.facts else None

    def default(self, name: str) -> float | None:
        return self.facts[name].default if name in self.facts else None

    def bits(self, name: str) -> int:
        """Of a mask; 0 where it is none."""
        value = self.value(name)
        return int(value) if value is not None and math.isfinite(value) else 0

    def finding(self, severity: Severity, name: str, what: str, why: str, fix: str, *because: str) -> Finding:
        """because: other names that it rests on. What rests on defaults alone is a note: the vehicle may hold something else."""
        if name in self.given or any(other in self.given for other in because):
            return Finding(severity, name, self.all.get(name), what, why, fix)
        what = f"{what} (it is not given; this is the default of PX4 {self.version})"
        return Finding("note", name, self.all.get(name), what, why, fix)


Rule = Callable[[Look], Iterator[Finding]]


def unknown_names(look: Look) -> Iterator[Finding]:
    """Renamed and removed ones with their successor, later ones with their forerunner, and what no version knows."""
    for name, value in look.given.items():
        change = _change(name, look)
        if change is not None and value != look.default(name):
            yield _replaced(name, value, change, look)
        elif change is None and name not in look.facts:
            yield _foreign(name, value, look)


def _change(name: str, look: Look) -> Change | None:
    """By which `look.version` does not use the name as before any more."""
    done = [c for c in CHANGES if c.old == name and c.at <= look.minor and name not in c.new]
    return done[-1] if done and (done[-1].lingers or name not in look.facts) else None


def _replaced(name: str, value: float, change: Change, look: Look) -> Finding:
    before = Version(1, change.at - 1)
    given = carry({name: value}, before, look.version).values if math.isfinite(value) else {}
    what = f"{'is not used as before since' if name in look.facts else 'went with'} PX4 1.{change.at}"
    if given:
        held = [n for n in given if n in look.given]
        says = f"; it holds {', '.join(held)} already" if held else ""
        old = look.default(name)  # where it lingers
        rest = "" if old is None else f", and leave {name} at its default {old:g}"
        fix = f"set {_listed(given)} in its place{says}{rest}"
        return Finding("warning" if held else "error", name, value, what, change.why, fix)
    if change.new:
        return Finding("error", name, value, what, change.why, f"choose {' and '.join(change.new)} anew")
    return Finding("warning", name, value, what, change.why, "leave it out")


def _foreign(name: str, value: float, look: Look) -> Finding:
    later = [v for v in versions() if name in parameters(v) and v.minor > look.minor]
    earlier = [v for v in versions() if name in parameters(v) and v.minor < look.minor]
    if later:
        first = later[0]
        old = [c.old for c in changes(look.version, first) if name in c.new and c.old != name]
        fix = (
            f"{look.version} has {' and '.join(dict.fromkeys(old))} for it"
            if old
            else f"leave it out, or fly {first} or newer"
        )
        return Finding(
            "error", name, value, f"came with PX4 {first}", f"PX4 {look.version} does not know it", fix
        )
    if earlier:
        last = earlier[-1]
        why = f"PX4 {look.version} does not know it, and no successor of it is known here"
        return Finding("warning", name, value, f"was last in PX4 {last}", why, "leave it out")
    what = f"no version of PX4 from {versions()[0]} to {versions()[-1]} has such a name"
    why = f"PX4 {look.version} does not know it: it would be loaded without effect, or refused"
    meant = _close(name, look)
    if meant:
        return Finding("error", name, value, what, why, f"perhaps {meant} is meant")
    return Finding("warning", name, value, what, why, "leave it out, unless it is of a module of your own")


def _close(name: str, look: Look) -> str:
    """The nearest name of this version, else of any; "" when none is near."""
    every = {known for version in versions() for known in parameters(version)}
    for names in (look.facts.keys(), every):
        if found := difflib.get_close_matches(name.upper(), names, n=1, cutoff=0.85):
            return found[0]
    return ""


def types_and_ranges(look: Look) -> Iterator[Finding]:
    """Numbers that the parameter's type cannot hold, a type that is another's, and what lies outside PX4's own limits."""
    for name, value in look.given.items():
        p = look.facts.get(name)
        if p is None:
            continue
        fault = _type_fault(value, p)
        if fault:
            yield Finding(
                "error", name, value, *fault, f"set a number of its type, such as its default {p.default:g}"
            )
        elif look.types.get(name, p.type) != p.type:
            yield Finding(
                "error",
                name,
                value,
                f"is written as {look.types[name]}, and is {p.type}",
                "the bytes of the one are not those of the other",
                f"give it the type {_KIND[p.type]}",
            )
        elif not _within(value, p) and not _named_elsewhere(name):
            past = [c.why for c in CHANGES if c.old == name and name in c.new and c.at <= look.minor]
            yield Finding(
                "warning",
                name,
                value,
                f"lies outside {_limits(p)}",
                past[-1] if past else "PX4 does not refuse it, and was not made for it",
                f"set it within {_limits(p)}; its default is {p.default:g}",
            )


_KIND = {"INT32": "6 (INT32)", "FLOAT": "9 (FLOAT)"}


def _type_fault(value: float, p: Parameter) -> tuple[str, str] | None:
    if not math.isfinite(value):
        return "is no finite number", "whatever is computed from it is none either"
    if p.type == "INT32" and value != int(value):
        return "is no whole number", "it is an INT32"
    if p.type == "INT32" and not INT32_MIN <= value <= INT32_MAX:
        return "is too large for its type", f"it is an INT32, from {INT32_MIN} to {INT32_MAX}"
    return None


def _within(value: float, p: Parameter) -> bool:
    """To the accuracy of a float of 32 bits."""
    slack = 0.0 if p.type == "INT32" else 1e-6 * max(abs(value), 1e-6)
    return (p.min is None or value >= p.min - slack) and (p.max is None or value <= p.max + slack)


def _named_elsewhere(name: str) -> bool:
    """Breakers have a rule of their own; counters have limits that their bits do not keep."""
    return name.startswith(("CBRK_", "LND_FLIGHT_T_"))


def _limits(p: Parameter) -> str:
    low, high = ("" if end is None else f"{end:g}" for end in (p.min, p.max))
    unit = f" {p.unit}" if p.unit else ""
    return (
        f"{low} to {high}{unit}"
        if low and high
        else f"{low} and more{unit}"
        if low
        else f"up to {high}{unit}"
    )


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.7g}" for name, value in values.items())
