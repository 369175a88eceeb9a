"""Vehicles on loopback sockets for parameter transfers: fake autopilots, or built-in autopilots in their world."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fake_autopilot import FakeAutopilot
from served import Connection, LossyLink, Served, UdpPort

from arena.autopilot import Autopilots
from arena.params.transfer.transports import ParamTarget
from arena.plan import make_plan
from arena.schema import load_arena
from arena.sim.world import World

_count = itertools.count(1)


def own_address() -> str:
    """Return a loopback address that no other test of this process has: 127.26.x.y."""
    return f"127.26.{os.getpid() % 250 + 1}.{next(_count)}"


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
        self.motors: Any = np.zeros((vehicles, 4))
        self._systems = [v["id"] for v in settings["vehicles"]]
        self._sent: list[list[bytes]] = [[] for _ in self._systems]
        self._began = time.monotonic()

    def vehicles(self) -> list[BuiltInVehicle]:
        return [BuiltInVehicle(self, i, system) for i, system in enumerate(self._systems)]

    def transmit(self, i: int) -> list[bytes]:
        """Return the datagrams of one vehicle. The first vehicle steps the world if that is due."""
        if i == 0 and self.world.now <= time.monotonic() - self._began:
            self.world.step(self.motors)
            self.motors = self.pilots.step(self.world.now, self.world.sense())
            for k, link, data in self.pilots.transmit():
                if link == "router":
                    self._sent[k].append(data)
        sent, self._sent[i] = self._sent[i], []
        return sent


@dataclass
class BuiltInVehicle:
    """One vehicle of a BuiltIn."""

    fleet: BuiltIn
    row: int
    system: int

    def receive(self, data: bytes, _: float) -> list[bytes]:
        self.fleet.pilots.receive(self.row, "router", data)
        return []

    def step(self, _: float) -> list[bytes]:
        return self.fleet.transmit(self.row)


@contextmanager
def serve(
    vehicles: Sequence[FakeAutopilot | BuiltInVehicle], links: Sequence[LossyLink] = ()
) -> Iterator[dict[str, ParamTarget]]:
    """Serve vehicles, each over a link of its own, and yield their targets by name."""
    host = own_address()
    connections = [
        Connection(autopilot=v, port=UdpPort((host, 24006 + 10 * v.system)), link=link)
        for v, link in zip(vehicles, links or [LossyLink() for _ in vehicles], strict=True)
    ]
    with Served(connections):
        yield {
            f"uav{v.system}": ParamTarget(system=v.system, remote=c.port.address)
            for v, c in zip(vehicles, connections, strict=True)
        }
