"""Parameters of one vehicle written: read first, only what differs, the right types, read back. Pure.

    reading -> writing -> (what was unknown again, once something else was written) -> reading back -> done

What counts is what the vehicle says: a value is written once it has been read back. An armed vehicle is not written to, and one
that arms meanwhile is left alone at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from arena.params.transfer.reader import answer
from arena.params.transfer.request_window import Asking, Fate, Pace
from arena.params.transfer.transfer import PROBE, Outcome, Progress, Result, Transfer
from arena.wire.mavlink_params import (
    DOES_NOT_EXIST,
    Message,
    Value,
    alike,
    fitted,
    is_name,
    request_read,
    set_value,
)

_ROUNDS = 3  # of writing what was read back otherwise


@dataclass(kw_only=True)
class _Item:
    """One parameter on its way. given: what the caller wants; wanted: that as the vehicle's type holds it, once it is known.

    rounds: how often it was written and read back.  refused: in words, or by silence.  verdict: "" while it is not settled.
    """

    given: float
    wanted: float
    old: float | None = None
    new: float | None = None
    kind: int = 0
    step: Literal["unread", "differs", "sent", "acknowledged"] = "unread"
    rounds: int = 0
    refused: bool = False
    verdict: Outcome | Literal[""] = ""
    why: str = ""

    def settle(self, verdict: Outcome, why: str = "") -> None:
        self.verdict, self.why = verdict, why or self.why

    @property
    def holds(self) -> bool:
        return self.new is not None and alike(self.new, self.wanted, self.kind)

    @property
    def result(self) -> Result:
        outcome, why = (self.verdict, self.why) if self.verdict else _UNSETTLED[self.step]
        return Result(outcome, self.wanted, self.old, self.new, self.kind, why)


_UNSETTLED: dict[str, tuple[Outcome, str]] = {
    "unread": ("untried", ""),
    "differs": ("differs", ""),
    "sent": ("lost", "sent, but not acknowledged"),
    "acknowledged": ("written", "acknowledged, but not read back"),
}
_APPEARS = ("unknown", "lost")
_DONE_STEPS = {"unread": 0, "differs": 1, "sent": 1, "acknowledged": 2}


class Writer(Transfer):
    """Makes the vehicle's parameters be as wanted. before: the old values of what is written, known before the first is.

    dry_run: read and compare only; an armed vehicle is no obstacle then.
    """

    def __init__(
        self, *, system: int, component: int, now: float, wanted: Mapping[str, float], dry_run: bool = False
    ) -> None:
        super().__init__(system=system, component=component, now=now)
        self._items = {name: _Item(given=value, wanted=value) for name, value in wanted.items()}
        self._dry_run = dry_run
        self._pace = Pace()
        self._taken = 0
        self._phase: Literal["reading", "writing", "reading back"] = "reading"
        for name, item in self._items.items():
            if not is_name(name):
                item.settle("unknown", "no parameter can be called that")
        self._asking: Asking[str | int] = self._ask_for(self._open("unread"))

    @property
    def result(self) -> dict[str, Result]:
        """What has become of each so far, in the order wanted."""
        return {name: item.result for name, item in self._items.items()}

    @property
    def before(self) -> dict[str, float]:
        """Name -> the old value of what differs or was written."""
        return {n: i.old for n, i in self._items.items() if i.old is not None and i.step != "unread"}

    @property
    def written(self) -> dict[str, float]:
        """Name -> the new value of what the vehicle has acknowledged."""
        return {
            n: i.wanted
            for n, i in self._items.items()
            if i.step == "acknowledged" and i.verdict in ("", "written")
        }

    @property
    def progress(self) -> Progress:
        """Three steps for each: read, written, read back. What may appear later has done none yet."""
        settled = [i.verdict and (self.done or i.verdict not in _APPEARS) for i in self._items.values()]
        n = sum(
            3 if over else _DONE_STEPS[i.step] for over, i in zip(settled, self._items.values(), strict=True)
        )
        return Progress(self._phase, n, 3 * len(self._items))

    def _look(self, now: float) -> None:
        super()._look(now)
        if self.armed and not self._dry_run:
            self.ending = self.ending or "armed"

    def _ask(self, now: float) -> Iterable[Message]:
        while self._asking.over and not self.done:
            self._next_phase()
        if self.done or (self._phase == "writing" and not self._pulse(now)):
            return []
        return [self._message(key) for key in self._asking.due(now)]

    def _message(self, key: str | int) -> Message:
        if self._phase != "writing" or isinstance(key, int):
            return request_read(self.system, key)
        item = self._items[key]
        if item.step == "differs":
            item.step = "sent"
        return set_value(self.system, key, item.wanted, item.kind)

    def _on_value(self, value: Value, now: float) -> None:
        item = self._items.get(value.name)
        if item is not None and not item.verdict:
            if item.step in ("unread", "differs") and self._phase == "reading":
                self._compare(item, value)
            elif item.step != "unread":
                item.new = value.value
                if item.step == "sent" and item.holds:
                    item.step = "acknowledged"
        answer(self._asking, value, now)

    def _on_error(self, name: str, error: int, why: str) -> None:
        if name in self._items and self._phase == "writing":
            self._items[name].why = why
        self._asking.refuse(name, "silent" if error == DOES_NOT_EXIST or self._phase == "writing" else "lost")

    def _compare(self, item: _Item, value: Value) -> None:
        """What was read with what is wanted."""
        item.old = item.new = value.value
        item.kind = value.kind
        try:
            item.wanted = fitted(item.given, value.kind)
        except ValueError as error:
            item.settle("refused", f"{error}; not sent")
            return
        if item.holds:
            item.settle("same")
        else:
            item.step = "differs"

    # one phase after the other

    def _next_phase(self) -> None:
        asked = self._asking
        if self._phase == "reading":
            self._unheard(asked, {"silent": "unknown", "lost": "lost"})
            if not self._go("writing", [] if self._dry_run else self._open("differs")):
                self._after_writing()
        elif self._phase == "writing":
            for name in asked.those("silent"):
                self._items[str(name)].refused = True
            if not self._retry_unknown():
                self._after_writing()
        else:
            self._unheard(asked, {"silent": "lost", "lost": "lost"})
            self._judge([str(name) for name in asked.those("answered")])
            if not (self._go("writing", self._open("differs")) or self._retry_unknown()):
                self.ending = "done"

    def _after_writing(self) -> None:
        if not self._go("reading back", self._open("sent", "acknowledged")):
            self.ending = "done"

    def _retry_unknown(self) -> bool:
        """Some appear only once another has its value: when more have theirs than the last time, look again."""
        taken = sum(item.step == "acknowledged" for item in self._items.values())
        if taken <= self._taken:
            return False
        self._taken = taken
        again = [
            n for n, i in self._items.items() if i.step == "unread" and i.verdict in _APPEARS and is_name(n)
        ]
        for name in again:
            self._items[name].verdict = ""
        return self._go("reading", again)

    def _judge(self, names: Iterable[str]) -> None:
        """What was read back."""
        for name in names:
            item = self._items[name]
            item.rounds += 1
            if item.holds:
                item.step, item.why = "acknowledged", ""
                item.settle("written")
            elif item.refused or item.rounds >= _ROUNDS:
                item.settle("refused", item.why)
            else:
                item.step = "differs"

    def _unheard(self, asked: Asking[str | int], verdicts: Mapping[Fate, Outcome]) -> None:
        for fate, verdict in verdicts.items():
            for name in asked.those(fate):
                item = self._items[str(name)]
                item.settle(verdict, _UNSETTLED[item.step][1] if verdict == "lost" else "")

    def _open(self, *steps: str) -> list[str]:
        return [name for name, item in self._items.items() if not item.verdict and item.step in steps]

    def _go(self, phase: Literal["reading", "writing", "reading back"], names: list[str]) -> bool:
        if names:
            self._phase, self._asking = phase, self._ask_for(names)
        return bool(names)

    def _ask_for(self, names: Iterable[str]) -> Asking[str | int]:
        return Asking(names, self._pace, PROBE)
