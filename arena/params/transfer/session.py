"""Parameter transfers with many vehicles at the same time, in one thread.

The thread polls all sockets and serial devices.

    pull(targets, names)        read parameters
    push(targets, wanted)       write parameters that differ
    reboot(targets)             reboot autopilots, so that new values take effect

If a vehicle cannot be reached, only its own transfer ends. Ctrl-C ends all transfers; the results so far are returned.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from arena.errors import RunError
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.reader import ParamReader
from arena.params.transfer.transfer import Ending, Outcome, ParamResult, Progress, Rebooter, Transfer
from arena.params.transfer.transports import ParamTarget, ParamTransport, open_transport
from arena.params.transfer.uid_check import UidCheck
from arena.params.transfer.writer import ParamWriter
from arena.wire.mavlink_ids import PARAMETER_TOOL
from arena.wire.mavlink_params import VALUE, Value

_POLL_PERIOD_S = 0.02
_PROGRESS_PERIOD_S = 0.1
_SAVE_PERIOD_S = 0.5  # between two saves of the record, if no old value could be lost

OnProgress = Callable[[Mapping[str, Progress]], None]
"""Callback that gets vehicle name -> progress, ten times per second and at the end."""


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """Duration and message counts of one parameter transfer.

    seconds: duration of the transfer [s].
    sent: number of frames sent.
    received: number of PARAM_VALUE messages received, including answers to other programs.
    """

    seconds: float = 0.0
    sent: int = 0
    received: int = 0


@dataclass(frozen=True, kw_only=True)
class PushReport:
    """Result of a push (writing parameters) to one vehicle.

    ending: "done", or why the transfer ended early.
    results: parameter -> outcome.
    needs_reboot: parameters that take effect only after a reboot and were written by this push, or before by the push that
        this push resumes.
    why: why the connection could not be opened, or why the vehicle is the wrong one; "" otherwise.
    uid: hardware uid of the vehicle; "" if it sends none.
    """

    ending: Ending
    results: Mapping[str, ParamResult] = field(default_factory=dict)
    needs_reboot: tuple[str, ...] = ()
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)
    uid: str = ""

    @property
    def holds(self) -> bool:
        """True if the push has ended and the vehicle has every wanted value."""
        return self.ending == "done" and all(r.outcome in ("same", "written") for r in self.results.values())

    def with_outcome(self, *outcomes: Outcome) -> list[str]:
        """Return the names of the parameters whose outcome is one of `outcomes`."""
        return [name for name, result in self.results.items() if result.outcome in outcomes]


@dataclass(frozen=True, kw_only=True)
class PullReport:
    """Result of a pull (reading parameters) from one vehicle.

    ending: "done", or why the transfer ended early.
    why: why the connection could not be opened; "" if it was opened.
    values: parameter name -> value read.
    missing: parameter name, or index in the list -> "unknown" or "unanswered".
    """

    ending: Ending
    values: Mapping[str, Value] = field(default_factory=dict)
    missing: Mapping[str | int, Outcome] = field(default_factory=dict)
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)

    @property
    def complete(self) -> bool:
        """True if every requested parameter was read."""
        return self.ending == "done" and not self.missing


def push(
    targets: Mapping[str, ParamTarget],
    wanted: Mapping[str, Mapping[str, float]],
    *,
    dry_run: bool = False,
    record: PushRecord | None = None,
    reboot_names: frozenset[str] = frozenset(),
    on_progress: OnProgress | None = None,
) -> dict[str, PushReport]:
    """Write parameters to vehicles: read the present values, write those that differ, and read these back.

    wanted: vehicle -> {parameter: value}.
    dry_run: only read and compare.
    record: record of these vehicles, which is saved during the push and deleted when all its vehicles are done. To resume an
        interrupted push, pass its record, and `record.wanted` as `wanted`, or only some of its vehicles.
    reboot_names: parameters that take effect only after a reboot.
    Raises OSError if the record cannot be saved. No value is sent before its old value is saved.
    """

    def make(name: str, now: float) -> ParamWriter:
        return ParamWriter(
            system=targets[name].system,
            component=_component(targets[name]),
            now=now,
            wanted=wanted[name],
            dry_run=dry_run,
            uid=UidCheck(_expected_uid(name, targets[name], record)),
        )

    earlier = {
        name: frozenset(record.vehicles[name].written) if record is not None else frozenset()
        for name in wanted
    }
    keeper = None if record is None or dry_run else _RecordKeeper(record)
    connections = _run(
        {name: targets[name] for name in wanted}, make, on_progress, keeper.update if keeper else None
    )
    reports = {
        name: _push_report(connection, reboot_names, earlier[name])
        for name, connection in connections.items()
    }
    if keeper is not None:
        keeper.update(connections, always=True)
        if not keeper.record.wanted:
            keeper.record.delete()
    return reports


def pull(
    targets: Mapping[str, ParamTarget],
    *,
    names: Sequence[str] | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, PullReport]:
    """Read parameters from vehicles. Return {vehicle: result}.

    names: names of the parameters; None for all parameters.
    """

    def make(name: str, now: float) -> ParamReader:
        uid = UidCheck(targets[name].uid) if targets[name].uid else None
        return ParamReader(
            system=targets[name].system, component=_component(targets[name]), now=now, names=names, uid=uid
        )

    return {
        name: _pull_report(connection) for name, connection in _run(targets, make, on_progress, None).items()
    }


def reboot(targets: Mapping[str, ParamTarget]) -> dict[str, str]:
    """Reboot the autopilots of vehicles. Return {vehicle: reason of the failure, or "" after success}."""

    def make(name: str, now: float) -> Rebooter:
        uid = UidCheck(targets[name].uid)
        return Rebooter(system=targets[name].system, component=_component(targets[name]), now=now, uid=uid)

    return {
        name: connection.why
        or connection.transfer.refusal
        or ("" if connection.transfer.ending == "done" else connection.transfer.ending)
        for name, connection in _run(targets, make, None, None).items()
    }


def _component(target: ParamTarget) -> int:
    return PARAMETER_TOOL.component_at(signs=bool(target.key_file))


def _push_report(
    connection: _Connection[ParamWriter], reboot_names: frozenset[str], earlier: frozenset[str]
) -> PushReport:
    """Return the result of a push to one vehicle. earlier: parameters that the resumed push has already written."""
    results = connection.transfer.result
    needs = tuple(
        name
        for name, result in results.items()
        if name in reboot_names
        and (result.outcome == "written" or (result.outcome == "same" and name in earlier))
    )
    return PushReport(
        ending=connection.transfer.ending,
        results=results,
        needs_reboot=needs,
        why=connection.why,
        traffic=connection.traffic,
        uid=connection.uid,
    )


def _expected_uid(name: str, target: ParamTarget, record: PushRecord | None) -> str:
    """Return the hardware uid that the vehicle must report, so that a push never writes to a wrong vehicle.

    If a push is resumed and its record contains a uid, this uid is returned; otherwise the uid of `target`.
    """
    resumed = record.vehicles[name].uid if record is not None else ""
    return resumed or target.uid


def _pull_report(connection: _Connection[ParamReader]) -> PullReport:
    transfer = connection.transfer
    return PullReport(
        ending=transfer.ending,
        values=transfer.values,
        missing=transfer.missing,
        why=connection.why,
        traffic=connection.traffic,
    )


# -- the loop ------------------------------------------------------------------------------------------------------------------

AnyTransfer = TypeVar("AnyTransfer", bound=Transfer)


class _Connection(Generic[AnyTransfer]):
    """Connection to one vehicle for a parameter transfer: open socket or device, or the error from opening it."""

    def __init__(self, transfer: AnyTransfer, target: ParamTarget) -> None:
        self.transfer, self._no_connection = transfer, ""
        self.sent = self.received = 0
        self.began = self.ended = time.monotonic()
        self.transport: ParamTransport | None = None
        try:
            self.transport = open_transport(target)
        except RunError as error:
            self._no_connection = str(error)
            transfer.ending = "no connection"

    @property
    def why(self) -> str:
        """Text for the user about a failed connection or a wrong vehicle; "" if there is no such problem."""
        return self._no_connection or (self.transfer.uid.problem if self.transfer.uid is not None else "")

    @property
    def uid(self) -> str:
        return self.transfer.uid.found if self.transfer.uid is not None else ""

    @property
    def traffic(self) -> Traffic:
        return Traffic(seconds=self.ended - self.began, sent=self.sent, received=self.received)

    def read(self) -> None:
        for data, frames in self.transport.read() if self.transport else ():
            for frame in frames:
                self.received += frame.msgid == VALUE
                self.transfer.receive(data, frame, time.monotonic())

    def send(self, frames: Sequence[bytes]) -> None:
        if self.transport is not None:
            self.sent += len(frames)
            for frame in frames:
                self.transport.send(frame)
        if not self.transfer.done:
            self.ended = time.monotonic()

    def close(self) -> None:
        if self.transport is not None:
            self.transport.close()


class _RecordKeeper:
    """Writer that saves the record of a push to its file while the push runs.

    It saves immediately after old values were read, because they may be needed to undo the push.
    Otherwise it saves at most twice per second.
    """

    def __init__(self, record: PushRecord) -> None:
        self.record = record
        self._next = 0.0
        record.save()

    def update(self, connections: Mapping[str, _Connection[ParamWriter]], *, always: bool = False) -> None:
        now, urgent, changed = time.monotonic(), always, False
        for name, connection in connections.items():
            known = len(self.record.vehicles[name].before)
            changed |= self.record.update(
                name,
                connection.transfer.before,
                connection.transfer.written,
                connection.transfer.ending,
                connection.uid,
            )
            urgent |= len(self.record.vehicles[name].before) > known
        if urgent or (changed and now >= self._next):
            self._next = now + _SAVE_PERIOD_S
            self.record.save()


BeforeSend = Callable[[Mapping[str, _Connection[AnyTransfer]]], None]


def _run(
    targets: Mapping[str, ParamTarget],
    make: Callable[[str, float], AnyTransfer],
    on_progress: OnProgress | None,
    before_send: BeforeSend[AnyTransfer] | None,
) -> dict[str, _Connection[AnyTransfer]]:
    """Run the parameter transfers of several vehicles until all of them have ended.

    make: function (vehicle name, monotonic time [s]) that returns the transfer of a vehicle.
    before_send: callback that is called each time before frames are sent.
    """
    now = time.monotonic()
    connections = {name: _Connection(make(name, now), target) for name, target in targets.items()}
    try:
        _loop(connections, on_progress or (lambda _: None), before_send or (lambda _: None))
    except KeyboardInterrupt:
        for connection in connections.values():
            connection.transfer.stop()
    finally:
        for connection in connections.values():
            connection.close()
    return connections


def _loop(
    connections: Mapping[str, _Connection[AnyTransfer]],
    on_progress: OnProgress,
    before_send: BeforeSend[AnyTransfer],
) -> None:
    poll = select.poll()
    owners = {
        connection.transport.fileno(): connection
        for connection in connections.values()
        if connection.transport is not None
    }
    for fd in owners:
        poll.register(fd, select.POLLIN)
    next_progress = 0.0
    while True:
        frames = [
            (connection, connection.transfer.due(time.monotonic())) for connection in connections.values()
        ]
        before_send(connections)
        for connection, due in frames:
            connection.send(due)
        over = all(connection.transfer.done for connection in connections.values())
        if over or time.monotonic() >= next_progress:
            next_progress = time.monotonic() + _PROGRESS_PERIOD_S
            on_progress({name: connection.transfer.progress for name, connection in connections.items()})
        if over:
            return
        for fd, event in poll.poll(_POLL_PERIOD_S * 1e3):
            owners[fd].read()
            if (
                event & select.POLLHUP
            ):  # the device was unplugged; the time-out of the vehicle will end the transfer
                poll.unregister(fd)
