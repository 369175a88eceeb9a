"""Writer of one vehicle's parameters over MAVLink: reads, writes values that differ, and reads them back. Pure.

    reading -> writing -> (reading parameters that were unknown, after others are written) -> reading back -> done

A parameter counts as written only after it was read back with the new value. Nothing is written to an armed vehicle: the
transfer ends with the first heartbeat that shows an armed vehicle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from arena.params.transfer.reader import record_answer
from arena.params.transfer.request_window import LinkEstimate, RequestState, RequestWindow
from arena.params.transfer.transfer import PROBE, Outcome, ParamResult, Progress, Transfer
from arena.params.transfer.uid_check import UidCheck
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

_MAX_WRITES = 3  # attempts to write a parameter that is read back with another value

Phase = Literal["reading", "writing", "reading back"]
Step = Literal["unread", "differs", "sent", "acknowledged"]


@dataclass(kw_only=True)
class _ParamWrite:
    """State of one parameter in a push: present value, wanted value and outcome.

    given: the value that the caller gave.
    wanted: the value rounded to the parameter's type; equal to `given` until the type is known.
    old: value before the transfer; None until it is read.
    new: value last read; None until it is read.
    kind: MAV_PARAM_TYPE.
    writes: number of times that the parameter was written and read back.
    refused: whether the vehicle refused the value, with an error or by not answering.
    outcome: final outcome; "" while the transfer of this parameter runs.
    """

    given: float
    wanted: float
    old: float | None = None
    new: float | None = None
    kind: int = 0
    step: Step = "unread"
    writes: int = 0
    refused: bool = False
    outcome: Outcome | Literal[""] = ""
    why: str = ""

    def close(self, outcome: Outcome, why: str = "") -> None:
        """Set the final outcome of writing this parameter.

        why: reason for the outcome; "" keeps the earlier reason.
        """
        self.outcome, self.why = outcome, why or self.why

    @property
    def holds(self) -> bool:
        """True if the vehicle has reported the wanted value."""
        return self.new is not None and alike(self.new, self.wanted, self.kind)

    @property
    def result(self) -> ParamResult:
        outcome, why = (self.outcome, self.why) if self.outcome else _OPEN_OUTCOMES[self.step]
        return ParamResult(outcome, self.wanted, self.old, self.new, self.kind, why)


_OPEN_OUTCOMES: Mapping[Step, tuple[Outcome, str]] = {
    "unread": ("unread", ""),
    "differs": ("differs", ""),
    "sent": ("unanswered", "sent, but not acknowledged"),
    "acknowledged": ("written", "acknowledged, but not read back"),
}
"""Last step of a parameter -> (outcome, reason) if the transfer ends early."""
_MAY_APPEAR_LATER: tuple[Outcome, ...] = ("unknown", "unanswered")
_STEPS_DONE: Mapping[Step, int] = {"unread": 0, "differs": 1, "sent": 1, "acknowledged": 2}


class ParamWriter(Transfer):
    """Transfer that writes parameters to one vehicle: reads them, writes values that differ, reads these back.

    wanted: parameter -> value.
    dry_run: only read and compare; the vehicle may then be armed.
    px4_version: PX4 version for which the values were generated. If the firmware of the vehicle has another major or minor
        number, nothing is read or written. "": any version.
    """

    requests_boot_time = True

    def __init__(
        self,
        *,
        system: int,
        component: int,
        now: float,
        wanted: Mapping[str, float],
        dry_run: bool = False,
        px4_version: str = "",
        uid: UidCheck | None = None,
    ) -> None:
        super().__init__(system=system, component=component, now=now, uid=uid)
        self._params = {name: _ParamWrite(given=value, wanted=value) for name, value in wanted.items()}
        self._dry_run, self._px4_version = dry_run, px4_version
        self._link = LinkEstimate()
        self._acknowledged = 0
        self._phase: Phase = "reading"
        for name, param in self._params.items():
            if not is_name(name):
                param.close("unknown", "not a valid parameter name")
        self._window = self._new_window(self._open("unread"))

    @property
    def result(self) -> dict[str, ParamResult]:
        """Outcome so far of each parameter, as {parameter: outcome}, in the order of `wanted`."""
        return {name: param.result for name, param in self._params.items()}

    @property
    def before(self) -> dict[str, float]:
        """Return {parameter: old value} of the parameters that differed from the wanted values.

        All of them are known before the first value is written.
        """
        return {n: p.old for n, p in self._params.items() if p.old is not None and p.step != "unread"}

    @property
    def written(self) -> dict[str, float]:
        """Return {parameter: new value} of the values that the vehicle has acknowledged."""
        return {
            n: p.wanted
            for n, p in self._params.items()
            if p.step == "acknowledged" and p.outcome in ("", "written")
        }

    @property
    def unknown(self) -> dict[str, float]:
        """Return {parameter: new value} of the values that were sent, and which the vehicle may or may not have.

        The vehicle has not acknowledged them, or has not answered when they were read back.
        """
        return {
            n: p.wanted
            for n, p in self._params.items()
            if (p.step == "sent" and not p.outcome)
            or (p.step in ("sent", "acknowledged") and p.outcome == "unanswered")
        }

    @property
    def known(self) -> frozenset[str]:
        """Return the parameters whose present value is known: read, acknowledged or reported as missing after the last write."""
        return frozenset(
            n
            for n, p in self._params.items()
            if p.outcome in ("same", "written", "refused", "unknown")
            or (not p.outcome and p.step in ("differs", "acknowledged"))
        )

    @property
    def progress(self) -> Progress:
        """Progress of the push. Each parameter has three steps: read, write, read back."""
        closed = [
            p.outcome and (self.done or p.outcome not in _MAY_APPEAR_LATER) for p in self._params.values()
        ]
        n = sum(
            3 if over else _STEPS_DONE[p.step] for over, p in zip(closed, self._params.values(), strict=True)
        )
        return Progress(self._phase, n, 3 * len(self._params))

    def _update(self, now: float) -> None:
        super()._update(now)
        if self.firmware and self._px4_version and not same_table(self.firmware, self._px4_version):
            self.ending = self.ending or "wrong version"
        if self.armed and not self._dry_run:
            self.ending = self.ending or "armed"

    def _requests(self, now: float) -> Iterable[Message]:
        while self._window.done and not self.done:
            self._next_phase()
        if self.done or (self._phase == "writing" and not self._disarmed(now)):
            return []
        return [self._message(key) for key in self._window.due(now)]

    def _message(self, key: str | int) -> Message:
        if self._phase != "writing" or isinstance(key, int):
            return request_read(self.system, key)
        param = self._params[key]
        if param.step == "differs":
            param.step = "sent"
        return set_value(self.system, key, param.wanted, param.kind)

    def _on_value(self, value: Value, now: float) -> None:
        param = self._params.get(value.name)
        if param is not None and not param.outcome:
            if param.step in ("unread", "differs") and self._phase == "reading":
                self._compare(param, value)
            elif param.step != "unread":
                param.new = value.value
                if param.step == "sent" and param.holds:
                    param.step = "acknowledged"
        record_answer(self._window, value, now)

    def _on_error(self, name: str, error: int, why: str) -> None:
        writing = self._phase == "writing"
        if name in self._params and writing:
            self._params[name].why = why
        self._window.refuse(name, "ignored" if error == DOES_NOT_EXIST or writing else "lost")

    def _compare(self, param: _ParamWrite, value: Value) -> None:
        """Compare the present value of a parameter with the wanted value. Equal values are not written."""
        param.old = param.new = value.value
        param.kind = value.kind
        try:
            param.wanted = fitted(param.given, value.kind)
        except ValueError as error:
            param.close("refused", f"{error}; not sent")
            return
        if param.holds:
            param.close("same")
        else:
            param.step = "differs"

    # --- phases

    def _next_phase(self) -> None:
        window = self._window
        if self._phase == "reading":
            self._close_unanswered(window, {"ignored": "unknown", "lost": "unanswered"})
            if not self._start("writing", [] if self._dry_run else self._open("differs")):
                self._after_writing()
        elif self._phase == "writing":
            for name in window.with_state("ignored"):
                self._params[str(name)].refused = True
            if not self._read_unknown_again():
                self._after_writing()
        else:
            self._close_unanswered(window, {"ignored": "unanswered", "lost": "unanswered"})
            self._check_read_back([str(name) for name in window.with_state("answered")])
            if not (self._start("writing", self._open("differs")) or self._read_unknown_again()):
                self.ending = "done"

    def _after_writing(self) -> None:
        if not self._start("reading back", self._open("sent", "acknowledged")):
            self.ending = "done"

    def _read_unknown_again(self) -> bool:
        """Read missing parameters again if new values were acknowledged. Return whether reading was started.

        In PX4, some parameters exist only after another parameter has a certain value.
        """
        acknowledged = sum(param.step == "acknowledged" for param in self._params.values())
        if acknowledged <= self._acknowledged:
            return False
        self._acknowledged = acknowledged
        again = [
            n
            for n, p in self._params.items()
            if p.step == "unread" and p.outcome in _MAY_APPEAR_LATER and is_name(n)
        ]
        for name in again:
            self._params[name].outcome = ""
        return self._start("reading", again)

    def _check_read_back(self, names: Iterable[str]) -> None:
        """Compare the values that were read back with the wanted values.

        Mark each one as written, as refused, or to be written again.

        A parameter with the wanted value counts as written. A parameter with another value is written again; after too many
        attempts it counts as refused.
        """
        for name in names:
            param = self._params[name]
            param.writes += 1
            if param.holds:
                param.step, param.why = "acknowledged", ""
                param.close("written")
            elif param.refused or param.writes >= _MAX_WRITES:
                param.close("refused", param.why)
            else:
                param.step = "differs"

    def _close_unanswered(
        self, window: RequestWindow[str | int], outcomes: Mapping[RequestState, Outcome]
    ) -> None:
        for state, outcome in outcomes.items():
            for name in window.with_state(state):
                param = self._params[str(name)]
                param.close(outcome, _OPEN_OUTCOMES[param.step][1] if outcome == "unanswered" else "")

    def _open(self, *steps: Step) -> list[str]:
        return [name for name, param in self._params.items() if not param.outcome and param.step in steps]

    def _start(self, phase: Phase, names: list[str]) -> bool:
        """Start a phase of the push (reading, writing or reading back). Return False if `names` is empty."""
        if names:
            self._phase, self._window = phase, self._new_window(names)
        return bool(names)

    def _new_window(self, names: Iterable[str]) -> RequestWindow[str | int]:
        return RequestWindow(names, self._link, PROBE)


def same_table(a: str, b: str) -> bool:
    """Return whether two PX4 versions have the same major and minor number, and so the same parameters."""
    return a.split(".")[:2] == b.split(".")[:2]
