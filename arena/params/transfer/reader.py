"""The parameters of one vehicle read: some by their names, or the whole list. Pure.

The list comes unasked-for once it is asked for; what was lost of it is asked for by index.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from arena.params.transfer.request_window import Asking, Pace
from arena.params.transfer.transfer import PROBE, Outcome, Progress, Transfer
from arena.wire.mavlink_params import (
    DOES_NOT_EXIST,
    NO_INDEX,
    Message,
    Value,
    is_name,
    request_list,
    request_read,
)

_QUIET_S = 1.0  # the list has stopped
_LISTS = 5  # so often the whole list is asked for


class Reader(Transfer):
    """The parameters of these names, or all of the vehicle's list.

    values: what was read.  missing: name or index in the list -> unknown or lost, once it is done.
    """

    def __init__(
        self, *, system: int, component: int, now: float, names: Iterable[str] | None = None
    ) -> None:
        super().__init__(system=system, component=component, now=now)
        self.values: dict[str, Value] = {}
        self.missing: dict[str | int, Outcome] = {}
        self._pace = Pace()
        self._names = None if names is None else dict.fromkeys(names)
        self._list = _List() if self._names is None else None
        self._asking: Asking[str | int] | None = None
        if self._names is not None:
            self._asking = Asking((n for n in self._names if is_name(n)), self._pace, PROBE)

    @property
    def progress(self) -> Progress:
        """of: 0 while the length of the list is not known."""
        if self._list is None:
            return Progress("reading", len(self.values), len(self._names or ()))
        return Progress("reading", len(self._list.seen), self._list.count)

    def _ask(self, now: float) -> Iterable[Message]:
        if self._asking is not None:
            keys = self._asking.due(now)
            if self._asking.over:
                self._end(self._asking)
            return [request_read(self.system, key) for key in keys]
        assert self._list is not None
        if not self._list.is_quiet(now):
            return []
        missing = self._list.missing
        if self._list.count and not missing:
            self.ending = "done"
        elif self._list.asked < _LISTS and len(missing) * 2 >= self._list.count:
            self._list.begin(now)
            return [request_list(self.system)]
        elif missing:
            self._asking = Asking(missing, self._pace, next(iter(self._list.seen)))
        else:
            self.ending = "not heard"  # it speaks, and to all that we ask it says nothing
        return []

    def _on_value(self, value: Value, now: float) -> None:
        if self._list is not None:
            listed = value.place < value.total
            if listed and self._list.hear(value, now):
                self._asking = None  # the indices have moved: what was missing is asked for anew
            if listed:
                self.values[value.name] = value
        elif self._names is not None and value.name in self._names:
            self.values[value.name] = value
        if self._asking is not None:
            answer(self._asking, value, now)

    def _on_error(self, name: str, error: int, why: str) -> None:
        if self._asking is not None and name:
            self._asking.refuse(name, "silent" if error == DOES_NOT_EXIST else "lost")

    def _end(self, asking: Asking[str | int]) -> None:
        unsendable = [name for name in self._names or () if not is_name(name)]
        unknown: list[str | int] = [*unsendable, *asking.those("silent")] if self._list is None else []
        self.missing = dict.fromkeys(unknown, "unknown")
        for key in asking.those("lost", "silent"):
            self.missing.setdefault(key, "lost")
        self.ending = "done"


class _List:
    """How far a vehicle's list has come. seen: by index.  asked: how often it was asked for."""

    def __init__(self) -> None:
        self.count = self.asked = 0
        self.seen: dict[int, str] = {}
        self._news_at = -math.inf

    @property
    def missing(self) -> list[str | int]:
        return [index for index in range(self.count) if index not in self.seen]

    def is_quiet(self, now: float) -> bool:
        """Nothing new has come for a while, or nothing is missing."""
        return now - self._news_at >= _QUIET_S * max(self.asked, 1) or (
            self.count > 0 and len(self.seen) == self.count
        )

    def begin(self, now: float) -> None:
        self.asked, self._news_at = self.asked + 1, now

    def hear(self, value: Value, now: float) -> bool:
        """True when the list has another length than it had: its indices count from the beginning again."""
        moved = self.count not in (0, value.total)
        if moved:
            self.seen.clear()
            self.asked = min(self.asked, _LISTS - 1)
        if value.place not in self.seen:
            self._news_at = now
        self.count = value.total
        self.seen[value.place] = value.name
        return moved


def answer(asking: Asking[str | int], value: Value, now: float) -> None:
    """A PARAM_VALUE answers a question by name, and one by index."""
    asking.answer(value.name, now)
    if value.place != NO_INDEX:
        asking.answer(value.place, now)
