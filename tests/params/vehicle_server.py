"""Vehicles behind loopback sockets, served by a thread: simulated ones, or built-in autopilots in their world."""

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
from arena.params.transfer.transports import ParamTarget
from arena.plan import make_plan
from arena.schema import load_arena
from arena.sim.world import World

from .simulated_vehicle import LossyLink, Vehicle

_count = itertools.count(1)


def own_address() -> str:
    """Return a loopback address that no other test of this process has: 127.26.x.y."""
    return f"127.26.{os.getpid() % 250 + 1}.{next(_count)}"


class Served(Protocol):
    """Vehicles behind the sockets, by index."""

    def systems(self) -> Sequence[int]: ...
    def receive(self, i: int, data: bytes) -> list[bytes]: ...
    def step(self) -> list[tuple[int, bytes]]: ...


class Simulated:
    """Simulated vehicles, each with a link of its own."""

    def __init__(self, vehicles: Sequence[Vehicle], links: Sequence[LossyLink] = ()) -> None:
        self.vehicles = vehicles
        self.links = links or [LossyLink() for _ in vehicles]

    def systems(self) -> Sequence[int]:
        return [v.system for v in self.vehicles]

    def receive(self, i: int, data: bytes) -> list[bytes]:
        self.links[i].send("up", data, time.monotonic())
        return []

    def step(self) -> list[tuple[int, bytes]]:
        now, out = time.monotonic(), []
        for i, (vehicle, link) in enumerate(zip(self.vehicles, self.links, strict=True)):
            for data in vehicle.step(now):
                link.send("down", data, now)
            for way, data in link.arrived(now):
                if way == "down":
                    out.append((i, data))
                else:
                    for answer in vehicle.receive(data):
                        link.send("down", answer, now)
        return out


class BuiltIn:
    """Built-in autopilots on the floor of their world, which follows wall time where it can."""

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

    def receive(self, i: int, data: bytes) -> list[bytes]:
        self.pilots.receive(i, "router", data)
        return []

    def step(self) -> list[tuple[int, bytes]]:
        if self.world.now > time.monotonic() - self._began:
            return []
        self.world.step(self.motors)
        self.motors = self.pilots.step(self.world.now, self.world.sense())
        return [(i, data) for i, link, data in self.pilots.transmit() if link == "router"]


@contextmanager
def serve(fleet: Served) -> Iterator[dict[str, ParamTarget]]:
    """Serve vehicles and yield their targets by name. A vehicle sends to its last sender, as a router does."""
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
            for fd, _ in poll.poll(5):
                i = rows[fd]
                data, partners[i] = sockets[i].recvfrom(65536)
                for answer in fleet.receive(i, data):
                    sockets[i].sendto(answer, partners[i])
            for i, data in fleet.step():
                if i in partners:
                    sockets[i].sendto(data, partners[i])

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield {
            f"uav{s}": ParamTarget(system=s, remote=sock.getsockname())
            for s, sock in zip(fleet.systems(), sockets, strict=True)
        }
    finally:
        over.set()
        thread.join(10)
        for sock in sockets:
            sock.close()
