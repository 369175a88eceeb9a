"""Telemetry that a kernel delivers reaches the same receivers as telemetry that the router routes message by message.

Three vehicles: one without ground station link, and one whose autopilot uses a socket, as PX4 does. Tools join, ports open and close,
programs sleep, and links lose and delay datagrams.
"""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

import arena.fused.router
from arena.fused.memory_links import RecorderLink
from arena.fused.router import FusedRouter
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

HOST = "127.56.7.1"
GCS_LOCAL, GCS, RECORDER = 29000, 29001, 29002
NAMES = ("held_telemetry", "telemetry_delivery")
VERSIONS = [
    pytest.param(interpreted_modules(*NAMES), id="interpreted"),
    pytest.param(compiled_modules(*NAMES), id="compiled"),
]
STEPS, STEP_S = 400, 0.004
FRAMES = (
    mavlink.MAVLink_attitude_message(0, *[0.5] * 6),
    mavlink.MAVLink_local_position_ned_message(0, *[0.25] * 6),
    mavlink.MAVLink_heartbeat_message(2, 12, 129, 6 << 16, 4, 3),
    mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190),
    mavlink.MAVLink_statustext_message(4, b"text"),
)
FAULTS: tuple[dict[str, Any], ...] = (
    {"do": "loss", "vehicle": "uav1", "share": 0.5},
    {"do": "delay", "vehicle": "uav2", "ms": 20},
    {"do": "loss", "vehicle": "uav1", "share": 0.0},
    {"do": "delay", "vehicle": "uav2", "ms": 0},
)


def packed(message: mavlink.MAVLink_message, system: int, component: int) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))


def port(vehicle: int, number: int) -> int:
    return 30000 + 100 * vehicle + number


def vehicle(i: int, *, ground: bool = True) -> dict[str, Any]:
    at = [[HOST, port(i, number)] for number in range(9)]
    return {
        "name": f"uav{i}",
        "id": i,
        "link": {"local": at[1], "remote": at[2]},
        "ground": {"local": at[3], "remote": at[4]} if ground else None,
        "serve": at[5],
        "clients": [{"name": "program", "address": at[6]}, {"name": "sdk", "address": at[7]}],
        "tools": at[8],
    }


class Arena:
    """Router, recorder link and receivers of one run. The same seed gives the same traffic.

    delivered: number of messages that the kernel has delivered.
    """

    def __init__(self, seed: int) -> None:
        self.rng, self.delivered = random.Random(seed), 0
        vehicles = [vehicle(1), vehicle(2, ground=False), vehicle(3)]
        settings = {
            "vehicles": vehicles,
            "gcs_local": [HOST, GCS_LOCAL],
            "gcs": [{"name": "gcs", "address": [HOST, GCS]}],
            "recorder": [HOST, RECORDER],
            "heartbeat": True,
            "simulated": True,
            "seed": 1,
        }
        self.inbox: list[tuple[int, str, bytes]] = []
        ignore = dict.fromkeys(("audit", "event", "facts", "ready", "stats"), lambda *_: None)
        context: Any = SimpleNamespace(settings=settings, **ignore)
        self.router = FusedRouter(context, lambda: 1.0, {0, 1}, self.inbox)
        self.link = RecorderLink((HOST, RECORDER), self.router.sockets, vehicles)
        self.asleep: set[str] = set()
        programs = {"uav1": "uav1", "uav2": "group.a", "uav3": "group.a"}
        self.router.hold_for_sleepers(programs, self.asleep)
        self.router.record_in(self.link)
        self.router.closed.refresh = lambda now: None  # only this test searches, so that runs are equal
        self.sockets: dict[str, socket.socket] = {}
        for i in (1, 2, 3):
            self.open(f"program{i}", port(i, 6))
        self.open("px4", port(3, 2))
        self.router.closed.search()

    def open(self, name: str, number: int) -> None:
        made = self.sockets[name] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        made.bind((HOST, number))
        made.setblocking(False)

    def close(self) -> None:
        self.router.close()
        self.link.close()
        for each in self.sockets.values():
            each.close()

    def change(self, step: int) -> None:
        """Open or close a port, let a tool join, or begin or end a fault."""
        kind = self.rng.choice(("sdk1", "sdk2", "gcs", "tool", "close", "fault"))
        if kind == "fault":
            self.router._impaired.apply(self.rng.choice(FAULTS))
        elif kind == "tool":
            self.open(f"tool{step}", 33000 + step)
            hello = packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), 255, 190)
            self.sockets[f"tool{step}"].sendto(hello, (HOST, port(self.rng.choice((1, 2, 3)), 8)))
        elif kind == "close":
            opened = [name for name in self.sockets if name in ("sdk1", "sdk2", "gcs")]
            if opened:
                self.sockets.pop(self.rng.choice(opened)).close()
        elif kind not in self.sockets:
            self.open(kind, GCS if kind == "gcs" else port(int(kind[-1]), 7))
        self.router.closed.search()

    def step(self, step: int, *, by_kernel: bool) -> list[object]:
        """Send the traffic of one step. Return all that the receivers, the recorder and the autopilots got."""
        rng, router, now = self.rng, self.router, STEP_S * step
        if rng.random() < 0.04:
            self.change(step)
        if rng.random() < 0.3:
            self.sockets["px4"].sendto(packed(FRAMES[0], 3, 1), (HOST, port(3, 1)))
        if rng.random() < 0.3:
            setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, *[0] * 12)
            self.sockets["program1"].sendto(packed(setpoint, 1, 191), (HOST, port(1, 5)))
        router.drain(now - STEP_S)
        for name in ("uav1", "group.a"):
            if rng.random() < 0.6:
                self.asleep.add(name)
            else:
                self.asleep.discard(name)
                router.held.before_wake(name)
        messages, at = [self.message() for _ in range(rng.randrange(6))], -1
        while True:
            new = router.deliver(messages, at + 1, now) if by_kernel else at + 1
            self.delivered += new - at - 1
            at = new
            if at == len(messages):
                break
            i, link, data = messages[at]
            if link in ("router", "ground"):
                router.from_vehicle(i, data, now, link)
        router.step(now)
        found = [self.take(), self.link.receive(now, references=False), list(self.inbox)]
        self.inbox.clear()
        return found

    def message(self) -> tuple[int, str, bytes]:
        i, link = self.rng.choice((0, 1)), self.rng.choice(("router", "router", "ground", "vision", "panic"))
        frames = self.rng.choices(FRAMES, [9, 5, 1, 1, 1], k=self.rng.randrange(1, 4))
        return i, link, b"".join(packed(frame, i + 1, 1) for frame in frames)

    def take(self) -> dict[str, list[bytes]]:
        found: dict[str, list[bytes]] = {name: [] for name in self.sockets}
        for name, each in self.sockets.items():
            try:
                while True:
                    found[name].append(each.recv(65536))
            except BlockingIOError:
                pass
        return found


@contextmanager
def opened(seed: int) -> Iterator[Arena]:
    made = Arena(seed)
    try:
        yield made
    finally:
        made.close()


@needs_compiled  # without compiled kernels the router routes each message
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("modules", VERSIONS)
def test_kernel_delivers_as_the_router_routes(
    modules: dict[str, ModuleType], seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(seed) as routed:
        expected = [routed.step(k, by_kernel=False) for k in range(STEPS)]
        counts = routed.router.stats()
    for name in ("TelemetryDelivery", "TelemetryPath"):
        monkeypatch.setattr(arena.fused.router, name, getattr(modules["telemetry_delivery"], name))
    monkeypatch.setattr(arena.fused.router, "HeldTelemetry", modules["held_telemetry"].HeldTelemetry)
    with opened(seed) as delivered:
        for k, wanted in enumerate(expected):
            assert delivered.step(k, by_kernel=True) == wanted, f"step {k}"
        assert delivered.router.stats() == counts
        assert delivered.delivered > 50


def test_all_datagrams_of_a_step_are_recorded_at_its_time() -> None:
    with opened(1) as made:
        made.sockets["px4"].sendto(packed(FRAMES[0], 3, 1), (HOST, port(3, 1)))
        made.router.drain(1.0)
        assert made.router.deliver([(0, "router", packed(FRAMES[0], 1, 1))], 0, 1.004) in (0, 1)
        made.router.from_vehicle(1, packed(FRAMES[0], 2, 1), 1.004)
        found = made.link.receive(1.004, references=False)
        assert {time_s for *_, time_s in found} == {1.004}
        assert {"uav2", "uav3"} <= {name for name, *_ in found}
