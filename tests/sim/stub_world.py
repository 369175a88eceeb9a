"""`python stub_world.py slice.json`: the world with autopilots that hover from the start and echo each datagram."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from arena.sim.__main__ import main


class Echo:
    """Autopilots that send each datagram back on its link. Armed if the slice sets `stub_armed`."""

    def __init__(self, settings: dict[str, Any], dt: float) -> None:
        self._count = len(settings["vehicles"])
        self._command = float(settings.get("stub_command", 0.0))
        self.armed = np.full(self._count, bool(settings.get("stub_armed", False)))
        self._out: list[tuple[int, str, bytes]] = []
        self._received = 0

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        self._received += 1
        self._out.append((vehicle, link, data))

    def step(self, now: float, sensors: dict[str, Any]) -> Any:
        return np.full((self._count, 4), self._command)

    def transmit(self) -> list[tuple[int, str, bytes]]:
        out, self._out = self._out, []
        return out

    def stats(self) -> dict[str, Any]:
        return {"received": self._received}

    def events(self) -> list[str]:
        return []

    def on_request(self, request) -> None:
        pass


class ExternalEcho(Echo):
    """The same, with a step in two halves as autopilots in processes of their own have."""

    requested = ()

    def receive_truth(self, truth: Any) -> None:
        pass

    def begin(self, now: float, sensors: dict[str, Any]) -> None:
        pass

    def finish(self) -> Any:
        return self.step(0.0, {})


def make(settings: dict[str, Any], dt: float) -> Echo:
    return (ExternalEcho if settings.get("stub_external") else Echo)(settings, dt)


if __name__ == "__main__":
    sys.exit(main(make_autopilots=make))
