"""The process `world`, with stub autopilots: it serves, keeps its pace under a flood, and leaves nothing
behind.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from sim_slices import slice_of, vehicle

from arena.clock import SimClock
from arena.fault_injection import inject
from arena.wire.truth_page import TruthReader

HOST = "127.55.3.1"
STUB = Path(__file__).with_name("stub_world.py")
DEADLINE_S = 60.0


class Run:
    """A world process, this test its supervisor. line: None once `orphan` has closed it."""

    def __init__(self, folder, changes):
        self.partner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.partner.bind((HOST, 0))
        self.partner.settimeout(DEADLINE_S)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((HOST, 0))
            self.local = probe.getsockname()
        self.folder = Path(folder)
        link = {"local": list(self.local), "remote": list(self.partner.getsockname())}
        flown = vehicle(links={"router": link}, position=changes.pop("position", [0, 0, 0]))
        made = {"clock": f"{folder}/clock", "truth": f"{folder}/truth", **changes}
        (self.folder / "slice.json").write_text(json.dumps(slice_of(flown, **made)))
        self.line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.line.settimeout(DEADLINE_S)
        self.child = subprocess.Popen(
            [sys.executable, str(STUB), str(self.folder / "slice.json")],
            pass_fds=[theirs.fileno()],
            env={**os.environ, "ARENA_FD": str(theirs.fileno())},
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        theirs.close()

    def told(self, key, unless=lambda value: False):
        """The next value of `key` that the world tells (ready, stats, event), skipping those `unless`
        refuses.
        """
        until = time.monotonic() + DEADLINE_S
        while time.monotonic() < until:
            packet = json.loads(self.line.recv(1 << 18) or b'{"end": true}')
            assert "end" not in packet, f"the world ended: {self.child.stderr.read()}"
            if key in packet and not unless(packet[key]):
                return packet[key]
        raise AssertionError(f"the world did not tell {key}")

    def left(self):
        return sorted(path.name for path in self.folder.iterdir() if path.name != "slice.json")

    def end(self):
        self.child.kill()
        self.child.wait(DEADLINE_S)
        self.child.stderr.close()
        self.partner.close()
        self.line.close()


@contextlib.contextmanager
def running(**changes):
    # Not tmp_path: the paths of local sockets are short.
    with tempfile.TemporaryDirectory(prefix="w5-") as folder:
        run = Run(folder, changes)
        try:
            yield run
        finally:
            run.end()


@pytest.mark.parametrize("outside", [False, True])
def test_ready_means_that_truth_time_and_links_are_served(outside):
    with running(stub_outside=outside) as run:
        run.told("ready")
        clock = SimClock(run.folder / "clock", "a test")
        woken = clock.sleep_until(clock.now() + 0.1)
        truth = TruthReader(run.folder / "truth").newest()
        assert truth.time_s >= woken > 0.0
        assert truth.p_n[0] == pytest.approx([0, 0, -0.05], abs=1e-3)
        run.partner.sendto(b"hello", run.local)
        assert run.partner.recv(100) == b"hello"
        clock.close()


def test_sigterm_ends_it_at_once_with_nothing_left():
    with running() as run:
        run.told("ready")
        run.child.terminate()
        assert run.child.wait(30) == 0
        assert run.left() == []
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
            again.bind(run.local)


def test_a_flood_on_a_link_does_not_stall_the_world():
    with running() as run:
        run.told("ready")
        run.partner.setblocking(False)
        until, before = time.monotonic() + 2.2, 0
        while time.monotonic() < until:
            with contextlib.suppress(BlockingIOError):
                run.partner.sendto(b"\xfd" * 300, run.local)
            before += 1
        run.told("stats")
        run.told("stats", lambda stats: stats["links"]["received"] <= 1000 or stats["steps"] <= 300)


def test_stats_have_what_the_summary_needs():
    with running() as run:
        stats = run.told("stats", lambda stats: stats["steps"] < 230)
        assert 0 < stats["rtf"] < 1.1
        assert {
            "lateness_p99_ms",
            "lateness_worst_ms",
            "rtf_min",
            "rtf_max",
            "forgiven",
            "steps",
            "autopilot",
        } <= set(stats)
        assert stats["vehicles"]["uav1"]["crashed"] == ""


def test_a_crash_is_an_event_and_in_the_stats():
    with running(position=[0, 0, -3]) as run:
        assert run.told("event").startswith("uav1 crashed: touched down at 7.")
        assert run.told("stats")["vehicles"]["uav1"]["crashed"].startswith("touched down at 7.")


@pytest.mark.parametrize("outside", [False, True])
def test_at_most_speed_it_runs_far_faster_than_the_wall_clock_and_waits_for_who_sleeps_on_its_clock(outside):
    with running(speed="max", stub_outside=outside) as run:
        run.told("ready")
        clock = SimClock(run.folder / "clock", "slow")
        now = clock.sleep_until(clock.now() + 0.1)  # from its first sleep on, the world waits for it
        for _ in range(50):
            due = now + 0.0079
            now = clock.sleep_until(due)
            assert now == pytest.approx(due, abs=0.0041)
            truth = TruthReader(run.folder / "truth")
            assert (clock.now(), truth.newest().time_s) == (now, now), (
                "lockstep: it waits while this client is awake"
            )
            assert (clock.now(), truth.newest().time_s) == (now, now)
        clock.close()


def test_a_client_that_hangs_in_lockstep_is_struck_off_by_name():
    with running(speed=2.0) as run:
        run.told("ready")
        clock = SimClock(run.folder / "clock", "hung program")
        held = clock.sleep_until(clock.now() + 0.1)
        assert "hung program has not slept" in run.told("event")
        assert clock.sleep_until(held + 0.5) > held
        clock.close()


@pytest.mark.parametrize("outside", [False, True])
def test_a_fault_is_in_force_at_the_next_step_of_a_lockstep_world_and_is_told(outside, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with running(
        speed="max", stub_outside=outside, stub_command=0.7, faults=str(tmp_path / "world.faults")
    ) as run:
        run.told("ready")
        clock, truth = SimClock(run.folder / "clock", "a test"), TruthReader(run.folder / "truth")
        now = clock.sleep_until(clock.now() + 0.1)  # from here on nothing moves while this test is awake
        before = truth.newest()
        for rotor in (1, 2, 3, 4):
            inject("world.faults", {"do": "motor", "vehicle": "uav1", "rotor": rotor, "thrust": 0.0})
        inject("world.faults", {"do": "motor", "vehicle": "uav9", "rotor": 1, "thrust": 0.0})
        assert clock.now() == now
        clock.sleep_until(now + 0.0079)
        climb, fell = before.v_n[0, 2], truth.at(now + 0.004).v_n[0, 2]
        assert before.accel_b[0, 2] < -12.0, "it climbs"
        assert fell - climb == pytest.approx(9.81 * 0.004, rel=0.05), "all of the next step it falls freely"
        told = [run.told("event") for _ in range(5)]
        assert told[0] == "fault: rotor 1 of uav1 gives 0 % of its thrust"
        assert told[4].startswith("fault refused: ") and told[4].endswith(
            'vehicle: got "uav9", expected one of uav1'
        )
        clock.sleep_until(now + 0.1)
        clock.close()
        run.child.terminate()
        assert run.child.wait(DEADLINE_S) == 0
        assert not (tmp_path / "world.faults").exists()


def test_without_its_supervisor_it_ends_once_all_are_disarmed():
    with running() as run:
        run.told("ready")
        run.line.close()
        assert run.child.wait(10.0) == 0
        assert run.left() == []


def test_without_its_supervisor_it_serves_while_a_vehicle_is_armed():
    with running(stub_armed=True) as run:
        run.told("ready")
        clock = SimClock(run.folder / "clock", "a test")
        run.line.close()
        clock.sleep_until(clock.now() + 3.5)
        assert run.child.poll() is None
        run.partner.sendto(b"still there?", run.local)
        assert run.partner.recv(100) == b"still there?"
        clock.close()


def test_an_error_is_one_sentence_and_exit_code_two():
    with running(physics_hz=600) as run:
        assert run.child.wait(DEADLINE_S) == 2
        said = run.child.stderr.read()
        assert said.startswith("arena world: physics_hz: got 600") and said.count("\n") == 1
        assert run.left() == []


def test_a_port_in_use_leaves_nothing_behind():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken,
        tempfile.TemporaryDirectory(prefix="w5-") as folder,
    ):
        taken.bind((HOST, 0))
        address = list(taken.getsockname())
        made = slice_of(
            vehicle(links={"router": {"local": address, "remote": address}}),
            clock=f"{folder}/c",
            truth=f"{folder}/t",
        )
        Path(folder, "slice.json").write_text(json.dumps(made))
        done = subprocess.run(
            [sys.executable, str(STUB), f"{folder}/slice.json"],
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
        assert done.returncode == 1
        assert "uav1: router link: cannot bind" in done.stderr
        assert [path.name for path in Path(folder).iterdir()] == ["slice.json"]


def test_a_clock_that_cannot_be_served_is_one_sentence():
    with running(clock="/nonexistent/" + "x" * 120) as run:
        assert run.child.wait(DEADLINE_S) == 1
        said = run.child.stderr.read()
        assert said.startswith("arena world: cannot serve truth at") and said.count("\n") == 1
        assert run.left() == []


def test_a_slice_with_a_field_missing_is_one_sentence():
    with running(vehicles=[{"name": "uav1", "id": 1}]) as run:
        assert run.child.wait(DEADLINE_S) == 2
        assert "'profile' is missing" in run.child.stderr.read()


@pytest.mark.parametrize("outside", [False, True])
def test_more_faults_at_one_instant_than_a_socket_holds_are_all_taken(outside, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with running(speed=100, stub_outside=outside, faults=str(tmp_path / "world.faults")) as run:
        run.told("ready")
        clock = SimClock(run.folder / "clock", "a test")
        now = clock.sleep_until(clock.now() + 0.1)
        for k in range(100):
            inject("world.faults", {"do": "wind", "wind_m_s": [0.1 * k, 0, 0]})
        clock.sleep_until(now + 0.1)
        told = [run.told("event", unless=lambda text: not text.startswith("fault: ")) for _ in range(100)]
        assert told[99] == "fault: wind 9.9 0 0 m/s"
        clock.close()
