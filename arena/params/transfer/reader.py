"""Reader of all or some parameters of one vehicle over MAVLink. Pure.

After PARAM_REQUEST_LIST the vehicle sends the whole list. Parameters whose message was lost are then requested by index.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from arena.params.transfer.request_window import LinkEstimate, RequestWindow
from arena.params.transfer.transfer import PROBE, Outcome, Progress, Transfer
from arena.params.transfer.uid_check import UidCheck
from arena.wire.mavlink_params import (
    DOES_NOT_EXIST,
    NO_INDEX,
    Message,
    Value,
    is_name,
    request_list,
    request_read,
)

_LIST_PAUSE_S = 1.0  # after which the list counts as ended
_MAX_LIST_REQUESTS = 5


class ParamReader(Transfer):
    """Transfer that reads all or some parameters from one vehicle.

    names: names of the parameters to read; None: the vehicle's whole list.
    values: parameter name -> value read.
    missing: parameter name, or index in the list -> "unknown" or "unanswered"; set when the transfer ends.
    """

    def __init__(
        self,
        *,
        system: int,
        component: int,
        now: float,
        names: Iterable[str] | None = None,
        uid: UidCheck | None = None,
    ) -> None:
        super().__init__(system=system, component=component, now=now, uid=uid)
        self.values: dict[str, Value] = {}
        self.missing: dict[str | int, Outcome] = {}
        self._link = LinkEstimate()
        self._names = None if names is None else dict.fromkeys(names)
        self._list = _ParamList() if self._names is None else None
        self._window: RequestWindow[str | int] | None = None
        if self._names is not None:
            self._window = RequestWindow((n for n in self._names if is_name(n)), self._link, PROBE)

    @property
    def progress(self) -> Progress:
        if self._list is None:
            return Progress("reading", len(self.values), len(self._names or ()))
        return Progress("reading", len(self._list.received), self._list.count)

    def _requests(self, now: float) -> Iterable[Message]:
        if self._window is not None:
            keys = self._window.due(now)
            if self._window.done:
                self._finish(self._window)
            return [request_read(self.system, key) for key in keys]
        assert self._list is not None
        if not self._list.has_stopped(now):
            return []
        missing = self._list.missing
        if self._list.count and not missing:
            self.ending = "done"
        elif self._list.requests < _MAX_LIST_REQUESTS and len(missing) * 2 >= self._list.count:
            self._list.restart(now)
            return [request_list(self.system)]
        elif missing:
            self._window = RequestWindow(missing, self._link, next(iter(self._list.received)))
        else:
            self.ending = "no connection"  # heartbeats arrive, but no request is answered
        return []

    def _on_value(self, value: Value, now: float) -> None:
        if self._list is not None:
            listed = value.place < value.total
            if listed and self._list.add(value, now):
                self._window = None  # indices have changed: request what is missing again
            if listed:
                self.values[value.name] = value
        elif self._names is not None and value.name in self._names:
            self.values[value.name] = value
        if self._window is not None:
            record_answer(self._window, value, now)

    def _on_error(self, name: str, error: int, why: str) -> None:
        if self._window is not None and name:
            self._window.refuse(name, "ignored" if error == DOES_NOT_EXIST else "lost")

    def _finish(self, window: RequestWindow[str | int]) -> None:
        unsendable = [name for name in self._names or () if not is_name(name)]
        unknown: list[str | int] = [*unsendable, *window.with_state("ignored")] if self._list is None else []
        self.missing = dict.fromkeys(unknown, "unknown")
        for key in window.with_state("lost", "ignored"):
            self.missing.setdefault(key, "unanswered")
        self.ending = "done"


class _ParamList:
    """The part of a vehicle's parameter list that was received so far.

    count: length of the list; 0 while unknown.
    received: index in the list -> parameter name.
    requests: number of requests for the list.
    """

    def __init__(self) -> None:
        self.count = self.requests = 0
        self.received: dict[int, str] = {}
        self._new_at = -math.inf

    @property
    def missing(self) -> list[str | int]:
        """Return the indices of the parameters in the vehicle's list that were not received."""
        return [index for index in range(self.count) if index not in self.received]

    def has_stopped(self, now: float) -> bool:
        """Return whether the vehicle has stopped sending its parameter list.

        This is true if the list is complete, or if nothing new has arrived for some time. now: monotonic [s].
        """
        return now - self._new_at >= _LIST_PAUSE_S * max(self.requests, 1) or (
            self.count > 0 and len(self.received) == self.count
        )

    def restart(self, now: float) -> None:
        """Record that the whole list was requested again. now: time of the request [s]."""
        self.requests, self._new_at = self.requests + 1, now

    def add(self, value: Value, now: float) -> bool:
        """Add a received parameter. Return whether the vehicle now reports a different number of parameters.

        After such a change all earlier indices are invalid, so the parameters received before are discarded.
        """
        changed = self.count not in (0, value.total)
        if changed:
            self.received.clear()
            self.requests = min(self.requests, _MAX_LIST_REQUESTS - 1)
        if value.place not in self.received:
            self._new_at = now
        self.count = value.total
        self.received[value.place] = value.name
        return changed


def record_answer(window: RequestWindow[str | int], value: Value, now: float) -> None:
    """Record a PARAM_VALUE as the answer to requests for this parameter by name and by index."""
    window.answer(value.name, now)
    if value.place != NO_INDEX:
        window.answer(value.place, now)
