"""Names that went, came under another name, or whose number came to mean something else, 1.9 to 1.18: what a room's multicopter
may carry in an old parameter file. Outputs and mixers (PWM_*, CA_*), receivers and other vehicles' names are not followed.

`carry` takes a file's values step by step from one version to a newer one. Nothing is lost in silence: what has no successor,
or none that a number can be worked out for, is told in a note. Backwards it does not go.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from arena.errors import InputError
from arena.params.facts.changes import CHANGES, Change
from arena.params.facts.parameter_table import Version


class Carried(NamedTuple):
    """values: under the newer version's names.  notes: what was renamed, converted or lost, one sentence each."""

    values: Mapping[str, float]
    notes: tuple[str, ...]


def changes(since: Version | str, to: Version | str) -> tuple[Change, ...]:
    """Those that lie between the two versions, in order. Raises InputError when `to` is the older one."""
    first, last = (Version.of(v) for v in (since, to))
    if (last.major, last.minor) < (first.major, first.minor):
        raise InputError(
            f"parameters of PX4 {first} cannot be carried back to {last}; expected the same version or a newer one"
        )
    return tuple(change for change in CHANGES if first.minor < change.at <= last.minor)


def successors(name: str, since: Version | str, to: Version | str) -> tuple[str, ...]:
    """Under which names `to` knows what `since` called `name`; () when it does not."""
    names: tuple[str, ...] = (name,)
    for change in changes(since, to):
        if change.old in names:
            names = tuple(new for old in names for new in (change.new if old == change.old else (old,)))
    return tuple(dict.fromkeys(names))


def carry(values: Mapping[str, float], since: Version | str, to: Version | str) -> Carried:
    """A file's values under the names and numbers of a newer version. What stands under the new name already stays."""
    held = dict(values)
    notes: list[str] = []
    steps = changes(since, to)
    for at in sorted({change.at for change in steps}):
        here = [c for c in steps if c.at == at and c.old in held]
        found = [(c, held.pop(c.old)) for c in here]
        # a name's own new number comes first: what others become does not displace it
        for change, value in sorted(found, key=lambda pair: pair[0].old not in pair[0].new):
            given = change.convert(value) if change.convert else {}
            notes += _told(change, value, given, held)
            held = {**given, **held}
    return Carried(held, tuple(notes))


def _told(change: Change, value: float, given: Mapping[str, float], held: Mapping[str, float]) -> list[str]:
    if given == {change.old: value}:
        return []
    where = f"PX4 1.{change.at}: {change.old} {value:g}"
    if not given:
        return [f"{where} is dropped: {change.why}"]
    told = [
        f"{where} becomes {', '.join(f'{name} {number:g}' for name, number in given.items())}: {change.why}"
    ]
    kept = [f"{name} stays {held[name]:g}" for name in given if name in held and held[name] != given[name]]
    return told + [f"PX4 1.{change.at}: {name}, as given under that name" for name in kept]
