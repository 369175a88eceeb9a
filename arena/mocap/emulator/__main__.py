"""`python -m arena.mocap.emulator slice.json`: the emulator's sockets and clock."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import sys
import time
from typing import Any

from arena.clock import SimClock
from arena.errors import RunError
from arena.fault_injection import Faults
from arena.mocap.emulator.core import Emulator
from arena.mocap.emulator.fault_injection import spoil
from arena.process_context import ProcessContext, run_room
from arena.wire.truth_page import TruthReader

_MOST_REQUESTS = 64
_LOOK_UP_MS = 250  # of the wall's time: whether to stop
_EARLY_S = 1e-6
_LATE_S = 0.008  # two steps of the world: its clock tells the time by steps


def main() -> int:
    return run_room("mocap", lambda room: _Shell(room).serve)


class _Shell:
    def __init__(self, room: ProcessContext) -> None:
        s = room.settings
        self.room, self.core = room, Emulator(s)
        self.clock, self.truth = SimClock(s["clock"], room.name), TruthReader(s["truth"])
        self.command, self.out = _command_socket(s), _stream_socket(s)
        self.faults = Faults(s.get("faults"))
        self.asked: float | None = None  # to be woken then [s]; None: awake
        self.poll = select.poll()
        for fd in (self.clock.fileno(), self.faults.fileno()):
            if fd >= 0:
                self.poll.register(fd, select.POLLIN)
        self.ready, self.late, self.skipped, self.not_sent = False, 0, 0, 0
        self.began = self.told = time.monotonic()

    def serve(self) -> None:
        """Until told to stop, or until the world ends."""
        try:
            self._serve()
        finally:
            self.faults.close()

    def _serve(self) -> None:
        core, clock = self.core, self.clock
        number = math.ceil((clock.now() + core.latency_s) * core.rate_hz)
        while not self.room.stopping:
            due = core.due(number)
            try:
                now = self._sleep_until(due)
            except RunError:
                return  # the world has ended, and with it what there was to see
            if now is None:
                continue
            self.late += now - due > max(1.0 / core.rate_hz, _LATE_S)
            wall = time.monotonic()
            if core.exposure(number) + core.latency_s <= due:
                number = self._take(number, now)
            for packet in core.leaving(now):
                self._send(packet, wall)
            self._answer(wall)
            if wall - self.told >= 1.0:
                self._report(wall)

    def _sleep_until(self, due: float) -> float | None:
        """The time then [s], or None when there is something else to see to first: a fault, or to stop. Faults are taken
        in the middle of a sleep, too: time may stand still while many of them are sent.
        """
        if self.asked != due:
            self.clock.ask(due)
            self.asked = due
        ready = [fd for fd, _ in self.poll.poll(_LOOK_UP_MS)]
        if self.faults.fileno() in ready:
            for text in self.faults.obey(lambda fault: spoil(self.core, fault)):
                self.room.event(text)
            return None
        now = self.clock.told(0.0) if ready else None
        if now is not None:
            self.asked = None
        return (
            now if now is not None and now >= due - _EARLY_S else None
        )  # else it answers what was asked before

    def _take(self, number: int, now: float) -> int:
        """Returns the frame after it."""
        sample = self.truth.at(self.core.exposure(number))
        if sample is None:
            self.skipped += 1
        else:
            self.core.take(number, sample)
        # A frame or two late are caught up with at once; more are gone, as the cameras' would be.
        due = math.ceil((now - self.core.latency_s) * self.core.rate_hz) - 2
        self.skipped += max(0, due - number - 1)
        return max(number + 1, due)

    def _send(self, packet: bytes, wall: float) -> None:
        failed = 0
        for address in self.core.destinations(wall):
            try:
                self.out.sendto(packet, address)
            except OSError:  # a full queue, or a network that is away: the next frame will be newer
                failed += 1
        self.not_sent += failed
        if not (self.ready or failed):
            self.ready = True
            self.room.ready()

    def _report(self, wall: float) -> None:
        sent = self.core.counts["frames"]
        rate_hz = round(sent / (wall - self.began), 2)
        self.told = wall
        troubles = {"late": self.late, "skipped": self.skipped, "not_sent": self.not_sent}
        self.room.stats({"rate_hz": rate_hz, **troubles, **self.core.counts})

    def _answer(self, wall: float) -> None:
        for _ in range(_MOST_REQUESTS):
            try:
                data, sender = self.command.recvfrom(2048)
            except OSError:
                return
            reply = self.core.hear(data, sender, wall)
            if reply is not None:
                with contextlib.suppress(OSError):
                    self.command.sendto(reply, sender)


def _command_socket(s: dict[str, Any]) -> socket.socket:
    command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    command.setblocking(False)
    try:
        command.bind((s["address"], s["command_port"]))
    except OSError as error:
        raise RunError(
            f"cannot serve NatNet on {s['address']}:{s['command_port']}: {error.strerror}"
        ) from error
    return command


def _stream_socket(s: dict[str, Any]) -> socket.socket:
    """Frames leave from the server's own address and never from the data port, which belongs to the clients."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.setblocking(False)
    out.bind((s["address"], 0))
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(s["address"]))
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    return out


if __name__ == "__main__":
    sys.exit(main())
