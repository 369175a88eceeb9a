"""`python -m arena.mocap slice.json`: the emulator's sockets and clock."""

from __future__ import annotations

import contextlib
import math
import socket
import sys
import time
from typing import Any

from arena.clock import SimClock
from arena.errors import ArenaError, RunError
from arena.mocap.emulator import Emulator
from arena.room import Room
from arena.wire.truth import TruthReader

_MOST_REQUESTS = 64


def main() -> int:
    try:
        room = Room.enter()
        serve(room)
    except ArenaError as error:
        print(f"mocap: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def serve(room: Room) -> None:
    """Until told to stop, or until the world ends."""
    s = room.settings
    emulator, clock, truth = Emulator(s), SimClock(s["clock"], room.name), TruthReader(s["truth"])
    command, out = _command_socket(s), _stream_socket(s)
    number = math.ceil((clock.now() + emulator.latency_s) * emulator.rate_hz)
    late, ready, told, frames_then = 0, False, time.monotonic(), 0
    while not room.stopping:
        leaves = emulator.exposure(number) + emulator.latency_s
        try:
            now = clock.sleep_until(leaves)
        except RunError:
            return  # the world has ended, and with it what there was to see
        sample = truth.at(emulator.exposure(number))
        late += now - leaves > 0.5 / emulator.rate_hz
        wall = time.monotonic()
        if sample is not None:
            packet = emulator.frame(number, sample)
            for address in emulator.destinations(wall):
                with contextlib.suppress(OSError):
                    out.sendto(packet, address)
            if not ready:
                ready = True
                room.ready()
        _answer(command, emulator, wall)
        # A frame or two late are caught up with at once; more are gone, as the cameras' would be.
        number = max(number + 1, math.ceil((now - emulator.latency_s) * emulator.rate_hz) - 2)
        if wall - told >= 1.0:
            sent = emulator.counts["frames"]
            room.stats({"rate_hz": round((sent - frames_then) / (wall - told), 2), "late": late, **emulator.counts})
            told, frames_then = wall, sent


def _answer(command: socket.socket, emulator: Emulator, wall: float) -> None:
    for _ in range(_MOST_REQUESTS):
        try:
            data, sender = command.recvfrom(2048)
        except OSError:
            return
        reply = emulator.hear(data, sender, wall)
        if reply is not None:
            with contextlib.suppress(OSError):
                command.sendto(reply, sender)


def _command_socket(s: dict[str, Any]) -> socket.socket:
    command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    command.setblocking(False)
    try:
        command.bind((s["address"], s["command_port"]))
    except OSError as error:
        raise RunError(f"cannot serve NatNet on {s['address']}:{s['command_port']}: {error.strerror}") from error
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
