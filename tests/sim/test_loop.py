"""The process `world` with stub autopilots: what it serves, its pace under a flood, its end."""

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

from arena.clock import SimClock, SimTime
from arena.fault_injection import inject
from arena.wire.truth_page import TruthReader

from .sim_slices import slice_of, vehicle

HOST = "127.55.3.1"
STUB = Path(__file__).with_name("stub_world.py")
DEADLINE_S = 60.0


class Run:
    """A world process with this test as its supervisor. line: None after `orphan` has closed it."""

    def __init__(self, folder, changes):
        self.partner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.partner.bind((HOST, 0))
        self.partner.settimeout(DEADLINE_S)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((HOST, 0))
            self.local = probe.getsockname()
        self.folder = Path(folder)
        link = {"local": list(self.local), "remote": list(self.partner.getsockname())}
        flown = vehicle(
            links={changes.pop("link", "router"): link}, position=changes.pop("position", [0, 0, 0])
        )
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

    def packet(self, key, unless=lambda value: False):
        """Return the next value of `key` that the world sends (ready, stats, event); skip those for which `unless` is true."""
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


@pytest.mark.parametrize("external", [False, True])
def test_ready_means_truth_time_and_links_are_served(external):
    with running(stub_external=external) as run:
        run.packet("ready")
        clock = SimClock(run.folder / "clock", "a test")
        woken = clock.sleep_until(clock.now() + 0.1)
        truth = TruthReader(run.folder / "truth").newest()
        assert truth.time_s >= woken > 0.0
        assert truth.p_n[0] == pytest.approx([0, 0, -0.05], abs=1e-3)
        run.partner.sendto(b"hello", run.local)
        assert run.partner.recv(100) == b"hello"
        clock.close()


def test_sigterm_ends_the_world_and_removes_its_files():
    with running() as run:
        run.packet("ready")
        run.child.terminate()
        assert run.child.wait(30) == 0
        assert run.left() == []
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
            again.bind(run.local)


def test_a_flood_on_a_link_does_not_stall_the_world():
    with running() as run:
        run.packet("ready")
        run.partner.setblocking(False)
        until, before = time.monotonic() + 2.2, 0
        while time.monotonic() < until:
            with contextlib.suppress(BlockingIOError):
                run.partner.sendto(b"\xfd" * 300, run.local)
            before += 1
        run.packet("stats")
        run.packet("stats", lambda stats: stats["links"]["received"] <= 1000 or stats["steps"] <= 300)


def test_stats_have_the_summarys_fields():
    with running() as run:
        stats = run.packet("stats", lambda stats: stats["steps"] < 230)
        assert 0 < stats["rtf"] < 1.1
        assert {
            "lateness_p99_ms",
            "lateness_worst_ms",
            "rtf_min",
            "rtf_max",
            "skipped",
            "steps",
            "autopilot",
        } <= set(stats)
        assert stats["vehicles"]["uav1"]["crashed"] == ""


def test_a_crash_is_an_event_and_in_the_stats():
    with running(position=[0, 0, -3]) as run:
        assert run.packet("event").startswith("uav1 crashed: touched down at 7.")
        assert run.packet("stats")["vehicles"]["uav1"]["crashed"].startswith("touched down at 7.")


@pytest.mark.parametrize("external", [False, True])
def test_speed_max_is_fast_and_waits_for_clock_clients(external):
    with running(speed="max", stub_external=external) as run:
        run.packet("ready")
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


def test_a_hung_clock_client_is_dropped_by_name():
    with running(speed=2.0) as run:
        run.packet("ready")
        clock = SimClock(run.folder / "clock", "hung program")
        held = clock.sleep_until(clock.now() + 0.1)
        assert "hung program has not waited" in run.packet("event")
        assert clock.sleep_until(held + 0.5) > held
        clock.close()


@pytest.mark.parametrize("external", [False, True])
def test_a_fault_acts_at_the_next_step_and_is_an_event(external, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with running(
        speed="max",
        expected=["a test"],  # a fast world would reach the ceiling before this test reads its state
        stub_external=external,
        stub_command=0.7,
        faults=str(tmp_path / "world.faults"),
    ) as run:
        run.packet("ready")
        clock, truth = SimClock(run.folder / "clock", "a test"), TruthReader(run.folder / "truth")
        now = clock.sleep_until(clock.now() + 0.1)  # from here on nothing moves while this test is awake
        before = truth.newest()
        for rotor in (1, 2, 3, 4):
            inject("world.faults", {"do": "motor", "vehicle": "uav1", "rotor": rotor, "thrust": 0.0})
        inject("world.faults", {"do": "motor", "vehicle": "uav9", "rotor": 1, "thrust": 0.0})
        assert clock.now() == now
        # external autopilots compute while time is published: the step that this time belongs to is already under way
        first = now + (0.004 if external else 0.0)
        clock.sleep_until(first + 0.0079)
        climb, fell = truth.at(first).v_n[0, 2], truth.at(first + 0.004).v_n[0, 2]
        assert before.accel_b[0, 2] < -12.0, "it climbs"
        assert fell - climb == pytest.approx(9.81 * 0.004, rel=0.05), "it falls freely during the first step"
        told = [run.packet("event") for _ in range(5)]
        assert told[0] == "fault: rotor 1 of uav1 gives 0 % of its thrust"
        assert told[4].startswith("fault refused: ") and told[4].endswith(
            'vehicle: got "uav9", expected one of uav1'
        )
        clock.sleep_until(now + 0.1)
        clock.close()
        run.child.terminate()
        assert run.child.wait(DEADLINE_S) == 0
        assert not (tmp_path / "world.faults").exists()


def time_begins(run, deadline_s):
    """Return whether simulation time advances by 50 ms within `deadline_s` of wall time."""
    clock, end = SimTime(run.folder / "clock"), time.monotonic() + deadline_s
    begin = clock.now()
    while clock.now() < begin + 0.05:
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def test_world_does_not_wait_for_a_program_that_ended_before_its_first_sleep():
    with running(expected=["uav1", "uav2"], speed="max") as run:
        run.packet("ready")
        assert not time_begins(run, 1.0)
        for program in ("uav1", "uav2"):
            run.line.send(json.dumps({"do": "program_ended", "program": program}).encode())
        assert time_begins(run, 20.0)


def test_world_reports_when_the_last_steps_of_a_repeatable_flight_are_over():
    with running(expected=["uav1"], speed="max") as run:
        run.line.send(json.dumps({"do": "until_done"}).encode())
        assert run.packet("stats", lambda stats: "last_steps" not in stats)["last_steps"] is True
        run.line.send(json.dumps({"do": "program_ended", "program": "uav1"}).encode())
        assert run.packet("stats", lambda stats: "last_steps" not in stats)["last_steps"] is False


def test_a_command_on_a_panic_link_ends_the_wait_for_programs():
    with running(expected=["uav1"], speed="max", link="panic") as run:
        run.packet("ready")
        assert not time_begins(run, 1.0)
        run.partner.sendto(b"land", run.local)
        assert run.partner.recv(100) == b"land"
        assert time_begins(run, 20.0)
        assert "uav1: not waited for, because a command" in run.packet("event")


def test_panic_link_is_served_while_a_client_of_the_clock_is_awake():
    with running(speed="max", link="panic") as run:
        run.packet("ready")
        clock = SimClock(run.folder / "clock", "a test")
        until, answered = time.monotonic() + DEADLINE_S, False
        while not answered and time.monotonic() < until:
            clock.sleep_until(clock.now() + 0.01)
            woken = time.monotonic()
            run.partner.sendto(b"land", run.local)
            answered = run.partner.recv(100) == b"land" and time.monotonic() < woken + 0.9  # it waits for 1 s
        assert answered
        clock.close()


def test_orphaned_world_ends_once_all_are_disarmed():
    with running() as run:
        run.packet("ready")
        run.line.close()
        assert run.child.wait(10.0) == 0
        assert run.left() == []


def test_orphaned_world_runs_while_a_vehicle_is_armed():
    with running(stub_armed=True) as run:
        run.packet("ready")
        clock = SimClock(run.folder / "clock", "a test")
        run.line.close()
        clock.sleep_until(clock.now() + 3.5)
        assert run.child.poll() is None
        run.partner.sendto(b"still there?", run.local)
        assert run.partner.recv(100) == b"still there?"
        clock.close()


def test_an_input_error_is_one_line_and_exit_code_2():
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


def test_a_clock_that_cannot_be_served_is_one_line():
    with running(clock="/nonexistent/" + "x" * 120) as run:
        assert run.child.wait(DEADLINE_S) == 1
        said = run.child.stderr.read()
        assert said.startswith("arena world: cannot publish the true state at") and said.count("\n") == 1
        assert run.left() == []


def test_a_slice_with_a_missing_field_is_one_line():
    with running(vehicles=[{"name": "uav1", "id": 1}]) as run:
        assert run.child.wait(DEADLINE_S) == 2
        assert "'profile' is missing" in run.child.stderr.read()


@pytest.mark.parametrize("external", [False, True])
def test_more_faults_than_the_socket_holds_are_all_applied(external, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with running(speed=100, stub_external=external, faults=str(tmp_path / "world.faults")) as run:
        run.packet("ready")
        clock = SimClock(run.folder / "clock", "a test")
        now = clock.sleep_until(clock.now() + 0.1)
        for k in range(100):
            inject("world.faults", {"do": "wind", "wind_m_s": [0.1 * k, 0, 0]})
        clock.sleep_until(now + 0.1)
        told = [run.packet("event", unless=lambda text: not text.startswith("fault: ")) for _ in range(100)]
        assert told[99] == "fault: wind 9.9 0 0 m/s"
        clock.close()
