"""The copilot's sockets and clock: one vehicle that is bytes on a socket, on a simulation clock that is moved by hand."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.clock_server import ClockServer
from arena.copilot import __main__ as shell
from arena.process_context import ProcessContext
from arena.schema.copilot import RULES, Copilot
from arena.wire.mavlink_codec import Codec

HOST = f"127.65.{os.getpid() % 250 + 1}.77"


def until(done: Callable[[], Any], limit_s: float = 30.0) -> Any:
    end = time.monotonic() + limit_s
    while not (found := done()):
        assert time.monotonic() < end
        time.sleep(0.01)
    return found


class Bench:
    """The copilot in a thread; `tools` and `panic` are the vehicle's ends."""

    def __init__(self, folder: Path) -> None:
        self.server = ClockServer(folder / "clock")
        self.server.tick(5.0)
        self.tools, self.panic = _bound(24016), _bound(24014)
        self.supervisor, line = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        line.setblocking(False)
        self.supervisor.setblocking(False)
        section = Copilot.model_validate({"pose_age": {"do": "none"}})
        self.room = ProcessContext(
            "copilot",
            {
                "rules": {rule: getattr(section, rule).model_dump() for rule in RULES},
                "at_most": "land",
                "escalate_after_s": 2.0,
                "latency_s": 0.01,
                "listen": [HOST, 24001],
                "captures": [],
                "clock": str(folder / "clock"),
                "vehicles": [
                    {
                        "name": "uav1",
                        "id": 1,
                        "body": "uav1",
                        "simulated": True,
                        "poses": False,
                        "tools": [HOST, 24016],
                        "panic": [HOST, 24014],
                        "fence": {"north": [-5, 5], "east": [-5, 5], "up": 3},
                        "braking": {"accel": 3.0, "jerk": 4.0, "up": 3.0, "down": 4.0},
                    }
                ],
            },
            line,
        )
        self.told: list[dict[str, Any]] = []
        self.thread = threading.Thread(target=shell._make(self.room))
        self.thread.start()

    def facts(self, key: str) -> list[Any]:
        while True:
            try:
                self.told.append(json.loads(self.supervisor.recv(65536)))
            except BlockingIOError:
                return [t[key] for t in self.told if key in t]

    def say(self, *messages: Any) -> None:
        codec = Codec(1, 1)
        self.tools.sendto(b"".join(codec.pack(m) for m in messages), (HOST, 24001))

    def close(self) -> None:
        self.room.stopping = True
        self.thread.join(30.0)
        assert not self.thread.is_alive()
        self.server.close()
        for s in (self.tools, self.panic, self.supervisor):
            s.close()


def _bound(port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((HOST, port))
    made.setblocking(False)
    return made


def heard(s: socket.socket) -> list[Any]:
    found: list[Any] = []
    while True:
        try:
            found += Codec(0, 0).parse(s.recv(2048))
        except BlockingIOError:
            return found


@pytest.fixture
def bench() -> Iterator[Bench]:
    with tempfile.TemporaryDirectory(prefix="arena-") as folder:
        made = Bench(Path(folder))
        yield made
        made.close()


FLYING = (
    mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3),
    mavlink.MAVLink_extended_sys_state_message(0, 2),
)


def test_process_is_ready_and_stops_while_time_stands_still(bench: Bench) -> None:
    assert any(m.get_srcSystem() == 251 for m in until(lambda: heard(bench.tools)))
    assert bench.facts("ready") == []
    bench.say(*FLYING)
    assert until(lambda: bench.facts("ready")) == [True]
    assert bench.server._page[0] == 5.0


def test_order_is_sent_to_router_and_panic_link(bench: Bench) -> None:
    until(lambda: heard(bench.tools))
    bench.say(*FLYING, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0))
    until(lambda: bench.facts("ready"))
    now = 5.0

    def ordered(s: socket.socket) -> bool:
        nonlocal now
        now += 0.02
        bench.server.tick(now)
        return any(
            m.get_type() == "COMMAND_LONG" and m.command == mavlink.MAV_CMD_DO_SET_MODE for m in heard(s)
        )

    assert until(lambda: ordered(bench.panic)) and until(lambda: ordered(bench.tools))
    assert until(lambda: bench.facts("event"))[0].startswith("uav1: land: battery: its battery is at 3 %")
