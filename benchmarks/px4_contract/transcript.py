"""Transcripts: what a case observed on one autopilot, and the differences between two transcripts.

Pure: no vehicle, no files. A transcript contains observations by key, in the order in which they were made.
Each has a kind, which determines how it is compared:

    equal    the values must be the same
    number   the values must agree within the larger of the absolute and the relative tolerance
    words    not compared, only shown beside a difference
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Literal

Value = str | int | float | bool | None
Kind = Literal["equal", "number", "words"]


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One observation.

    near: absolute tolerance, in `unit`
    part: relative tolerance
    """

    value: Value
    kind: Kind = "equal"
    near: float = 0.0
    part: float = 0.0
    unit: str = ""

    def __str__(self) -> str:
        if isinstance(self.value, float):
            text = "nan" if math.isnan(self.value) else f"{self.value:.3g}"
        else:
            text = (
                "nothing"
                if self.value is None
                else "yes"
                if self.value is True
                else "no"
                if self.value is False
                else str(self.value)
            )
        return f"{text} {self.unit}".strip()


@dataclass(kw_only=True)
class Transcript:
    """Observations of one case. If a key is used twice, a number is added to it."""

    seen: dict[str, Seen] = field(default_factory=dict)

    def note(self, key: str, value: Value) -> None:
        self._put(key, Seen(value=value))

    def number(
        self, key: str, value: float | None, *, near: float = 0.0, part: float = 0.0, unit: str = ""
    ) -> None:
        """Record a number. value: None if it was never observed."""
        rounded = (
            None
            if value is None
            else round(float(value), 4)
            if math.isfinite(value)
            else "nan"
            if math.isnan(value)
            else "inf"
        )
        self._put(key, Seen(value=rounded, kind="number", near=near, part=part, unit=unit))

    def words(self, key: str, text: str) -> None:
        self._put(key, Seen(value=text, kind="words"))

    def _put(self, key: str, seen: Seen) -> None:
        name, n = key, 2
        while name in self.seen:
            name, n = f"{key} #{n}", n + 1
        self.seen[name] = seen


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference between two transcripts.

    key: `case: observation`
    px4, builtin: the observations, None if only the other autopilot has one
    reason: reason for accepting the difference, empty if there is none
    """

    key: str
    px4: Seen | None
    builtin: Seen | None
    reason: str = ""


Transcripts = Mapping[str, Mapping[str, Seen]]
Known = Mapping[str, str]


def same(px4: Seen, builtin: Seen) -> bool:
    """Return whether two observations agree. The kind and the tolerance are those of px4's."""
    if px4.kind == "words":
        return True
    a, b = px4.value, builtin.value
    if px4.kind == "number" and _is_number(a) and _is_number(b):
        assert isinstance(a, int | float) and isinstance(b, int | float)
        return abs(a - b) <= max(px4.near, px4.part * abs(a)) + 1e-9
    return a == b and isinstance(a, bool) == isinstance(b, bool)


def _is_number(x: Value) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool)


def compare(px4: Transcripts, builtin: Transcripts, known: Known) -> list[Difference]:
    """Return the differences in all cases that both transcripts have, in the order of px4's.

    The reason of a difference is that of the first pattern that matches.
    """
    found = []
    for case in px4:
        if case not in builtin:
            continue
        theirs, ours = px4[case], builtin[case]
        for key in [*theirs, *(k for k in ours if k not in theirs)]:
            a, b = theirs.get(key), ours.get(key)
            one = a or b
            if one is not None and one.kind != "words" and (a is None or b is None or not same(a, b)):
                name = f"{case}: {key}"
                found.append(Difference(key=name, px4=a, builtin=b, reason=reason_of(name, known)))
    return found


def reason_of(name: str, known: Known) -> str:
    """Return the reason of the first matching pattern. known: pattern -> reason."""
    return next((why for pattern, why in known.items() if fits(name, pattern)), "")


def fits(name: str, pattern: str) -> bool:
    """Return whether a name matches: `*` is any text, `[3-5]` one of these characters."""
    return fnmatchcase(name, pattern.replace("?", "[?]"))


def idle(known: Known, differences: Iterable[Difference]) -> list[str]:
    """Return the patterns that match no difference, because it was removed or renamed."""
    names = [d.key for d in differences]
    return [pattern for pattern in known if not any(fits(name, pattern) for name in names)]


def dump(transcripts: Transcripts) -> dict[str, Any]:
    """Return the transcripts as JSON data, without fields that have their default values."""
    plain = Seen(value=None)
    return {
        case: {
            key: {k: v for k, v in asdict(s).items() if k == "value" or v != getattr(plain, k)}
            for key, s in seen.items()
        }
        for case, seen in transcripts.items()
    }


def load(data: Mapping[str, Any]) -> dict[str, dict[str, Seen]]:
    return {case: {key: Seen(**s) for key, s in seen.items()} for case, seen in data.items()}
