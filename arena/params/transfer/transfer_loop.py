"""Loop that runs the transfers of parameters with many vehicles at the same time, in one thread.

The thread polls all sockets and serial devices.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from arena.errors import RunError
from arena.params.transfer.transfer import Progress, Transfer
from arena.params.transfer.transports import ParamTarget, ParamTransport, open_transport
from arena.wire.mavlink_params import VALUE

_POLL_PERIOD_S = 0.02
_PROGRESS_PERIOD_S = 0.1

OnProgress = Callable[[Mapping[str, Progress]], None]
"""Callback that gets vehicle name -> progress, ten times per second and at the end."""

AnyTransfer = TypeVar("AnyTransfer", bound=Transfer)


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


class Connection(Generic[AnyTransfer]):
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
    def uptime_s(self) -> float | None:
        """Time since the vehicle's boot [s]; None if the vehicle has not reported it."""
        at = self.transfer.booted_at
        return None if at is None else max(time.monotonic() - at, 0.0)

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
            self.transport = None


BeforeSend = Callable[[Mapping[str, Connection[AnyTransfer]]], None]


def run(
    targets: Mapping[str, ParamTarget],
    make: Callable[[str, float], AnyTransfer],
    on_progress: OnProgress | None,
    before_send: BeforeSend[AnyTransfer] | None,
) -> dict[str, Connection[AnyTransfer]]:
    """Run the parameter transfers of several vehicles until all of them have ended.

    make: function (vehicle name, monotonic time [s]) that returns the transfer of a vehicle.
    before_send: callback that is called each time before frames are sent.
    """
    now = time.monotonic()
    connections = {name: Connection(make(name, now), target) for name, target in targets.items()}
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
    connections: Mapping[str, Connection[AnyTransfer]],
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
        now = time.monotonic()
        _read(
            poll, owners, 0.0
        )  # after a pause of this computer, a vehicle that has sent meanwhile is not lost
        frames = [(connection, connection.transfer.due(now)) for connection in connections.values()]
        before_send(connections)
        for connection, due in frames:
            connection.send(due)
        over = all(connection.transfer.done for connection in connections.values())
        if over or time.monotonic() >= next_progress:
            next_progress = time.monotonic() + _PROGRESS_PERIOD_S
            on_progress({name: connection.transfer.progress for name, connection in connections.items()})
        if over:
            return
        _read(poll, owners, _POLL_PERIOD_S)


def _read(poll: select.poll, owners: Mapping[int, Connection[AnyTransfer]], timeout_s: float) -> None:
    """Read what has arrived on all connections. Wait for it for `timeout_s` [s]."""
    for fd, event in poll.poll(timeout_s * 1e3):
        owners[fd].read()
        if event & select.POLLHUP:
            # The device was unplugged or reboots. Only a closed device gets the same name again. The time-out of the
            # vehicle will end the transfer.
            poll.unregister(fd)
            owners[fd].close()
