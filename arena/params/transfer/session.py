"""The sockets of reading and writing parameters: many vehicles at once, one thread, one poll.

    pull(targets, names)        what the vehicles hold
    push(targets, wanted)       make it what is wanted
    reboot(targets)             so that what needs it takes effect

A vehicle that cannot be reached ends its own part; the others' go on. Ctrl-C ends all of them, and what is known is given back.
"""

from __future__ import annotations

import contextlib
import select
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from arena.errors import RunError
from arena.params.transfer.push_record import Record
from arena.params.transfer.reader import Reader
from arena.params.transfer.transfer import Ending, Outcome, Progress, Rebooter, Result, Transfer
from arena.params.transfer.writer import Writer
from arena.transport import MAX_DATAGRAMS_PER_READ, Address, SerialPort, open_udp, receive_datagrams
from arena.wire.mavlink_frame import Buffer, Frame, Stream, parse_frames
from arena.wire.mavlink_minimal import own_component
from arena.wire.mavlink_params import VALUE, Value

_TURN_S = 0.02
_TOLD_S = 0.1  # between two calls of on_progress
_SAVED_S = 0.5  # between two states of the record, where nothing depends on it

OnProgress = Callable[[Mapping[str, Progress]], None]
"""Called a few times a second, and once more at the end, with how far each vehicle is."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """Where a vehicle is reached: over UDP or by a serial device.

    system: its MAVLink id.  remote: where to send, and the only place that is listened to; None: wherever it speaks from.
    local: our own end; None: any.  device: of a serial line; then the addresses are not used.  baud: of it.
    """

    system: int
    remote: Address | None = None
    local: Address | None = None
    device: str = ""
    baud: int = 57600


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """seconds: from the beginning to the end.  sent: frames.  heard: PARAM_VALUEs, whoever asked for them."""

    seconds: float = 0.0
    sent: int = 0
    heard: int = 0


@dataclass(frozen=True, kw_only=True)
class Report:
    """A push. ending: "done", or what cut it short.  why: where its wire did not open.  needs_reboot: of what was written."""

    ending: Ending
    results: Mapping[str, Result] = field(default_factory=dict)
    needs_reboot: tuple[str, ...] = ()
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)

    @property
    def holds(self) -> bool:
        """All is as wanted, as read from the vehicle."""
        return self.ending == "done" and all(r.outcome in ("same", "written") for r in self.results.values())

    def those(self, *outcomes: Outcome) -> list[str]:
        """The names that came to this."""
        return [name for name, result in self.results.items() if result.outcome in outcomes]


@dataclass(frozen=True, kw_only=True)
class Pulled:
    """ending, why: as in Report.  missing: name, or index in the list -> unknown or lost."""

    ending: Ending
    values: Mapping[str, Value] = field(default_factory=dict)
    missing: Mapping[str | int, Outcome] = field(default_factory=dict)
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)

    @property
    def whole(self) -> bool:
        return self.ending == "done" and not self.missing


def push(
    targets: Mapping[str, Target],
    wanted: Mapping[str, Mapping[str, float]],
    *,
    dry_run: bool = False,
    record: Record | None = None,
    reboot_names: frozenset[str] = frozenset(),
    on_progress: OnProgress | None = None,
) -> dict[str, Report]:
    """Write what differs to every vehicle of `wanted`.

    record: of the same vehicles; kept as it goes, and removed once all are done. To resume one, push its own `wanted` with it.
    reboot_names: parameters that take effect only after the vehicle has started anew.
    Raises OSError when the record cannot be written, before anything is sent that it should have told of.
    """
    component = own_component()

    def make(name: str, now: float) -> Writer:
        return Writer(
            system=targets[name].system, component=component, now=now, wanted=wanted[name], dry_run=dry_run
        )

    diary = None if record is None or dry_run else _Diary(record)
    lines = _run({name: targets[name] for name in wanted}, make, on_progress, diary.keep if diary else None)
    reports = {name: _report(line, reboot_names) for name, line in lines.items()}
    if diary is not None:
        diary.keep(lines, always=True)
        if all(report.ending == "done" for report in reports.values()):
            diary.record.close()
    return reports


def pull(
    targets: Mapping[str, Target],
    *,
    names: Sequence[str] | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Pulled]:
    """Read these parameters of every vehicle, or all there are."""
    component = own_component()

    def make(name: str, now: float) -> Reader:
        return Reader(system=targets[name].system, component=component, now=now, names=names)

    return {name: _pulled(line) for name, line in _run(targets, make, on_progress, None).items()}


def reboot(targets: Mapping[str, Target]) -> dict[str, str]:
    """Start the vehicles' autopilots anew. Name -> why not; "" where it does."""
    component = own_component()

    def make(name: str, now: float) -> Rebooter:
        return Rebooter(system=targets[name].system, component=component, now=now)

    return {
        name: line.why or line.core.refusal or ("" if line.core.ending == "done" else line.core.ending)
        for name, line in _run(targets, make, None, None).items()
    }


def _report(line: _Line[Writer], reboot_names: frozenset[str]) -> Report:
    results = line.core.result
    needs = tuple(
        name for name, result in results.items() if result.outcome == "written" and name in reboot_names
    )
    return Report(
        ending=line.core.ending, results=results, needs_reboot=needs, why=line.why, traffic=line.traffic
    )


def _pulled(line: _Line[Reader]) -> Pulled:
    core = line.core
    return Pulled(
        ending=core.ending, values=core.values, missing=core.missing, why=line.why, traffic=line.traffic
    )


# -- connections ---------------------------------------------------------------------------------------------------------------


class ParamTransport(Protocol):
    """The connection to one vehicle."""

    def fileno(self) -> int: ...

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        """Yield what has arrived from the vehicle, without waiting."""

    def send(self, frame: bytes) -> None:
        """Send a frame, or drop it when the connection is full or away: every request is repeated."""

    def close(self) -> None: ...


class UdpParamTransport:
    """A UDP socket. Without a fixed remote address, the vehicle is the first sender with its system id.

    Raises RunError when our own address cannot be bound.
    """

    def __init__(self, target: Target) -> None:
        self._remote, self._system = target.remote, target.system
        try:
            self._socket = open_udp(target.local)
        except OSError as error:
            host, port = target.local or ("", 0)
            raise RunError(
                f"cannot listen on UDP {host}:{port}: {error.strerror}. Does another program hold it?"
            ) from error

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        for data, sender in receive_datagrams(self._socket):
            frames = parse_frames(data).frames
            if self._remote is None and any(frame.sysid == self._system for frame in frames):
                self._remote = sender
            if sender == self._remote:
                yield data, frames

    def send(self, frame: bytes) -> None:
        if self._remote is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(frame, self._remote)

    def close(self) -> None:
        self._socket.close()


class SerialParamTransport:
    """A serial device. Raises RunError when it cannot be opened."""

    def __init__(self, target: Target) -> None:
        try:
            self._port = SerialPort(target.device, target.baud)
        except OSError as error:
            raise RunError(str(error)) from error
        self._stream = Stream()

    def fileno(self) -> int:
        return self._port.fileno()

    def read(self) -> Iterator[tuple[Buffer, list[Frame]]]:
        for _ in range(MAX_DATAGRAMS_PER_READ):
            try:
                data = self._port.read()
            except OSError:  # unplugged: the vehicle's silence ends the transfer
                return
            if data is None:
                return
            buffer, found = self._stream.feed(data)
            yield buffer, found.frames

    def send(self, frame: bytes) -> None:
        with contextlib.suppress(OSError):
            self._port.write(frame)

    def close(self) -> None:
        self._port.close()


# -- the loop ------------------------------------------------------------------------------------------------------------------

Core = TypeVar("Core", bound=Transfer)


class _Line(Generic[Core]):
    """One vehicle: its core and its wire, or why there is none."""

    def __init__(self, core: Core, target: Target) -> None:
        self.core, self.why = core, ""
        self.sent = self.heard = 0
        self.began = self.ended = time.monotonic()
        self.transport: ParamTransport | None = None
        try:
            self.transport = SerialParamTransport(target) if target.device else UdpParamTransport(target)
        except RunError as error:
            self.why = str(error)
            core.ending = "not heard"

    @property
    def traffic(self) -> Traffic:
        return Traffic(seconds=self.ended - self.began, sent=self.sent, heard=self.heard)

    def read(self) -> None:
        for data, frames in self.transport.read() if self.transport else ():
            for frame in frames:
                self.heard += frame.msgid == VALUE
                self.core.hear(data, frame, time.monotonic())

    def send(self, frames: Sequence[bytes]) -> None:
        if self.transport is not None:
            self.sent += len(frames)
            for frame in frames:
                self.transport.send(frame)
        if not self.core.done:
            self.ended = time.monotonic()

    def close(self) -> None:
        if self.transport is not None:
            self.transport.close()


class _Diary:
    """Keeps the record: at once where old values are about to be overwritten, now and then otherwise."""

    def __init__(self, record: Record) -> None:
        self.record = record
        self._next = 0.0
        record.save()

    def keep(self, lines: Mapping[str, _Line[Writer]], *, always: bool = False) -> None:
        now, urgent, news = time.monotonic(), always, False
        for name, line in lines.items():
            known = len(self.record.entries[name].before)
            news |= self.record.note(name, line.core.before, line.core.written, line.core.ending)
            urgent |= len(self.record.entries[name].before) > known
        if urgent or (news and now >= self._next):
            self._next = now + _SAVED_S
            self.record.save()


Keep = Callable[[Mapping[str, _Line[Core]]], None]


def _run(
    targets: Mapping[str, Target],
    make: Callable[[str, float], Core],
    on_progress: OnProgress | None,
    keep: Keep[Core] | None,
) -> dict[str, _Line[Core]]:
    """Until all are done. keep: called before anything is sent."""
    now = time.monotonic()
    lines = {name: _Line(make(name, now), target) for name, target in targets.items()}
    try:
        _work(lines, on_progress or (lambda _: None), keep or (lambda _: None))
    except KeyboardInterrupt:
        for line in lines.values():
            line.core.stop()
    finally:
        for line in lines.values():
            line.close()
    return lines


def _work(lines: Mapping[str, _Line[Core]], on_progress: OnProgress, keep: Keep[Core]) -> None:
    poll = select.poll()
    owners = {line.transport.fileno(): line for line in lines.values() if line.transport is not None}
    for fd in owners:
        poll.register(fd, select.POLLIN)
    next_word = 0.0
    while True:
        frames = [(line, line.core.due(time.monotonic())) for line in lines.values()]
        keep(lines)
        for line, due in frames:
            line.send(due)
        over = all(line.core.done for line in lines.values())
        if over or time.monotonic() >= next_word:
            next_word = time.monotonic() + _TOLD_S
            on_progress({name: line.core.progress for name, line in lines.items()})
        if over:
            return
        for fd, event in poll.poll(_TURN_S * 1e3):
            owners[fd].read()
            if event & select.POLLHUP:  # unplugged: its silence ends it
                poll.unregister(fd)
