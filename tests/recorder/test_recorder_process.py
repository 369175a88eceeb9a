"""The recorder as a process: what it receives and writes, and when it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from recorded_flights import OFFBOARD, STEPS, stream, truth_at

from arena.clock_server import ClockServer
from arena.flight_log.recording import Recording
from arena.process_context import SOCKET_VARIABLE
from arena.wire.truth_page import TruthWriter
from tests.kernel_stamps import kernel_stamps  # noqa: F401 - a fixture of this module
from tests.recorder.test_flight_recorder import SETTINGS

HOST, STRANGER = "127.56.5.1", "127.56.5.2"
DEADLINE_S = 30.0


def udp(host: str = HOST) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((host, 0))
    return opened


def reference(system: int) -> bytes:
    codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=191)
    return bytes(mavlink.MAVLink_position_target_local_ned_message(5, 1, 0, *[1.0] * 9, 0.0, 0.0).pack(codec))


def message(number: int, *, armed: bool = False) -> bytes:
    return stream(1.0 + 0.01 * number, np.zeros(3), STEPS[0], OFFBOARD, armed, True)


class Running:
    """A recorder process with its supervisor socket, and the router's sockets for two vehicles."""

    def __init__(self, folder: Path, **more: Any) -> None:
        with udp() as probe:
            self.to = probe.getsockname()
        self.serve, self.tools = [udp(), udp()], [udp(), udp()]
        vehicles = [
            {**v, "serve": s.getsockname(), "tools": t.getsockname()}
            for v, s, t in zip(SETTINGS["vehicles"], self.serve, self.tools, strict=True)
        ]
        own = {"vehicles": vehicles, "listen": self.to, "folder": str(folder), "clock": None}
        settings = {**SETTINGS, **own, "captures": [], "truth": None, "rate_hz": 30.0, **more}
        (folder / "slice.json").write_text(json.dumps(settings))
        self.line, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.line.settimeout(DEADLINE_S)
        self.stats: dict[str, Any] = {}
        self.events: list[str] = []
        self.path = folder / "flight.mcap"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "arena.recorder", str(folder / "slice.json")],
            env={**os.environ, SOCKET_VARIABLE: str(child.fileno())},
            pass_fds=[child.fileno()],
        )
        child.close()
        self.wait_for(lambda packet: packet.get("ready", False))

    def wait_for(self, condition: Any) -> None:
        """Read packets to the supervisor until `condition` is true for one."""
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            data = self.line.recv(1 << 16)
            assert data, "the recorder has ended"
            packet = json.loads(data)
            self.stats |= packet.get("stats", {})
            self.events += [packet["event"]] if "event" in packet else []
            if condition(packet):
                return
        raise AssertionError("the packet did not come")

    def wait_for_rate(self, vehicle: str, key: str) -> None:
        self.wait_for(lambda packet: "stats" in packet and packet["stats"]["vehicles"][vehicle][key] > 0)

    def end(self) -> Recording:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(DEADLINE_S) == 0
        return Recording(self.path)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(DEADLINE_S)
        for opened in (self.line, *self.serve, *self.tools):
            opened.close()


@pytest.fixture
def start(tmp_path):
    running: list[Running] = []

    def begin(**more: Any) -> Running:
        running.append(Running(tmp_path, **more))
        return running[-1]

    yield begin
    for one in running:
        one.close()


def test_vehicle_and_direction_follow_from_the_senders_address(start):
    recorder = start()
    for i in range(50):
        recorder.serve[0].sendto(b"down1 %d" % i, recorder.to)
        recorder.tools[1].sendto(b"up2 %d" % i, recorder.to)
    record = recorder.end()
    assert [(d.up, d.data) for d in record.datagrams("uav1")] == [(False, b"down1 %d" % i) for i in range(50)]
    assert [(d.up, d.data) for d in record.datagrams("uav2")] == [(True, b"up2 %d" % i) for i in range(50)]


def test_reference_of_a_program_belongs_to_its_vehicle_and_strangers_are_counted(start):
    recorder = start()
    with udp(STRANGER) as stranger:
        for data in (reference(2), reference(9), b"noise", message(1), reference(1) + b"x"):
            stranger.sendto(data, recorder.to)
        recorder.serve[0].sendto(message(2), recorder.to)
        recorder.wait_for(lambda packet: packet.get("stats", {}).get("unknown_datagrams", 0) == 4)
    record = recorder.end()
    assert [(d.up, d.data) for d in record.datagrams("uav2")] == [(True, reference(2))]
    assert [d.data for d in record.datagrams("uav1")] == [message(2)]


def test_stamps_are_those_of_arrival_not_of_reading(start):
    recorder = start()
    recorder.process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, recorder.process.pid, os.WSTOPPED | os.WNOWAIT)
    began = time.time()
    for i in range(10):
        recorder.serve[0].sendto(b"%d" % i, recorder.to)
    sent = time.time()
    end = time.monotonic() + 0.3
    while time.monotonic() < end:  # the datagrams wait in the socket
        os.sched_yield()
    recorder.process.send_signal(signal.SIGCONT)
    found = [d.time_s for d in recorder.end().datagrams("uav1")]
    assert len(found) == 10
    assert all(began - 0.02 <= time_s <= sent + 0.02 for time_s in found)


def test_datagrams_that_wait_at_the_end_are_recorded(start):
    recorder = start()
    recorder.process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, recorder.process.pid, os.WSTOPPED | os.WNOWAIT)
    for i in range(700):  # fits into the socket also with the kernel's default limits
        recorder.serve[0].sendto(b"%d" % i, recorder.to)
    recorder.process.send_signal(signal.SIGTERM)
    recorder.process.send_signal(signal.SIGCONT)
    assert recorder.process.wait(DEADLINE_S) == 0
    found = list(Recording(recorder.path).datagrams("uav1"))
    recorder.wait_for(lambda packet: "stats" in packet)
    assert len(found) == 700 - recorder.stats["lost_datagrams"]
    assert len(found) > 100


def test_overflow_of_the_socket_is_counted(start):
    recorder = start()
    recorder.process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, recorder.process.pid, os.WSTOPPED | os.WNOWAIT)
    sent = 60_000  # more than fit into the socket
    for _ in range(sent):
        recorder.serve[0].sendto(b"x" * 1000, recorder.to)
    recorder.process.send_signal(signal.SIGCONT)
    recorder.wait_for(lambda packet: packet.get("stats", {}).get("lost_datagrams", 0) > 0)
    record = recorder.end()
    assert len(list(record.datagrams("uav1"))) == sent - recorder.stats["lost_datagrams"]


def test_simulated_vehicles_are_recorded_in_simulation_time_with_their_true_state(start, tmp_path):
    server = ClockServer(tmp_path / "clock", lockstep=True)
    page, now = TruthWriter(tmp_path / "truth", 1, period_s=0.004), 0.0
    server.tick(now)
    page.write(truth_at(np.zeros(3), np.zeros(3)))
    recorder = start(clock=str(tmp_path / "clock"), truth=str(tmp_path / "truth"), rate_hz=50.0)
    end = time.monotonic() + DEADLINE_S
    while now < 2.0:
        assert time.monotonic() < end
        server.poll(0.01)
        while server.may_advance(now, time.monotonic()) and server.joined and now < 2.0:
            now = round(now + 0.004, 6)
            state = truth_at(np.array([now, 0.0, -1.0]), np.zeros(3))
            page.write(state._replace(time_s=now))
            recorder.serve[0].sendto(b"%.3f" % now, recorder.to)
            server.tick(now)
    recorder.wait_for_rate("uav1", "datagrams_hz")
    record = recorder.end()
    delays = [d.time_s - float(d.data) for d in record.datagrams("uav1")]
    assert len(delays) == 500
    assert all(-0.0201 <= delay <= 0.0201 for delay in delays)
    found = record.truth("uav1")
    assert found.t.tolist() == [k / 50.0 for k in range(round(found.t[0] * 50), 101)]
    np.testing.assert_allclose(found.p_n[1:, 0], found.t[1:], atol=1e-9)


def test_orphaned_recorder_ends_when_the_vehicles_are_disarmed(start):
    recorder = start()
    recorder.serve[0].sendto(message(1, armed=True), recorder.to)
    recorder.wait_for(lambda packet: "stats" in packet)
    recorder.line.close()
    with pytest.raises(subprocess.TimeoutExpired):
        recorder.process.wait(3.5)
    recorder.serve[0].sendto(message(2, armed=False), recorder.to)
    assert recorder.process.wait(DEADLINE_S) == 0
    assert len(list(Recording(recorder.path).datagrams("uav1"))) == 2


def test_recorder_that_is_started_again_continues_the_record(start):
    first = start()
    first.serve[0].sendto(b"before", first.to)
    for _ in range(2):  # the first may have been sent before the datagram arrived
        first.wait_for(lambda packet: "stats" in packet)
    first.close()
    second = start()
    second.serve[0].sendto(b"after", second.to)
    record = second.end()
    assert [d.data for d in record.datagrams("uav1")] == [b"before", b"after"]


def test_taken_port_is_one_line_and_exit_1(start, tmp_path):
    recorder = start()
    argv = [sys.executable, "-m", "arena.recorder", str(tmp_path / "slice.json")]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(
        f"recorder: the recorder cannot listen on UDP {recorder.to[0]}:{recorder.to[1]}: "
    )
