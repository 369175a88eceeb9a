"""The logger as a process: what it receives, writes and reports, and when it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arena.clock import ClockServer
from arena.process_context import SOCKET_VARIABLE
from arena.wire.truth_page import TruthWriter

from .synthetic import OFFBOARD, STEPS, stream, truth_at

HERE, THERE = ("127.56.4.1", 0), ("127.56.4.2", 0)


class Running:
    """A logger process with its supervisor socket, and a socket that sends as its vehicle."""

    def __init__(self, folder: Path, **more: object) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(THERE)
            self.to = probe.getsockname()
        settings = {
            "name": "logger.uav1",
            "vehicle": "uav1",
            "id": 1,
            "body": "uav1",
            "index": 0,
            "listen": list(self.to),
            "capture": None,
            "truth": None,
            "clock": None,
            "rate_hz": 30,
            "folder": str(folder / "csv"),
            "simulated": True,
            **more,
        }
        (folder / "slice.json").write_text(json.dumps(settings))
        self.line, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.line.settimeout(10)
        env = {**os.environ, SOCKET_VARIABLE: str(child.fileno())}
        argv = [sys.executable, "-m", "arena.recorder", str(folder / "slice.json")]
        self.process = subprocess.Popen(argv, env=env, pass_fds=[child.fileno()])
        child.close()
        self.vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.vehicle.bind(HERE)
        self.csv = folder / "csv" / "uav1.csv"
        assert json.loads(self.line.recv(4096)) == {"entered": True}
        assert json.loads(self.line.recv(4096))["ready"] is True

    def rows(self) -> list[list[str]]:
        return [line.split(",") for line in self.csv.read_text().splitlines()]

    def send_until_rows(self, count: int, step=lambda t: None, armed: bool = True) -> None:
        end = time.monotonic() + 10
        t = 1.0
        while len(self.rows()) <= count:
            assert time.monotonic() < end, "no rows came"
            t += 0.004
            step(t)
            self.vehicle.sendto(stream(t, np.zeros(3), STEPS[0], OFFBOARD, armed, False), self.to)
            self.process.poll()
            time.sleep(0.004)  # the vehicle's own pace, not a wait for something

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(30)
        self.line.close()
        self.vehicle.close()


@pytest.fixture
def start(tmp_path):
    running: list[Running] = []

    def begin(**more: object) -> Running:
        running.append(Running(tmp_path, **more))
        return running[-1]

    yield begin
    for one in running:
        one.close()


def test_log_begins_with_the_first_message_and_ends_on_sigterm(start):
    logger = start()
    assert len(logger.rows()) == 1  # the header
    logger.send_until_rows(20)
    logger.process.send_signal(signal.SIGTERM)
    assert logger.process.wait(30) == 0
    rows = logger.rows()
    assert {len(row) for row in rows} == {len(rows[0])}
    stamps = np.array([float(row[0]) for row in rows[1:]])
    assert np.median(np.diff(stamps)) == pytest.approx(1 / 30, abs=0.004)
    assert abs(stamps[-1] - time.time()) < 60  # of a real vehicle: unix time
    stats = [json.loads(p)["stats"] for p in iter_packets(logger) if b"stats" in p]
    assert stats[-1]["rows"] == len(rows) - 1


def test_log_of_a_killed_logger_is_continued_after_its_last_row(start):
    first = start()
    first.send_until_rows(5)
    first.close()
    with first.csv.open("a") as file:
        file.write("1.0,half a ro")
    before = first.csv.read_text().rpartition("\n")[0].splitlines()
    second = start()
    second.send_until_rows(len(before) + 5)
    second.process.send_signal(signal.SIGTERM)
    assert second.process.wait(30) == 0
    rows = second.csv.read_text().splitlines()
    assert rows[: len(before)] == before and len({len(row.split(",")) for row in rows}) == 1
    assert rows.count(rows[0]) == 1, "one header"


def iter_packets(logger: Running):
    while packet := logger.line.recv(4096):
        yield packet


def test_simulated_vehicle_is_logged_in_simulation_time_with_truth(start, tmp_path):
    clock, truth = ClockServer(tmp_path / "clock"), TruthWriter(tmp_path / "truth", 1, period_s=0.004)

    def step(t: float) -> None:
        truth.write(replace(truth_at(np.array([0.0, 0.0, -t]), np.zeros(3)), time_s=t))
        clock.tick(t)

    step(1.0)
    try:
        logger = start(clock=str(tmp_path / "clock"), truth=str(tmp_path / "truth"))
        logger.send_until_rows(20, step)
    finally:
        clock.close()
    assert logger.process.wait(30) == 0  # the world has ended, and the log with it
    header, *rows = logger.rows()
    column = {name: i for i, name in enumerate(header)}
    first, last = float(rows[0][0]), float(rows[-1][0])
    assert 1.0 < first < last < 60.0
    assert float(rows[-1][column["truth.pos.down"]]) == pytest.approx(-last, abs=0.05)
    # The last rows have no later estimate: nothing to interpolate to.
    assert float(rows[-5][column["err.pos.north"]]) == pytest.approx(0.01, abs=1e-4)
    events = [json.loads(p)["event"] for p in iter_packets(logger) if b'"event"' in p]
    assert events[0] == "uav1: airborne"


def test_silent_capture_server_of_a_real_vehicle_is_reported(start):
    silent = {
        "kind": "natnet",
        "server": "127.73.4.1",
        "local": None,
        "group": "239.243.73.4",
        "transport": "multicast",
    }
    logger = start(
        index=None,
        simulated=False,
        capture={**silent, "command_port": 9, "data_port": 9711, "bodies": ["uav1"]},
    )
    logger.send_until_rows(20)
    header, *rows = logger.rows()
    assert not [name for name in header if name.startswith(("truth", "err"))]
    assert {row[header.index("mocap.pos.north")] for row in rows} == {""}
    assert {row[header.index("info.flight_mode")] for row in rows} == {"OFFBOARD"}
    events = (json.loads(p)["event"] for p in iter_packets(logger) if b'"event"' in p)
    assert [next(events), next(events)[:47]] == [
        "uav1: airborne",
        "motion capture: no answer from 127.73.4.1:9 (re",
    ]


def test_orphaned_logger_ends_when_the_vehicle_is_disarmed(start):
    logger = start()
    logger.send_until_rows(2, armed=False)
    logger.line.close()
    assert logger.process.wait(30) == 0


def test_taken_port_is_one_line_and_exit_1(start, tmp_path):
    logger = start()
    settings = {**json.loads((tmp_path / "slice.json").read_text())}
    (tmp_path / "other.json").write_text(json.dumps({**settings, "folder": str(tmp_path / "other")}))
    argv = [sys.executable, "-m", "arena.recorder", str(tmp_path / "other.json")]
    second = subprocess.run(argv, capture_output=True, text=True, timeout=120, check=False)
    assert second.returncode == 1
    assert (
        second.stderr
        == f"logger: cannot listen on UDP {logger.to[0]}:{logger.to[1]}: Address already in use. Does another program use this port?\n"
    )
    assert logger.process.poll() is None
