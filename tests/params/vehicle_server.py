"""Vehicles behind sockets of loopback, in a thread: simulated ones of a few lines, or built-in autopilots in their world."""

from __future__ import annotations

import itertools
import os
import select
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from arena.autopilot import Autopilots
from arena.params.transfer.session import Target
from arena.plan import make_plan
from arena.schema import load_arena
from arena.sim.world import World

from .simulated_vehicle import Air, Vehicle

_count = itertools.count(1)


def own_address() -> str:
    """127.26.x.y: no other test of this process, and hardly one of another, has it."""
    return f"127.26.{os.getpid() % 250 + 1}.{next(_count)}"


class Served(Protocol):
    """What stands behind the sockets. system: of the i-th vehicle."""

    def systems(self) -> Sequence[int]: ...
    def hear(self, i: int, data: bytes) -> list[bytes]: ...
    def step(self) -> list[tuple[int, bytes]]: ...


class Simulated:
    """Each vehicle with its own air, if it has one."""

    def __init__(self, vehicles: Sequence[Vehicle], airs: Sequence[Air] = ()) -> None:
        self.vehicles = vehicles
        self.airs = airs or [Air() for _ in vehicles]

    def systems(self) -> Sequence[int]:
        return [v.system for v in self.vehicles]

    def hear(self, i: int, data: bytes) -> list[bytes]:
        self.airs[i].send("up", data, time.monotonic())
        return []

    def step(self) -> list[tuple[int, bytes]]:
        now, out = time.monotonic(), []
        for i, (vehicle, air) in enumerate(zip(self.vehicles, self.airs, strict=True)):
            for data in vehicle.step(now):
                air.send("down", data, now)
            for way, data in air.arrived(now):
                if way == "down":
                    out.append((i, data))
                else:
                    for answer in vehicle.hear(data):
                        air.send("down", answer, now)
        return out


class BuiltIn:
    """Built-in autopilots on the floor of their world, which keeps the wall's pace where it can."""

    def __init__(self, vehicles: int, folder: Path) -> None:
        file = folder / "arena.yaml"
        rows = "".join(
            f"  uav{k}: {{start: {{position: [0, {2 * k}, 0]}}}}\n" for k in range(1, vehicles + 1)
        )
        file.write_text(f"world: {{size: [60, 60, 10]}}\ndefaults: {{autopilot: builtin}}\nvehicles:\n{rows}")
        settings = next(s for s in make_plan(load_arena(file)).slices.values() if s["name"] == "world")
        self.world = World(settings)
        self.pilots = Autopilots(settings, self.world.period_s)
        self.motors: Any = [[0.0] * 4] * vehicles
        self._systems = [v["id"] for v in settings["vehicles"]]
        self._began = time.monotonic()

    def systems(self) -> Sequence[int]:
        return self._systems

    def hear(self, i: int, data: bytes) -> list[bytes]:
        self.pilots.receive(i, "router", data)
        return []

    def step(self) -> list[tuple[int, bytes]]:
        if self.world.now > time.monotonic() - self._began:
            return []
        self.world.step(self.motors)
        self.motors = self.pilots.step(self.world.now, self.world.sense())
        return [(i, data) for i, link, data in self.pilots.transmit() if link == "router"]


@contextmanager
def serve(fleet: Served) -> Iterator[dict[str, Target]]:
    """Its vehicles' targets, by name. They speak to whoever spoke to them last, as through a router."""
    host = own_address()
    sockets, partners = [], {}
    for system in fleet.systems():
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind((host, 24006 + 10 * system))
        sock.setblocking(False)
        sockets.append(sock)
    over = threading.Event()

    def work() -> None:
        rows = {sock.fileno(): i for i, sock in enumerate(sockets)}
        poll = select.poll()
        for fd in rows:
            poll.register(fd, select.POLLIN)
        while not over.is_set():
            for fd, _ in poll.poll(2):
                i = rows[fd]
                data, partners[i] = sockets[i].recvfrom(65536)
                for answer in fleet.hear(i, data):
                    sockets[i].sendto(answer, partners[i])
            for i, data in fleet.step():
                if i in partners:
                    sockets[i].sendto(data, partners[i])

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield {
            f"uav{s}": Target(system=s, remote=sock.getsockname())
            for s, sock in zip(fleet.systems(), sockets, strict=True)
        }
    finally:
        over.set()
        thread.join(10)
        for sock in sockets:
            sock.close()
