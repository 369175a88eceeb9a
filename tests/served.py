"""Fake autopilots on loopback sockets and serial devices, over links that may lose datagrams."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import math
import os
import random
import selectors
import socket
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

from fake_autopilot import FakeAutopilot

Address = tuple[str, int]
TICK_S = 0.005


def until(done: Callable[[], object], deadline_s: float = 30.0) -> None:
    """Wait for an event with a deadline."""
    end = time.monotonic() + deadline_s
    tick = threading.Event()
    while not done():
        assert time.monotonic() < end, "it did not happen in time"
        tick.wait(0.002)


def let_pass(autopilot: FakeAutopilot, ticks: int) -> None:
    """Wait for this number of telemetry periods, so that datagrams on their way arrive."""
    end = autopilot.ticks + ticks
    until(lambda: autopilot.ticks >= end)


class LossyLink:
    """A link with loss, delay, duplicates and late packets.

    loss: share of lost packets, each way [-].
    delay_s: delay each way, within 10 % [s].
    twice: share of packets delivered twice [-].
    late: share of packets with four times the delay [-].
    counted: packets sent, by direction.
    """

    def __init__(
        self, *, seed: int = 1, loss: float = 0.0, delay_s: float = 0.0, twice: float = 0.0, late: float = 0.0
    ) -> None:
        self.rng = random.Random(seed)
        self.loss, self.delay_s, self.twice, self.late = loss, delay_s, twice, late
        self._flying: list[tuple[float, int, str, Any]] = []
        self._order = itertools.count()
        self.counted = {"up": 0, "down": 0}

    def send(self, way: str, packet: Any, now: float) -> None:
        """Send a packet "up" to the vehicle or "down" from it."""
        self.counted[way] += 1
        for _ in range(1 + (self.rng.random() < self.twice)):
            if self.rng.random() >= self.loss:
                delay = self.delay_s * (1 + 3 * (self.rng.random() < self.late)) * self.rng.uniform(0.9, 1.1)
                heapq.heappush(self._flying, (now + delay, next(self._order), way, packet))

    @property
    def next_arrival(self) -> float:
        """Time of the next arrival [s]; infinite when nothing is on its way."""
        return self._flying[0][0] if self._flying else math.inf

    def arrived(self, now: float) -> list[tuple[str, Any]]:
        found = []
        while self._flying and self._flying[0][0] <= now:
            _, _, way, packet = heapq.heappop(self._flying)
            found.append((way, packet))
        return found


class UdpPort:
    """A UDP socket of a vehicle."""

    def __init__(self, local: Address) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(local)
        self._socket.setblocking(False)
        self.address: Address = self._socket.getsockname()
        self.fd, self.close = self._socket.fileno(), self._socket.close

    def read(self) -> tuple[bytes, Any] | None:
        try:
            return self._socket.recvfrom(65535)
        except OSError:
            return None

    def write(self, data: bytes, to: Any) -> None:
        self._socket.sendto(data, to)


class SerialDevice:
    """The vehicle's end of a serial cable."""

    def __init__(self, device: str) -> None:
        self.fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def read(self) -> tuple[bytes, Any] | None:
        try:
            return (data, None) if (data := os.read(self.fd, 4096)) else None
        except OSError:
            return None

    def write(self, data: bytes, _: Any) -> None:
        with contextlib.suppress(BlockingIOError):  # a full line loses what does not fit, as a real one does
            os.write(self.fd, data)

    def close(self) -> None:
        os.close(self.fd)


class Autopilot(Protocol):
    """A vehicle that datagrams can be passed to."""

    def receive(self, data: bytes, now: float) -> list[bytes]: ...
    def step(self, now: float) -> list[bytes]: ...


@dataclass(kw_only=True)
class Connection:
    """One port of an autopilot. remote: where it sends; None: to everyone from whom it has received."""

    autopilot: Autopilot
    port: UdpPort | SerialDevice
    remote: Address | None = None
    link: LossyLink = field(default_factory=LossyLink)

    def __post_init__(self) -> None:
        one_receiver = self.remote is not None or isinstance(self.port, SerialDevice)
        self._fixed = [self.remote] if one_receiver else None
        self._senders: dict[Any, None] = {}

    @property
    def receivers(self) -> Collection[Any]:
        return self._senders if self._fixed is None else self._fixed

    def read(self, now: float) -> None:
        while (packet := self.port.read()) is not None:
            self._senders[packet[1]] = None
            self.link.send("up", packet, now)

    def send(self, data: bytes, now: float) -> None:
        for to in self.receivers:
            self.link.send("down", (data, to), now)

    def deliver(self, now: float) -> None:
        """Deliver what has arrived at either end of the link."""
        while arrived := self.link.arrived(now):
            for way, (data, other) in arrived:
                if way == "down":
                    self.port.write(data, other)
                    continue
                for answer in self.autopilot.receive(data, now):
                    to = other if self._fixed is None else self._fixed[0]
                    self.link.send("down", (answer, to), now)


class Served:
    """Autopilots behind their ports, served by one thread until closed."""

    def __init__(self, connections: Sequence[Connection]) -> None:
        self.connections = connections
        self._autopilots: dict[int, list[Connection]] = {}
        for c in connections:
            self._autopilots.setdefault(id(c.autopilot), []).append(c)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(10)
        assert not self._thread.is_alive()
        for c in self.connections:
            c.port.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            for c in self.connections:
                selector.register(c.port.fd, selectors.EVENT_READ, c)
            while not self._over.is_set():
                ready, now = selector.select(TICK_S), time.monotonic()
                for key, _ in ready:
                    key.data.read(now)
                for connections in self._autopilots.values():
                    if not any(c.receivers for c in connections):
                        continue  # its first telemetry is for the first receiver
                    for data in connections[0].autopilot.step(now):
                        for c in connections:
                            c.send(data, now)
                for c in self.connections:
                    c.deliver(now)
