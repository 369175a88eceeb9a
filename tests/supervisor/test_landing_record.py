"""Landings that `land-all` has recorded: a process that missed the command gets them from the supervisor."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import threading
import time
from types import SimpleNamespace

import pytest

from arena.authority import Authority
from arena.emergency.run_record import record_command
from arena.errors import RunError
from arena.plan.model import Restart
from arena.supervisor.child_process import Child
from arena.supervisor.landing_record import LandingRecord
from arena.supervisor.missed_landings import MissedLandings
from arena.supervisor.process_state import ProcessStatus, State
from arena.supervisor.release_task import ReleaseTask

from .conftest import eventually, plan_of, spec, vehicle
from .test_release import BLOCKED, FREE, release

RESTORE = '{"do": "restore", "vehicle": "uav1", "standing": {"latch": [4, %d]}}'
LANDING, STOP = RESTORE % 3, RESTORE % 4


def router(facts=BLOCKED, **changes):
    given = {"kind": "router", "restart": Restart(mode="on_failure", backoff_s=0.05), **changes}
    return spec("router", "prints_requests", json.dumps(facts), **given)


def end(run):
    run.signal(signal.SIGTERM)
    run.wait()


def test_router_that_starts_after_land_all_gets_the_landing(start, tmp_path):
    late = spec("late", "good", ready="file", ready_value=str(tmp_path / "go"))
    run = start(plan_of(late, router(needs=("late",)), vehicles=(vehicle(),)))
    run.until("late", "STARTING")
    record_command(run.folder, "land-all", ["uav1", "somebody"])
    (tmp_path / "go").touch()
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    end(run)


def test_starting_router_gets_landing_and_motor_stop(start, tmp_path):
    run = start(plan_of(router(ready="file", ready_value=str(tmp_path / "go")), vehicles=(vehicle(),)))
    run.until("router", "STARTING")
    record_command(run.folder, "land-all", ["uav1"])
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    with (run.folder / "emergency.jsonl").open("a") as file:
        file.write('[]\n{"mono": "1", "command": "land-all", "vehicles": ["uav1"]}\nno JSON\n')
    record_command(run.folder, "kill-all", ["uav1"])
    eventually(lambda: STOP in run.log("router"), what="the stop of the motors, in the log of the router")
    assert run.log("router").count(LANDING) == 1
    end(run)


def test_killed_router_gets_the_landing_after_its_restart(start):
    run = start(plan_of(router(), vehicles=(vehicle(),)))
    ready_at = run.until("router", "READY")["mono"]
    eventually(lambda: time.monotonic() > ready_at + 1.5, what="the router has been ready for 1.5 s")
    record_command(run.folder, "land-all", ["uav1"])
    os.kill(run.pid("router"), signal.SIGKILL)
    run.until("router", "READY", times=2)
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    end(run)


def test_landing_that_is_only_recorded_can_be_released(start, tmp_path):
    starts = {"ready": "file", "ready_value": str(tmp_path / "go")}
    run = start(plan_of(router(facts=FREE, **starts), vehicles=(vehicle(),)))
    eventually(lambda: "uav1.control" in run.control().ask(do="ps")["facts"])
    record_command(run.folder, "land-all", ["uav1"])
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    done = release(run)
    assert done.returncode == 0, done.stderr
    (tmp_path / "go").touch()
    run.until("router", "READY")
    os.kill(run.pid("router"), signal.SIGKILL)
    run.until("router", "READY", times=2)
    end(run)
    assert run.log("router").count(LANDING) == 1, "the released landing is not restored"


def test_router_that_was_ready_gets_no_landing_after_its_restart(start, tmp_path):
    """It has refused the landing, because a pilot had control. The pilot then starts the program, and the router restarts."""
    late = {"ready": "file", "ready_value": str(tmp_path / "go")}
    link = spec("link.uav2", "prints_requests", "{}", kind="link", vehicle="uav2", **late)
    vehicles = (vehicle(simulated=False), vehicle("uav2", simulated=False))
    run = start(plan_of(router(facts=FREE), link, vehicles=vehicles))
    run.until("router", "READY")
    run.until("link.uav2", "STARTING")
    record_command(run.folder, "land-all", ["uav1", "uav2"])
    eventually(lambda: LANDING.replace("uav1", "uav2") in run.log("link.uav2"), what="the record was read")
    os.kill(run.pid("router"), signal.SIGKILL)
    run.until("router", "READY", times=2)
    end(run)
    assert "restore" not in run.log("router")


# without processes


class Files:
    """Executes the jobs of a BackgroundWriter at once."""

    def submit(self, job, *, replaces=""):
        job()


class Receiver:
    """A running process that keeps its requests."""

    def __init__(self):
        self.got = []

    def send(self, packet, *, keep=False):
        self.got.append(packet)
        return True


class Rig:
    """LandingRecord of a router and a hardware link that become ready at 10 s. `now` is the time [s]."""

    def __init__(self, folder, **of_vehicle):
        specs = (router(), spec("link.uav1", "good", kind="link", vehicle="uav1"))
        plan = plan_of(*specs, vehicles=(vehicle(**of_vehicle),))
        names = [s.name for s in specs]
        self.processes = SimpleNamespace(
            plan=plan,
            specs={s.name: s for s in specs},
            statuses=dict.fromkeys(names, ProcessStatus(state=State.READY, since=10.0)),
            children={name: Receiver() for name in names},
            **{name: {} for name in ("facts", "last_facts", "stats", "confirmed")},
            missed=MissedLandings(),
            request=lambda packet, to: [self.processes.children[name].send(packet) for name in to],
        )
        self.file = folder / "emergency.jsonl"
        self.release = ReleaseTask(plan, self.processes)
        self.landings = LandingRecord(folder, self.processes, self.release, Files())
        self.now = 20.0

    def record(self, at, command="land-all"):
        record_command(self.file.parent, command, ["uav1"], at)

    def step(self):
        self.now += 1.0
        self.release.step(self.now)
        self.landings.step(self.now)

    def got(self, name="router"):
        """Return the strength of each landing that a process has received."""
        requests = self.processes.children[name].got
        return [r["standing"]["latch"][1] for r in requests if r["do"] == "restore"]

    def begin_release(self):
        self.release.begin(["uav1"], "ada", self.now)

    def confirm(self, name):
        (packet,) = (r for r in self.processes.children[name].got if r["do"] == "release")
        self.processes.confirmed[name] = packet["id"]
        self.step()


def test_only_processes_that_were_not_ready_get_the_landing(tmp_path):
    rig = Rig(tmp_path)
    rig.processes.statuses["router"] = ProcessStatus(state=State.READY, since=15.0)
    rig.record(at=12.0)
    rig.step()
    assert (rig.got("router"), rig.got("link.uav1")) == ([3], [])
    assert rig.processes.missed.requests("router") and not rig.processes.missed.requests("link.uav1")
    rig.processes.statuses["link.uav1"] = ProcessStatus(state=State.STARTING, since=30.0)
    rig.step()
    assert rig.got("link.uav1") == [], "an old record is not considered again"


@pytest.mark.parametrize("state", [{"state": State.BACKOFF}, {"state": State.READY, "stopped_at": 11.0}])
def test_ended_or_paused_process_may_have_missed_the_landing(tmp_path, state):
    rig = Rig(tmp_path)
    rig.processes.statuses["router"] = ProcessStatus(since=10.0, **state)
    rig.record(at=12.0)
    rig.step()
    assert rig.processes.missed.vehicles == {"uav1"}


@pytest.mark.parametrize(
    ("simulated", "facts", "last_facts", "sent"),
    [
        (False, {"uav1.standing_at_link": {"pilot": True}}, {}, False),
        (False, {}, {"uav1.standing": {"pilot": True}}, False),
        (False, {"uav1.standing_at_link": {}}, {"uav1.standing": {"pilot": True}}, True),
        (True, {"uav1.standing": {"pilot": True}}, {}, True),
    ],
    ids=["pilot", "pilot before the restart", "pilot has left", "simulated"],
)
def test_landing_that_is_refused_for_a_pilot_is_not_sent(tmp_path, simulated, facts, last_facts, sent):
    rig = Rig(tmp_path, simulated=simulated)
    rig.processes.facts, rig.processes.last_facts = facts, last_facts
    rig.processes.statuses["router"] = ProcessStatus(state=State.STARTING, since=10.0)
    rig.record(at=12.0)
    rig.step()
    assert bool(rig.got()) is sent


def missing_router(folder):
    rig = Rig(folder)
    rig.processes.statuses["router"] = ProcessStatus(state=State.STARTING, since=10.0)
    return rig


def test_landing_is_not_sent_during_a_release(tmp_path):
    rig = missing_router(tmp_path)
    rig.begin_release()
    rig.record(at=12.0)
    rig.step()
    assert rig.got() == [] and rig.release.in_progress("uav1")
    rig.confirm("link.uav1")
    rig.confirm("router")
    rig.step()
    assert rig.got() == [] and rig.processes.missed.vehicles == set()
    rig.record(at=12.0)
    rig.step()
    assert rig.got() == [], "a record of a landing before the release is ignored"


@pytest.mark.parametrize("success", [True, False])
def test_landing_after_the_begin_of_a_release_stays(tmp_path, success):
    rig = missing_router(tmp_path)
    rig.begin_release()
    rig.record(at=rig.now + 0.5)
    rig.step()
    rig.confirm("link.uav1")
    if success:
        rig.confirm("router")
    else:
        rig.step()
        rig.step()
    assert not rig.release.in_progress("uav1") and rig.release.results["uav1"] == (
        [] if success else ["router"]
    )
    rig.step()
    assert rig.got() == [3] and rig.processes.missed.vehicles == {"uav1"}


@pytest.mark.parametrize("read", ["during the release", "after the release"])
def test_landing_during_a_release_is_sent_to_all_processes_after_it(tmp_path, read):
    """A ready router latches the landing, then receives the release, which ends the latch."""
    rig = Rig(tmp_path)
    rig.begin_release()
    landing_at = rig.now + 0.5
    if read == "during the release":
        rig.record(landing_at)
    rig.confirm("link.uav1")
    assert (rig.got("router"), rig.got("link.uav1")) == ([], [])
    rig.confirm("router")
    if read == "after the release":
        rig.record(landing_at)
    rig.step()
    assert (rig.got("router"), rig.got("link.uav1")) == ([3], [3])


def test_landing_after_a_release_is_not_sent_to_processes_that_were_ready(tmp_path):
    rig = Rig(tmp_path)
    rig.begin_release()
    rig.confirm("link.uav1")
    rig.confirm("router")
    rig.record(at=rig.now + 0.5)
    rig.step()
    assert (rig.got("router"), rig.got("link.uav1")) == ([], [])


def test_second_release_ends_a_landing_during_the_first(tmp_path):
    rig = Rig(tmp_path)
    rig.begin_release()
    rig.record(at=rig.now + 0.5)
    rig.confirm("link.uav1")
    rig.confirm("router")
    rig.processes.facts |= {"uav1.control": "land-all", "uav1.blocked": "land-all has control"}
    for child in rig.processes.children.values():
        child.got.clear()
    rig.begin_release()
    rig.confirm("link.uav1")
    rig.confirm("router")
    rig.step()
    assert rig.release.results == {"uav1": []} and rig.processes.missed.vehicles == set()
    assert (rig.got("router"), rig.got("link.uav1")) == ([], [])


def test_motor_stop_stays_latched_after_a_later_landing(tmp_path):
    rig = missing_router(tmp_path)
    for at, command in ((12.0, "kill-all"), (13.0, "land-all")):
        rig.record(at, command)
        rig.step()
    authority = Authority(simulated=True)
    for request in rig.processes.missed.requests("router"):
        authority.restore(request["standing"], 20.0)
    assert authority.standing == {"latch": [4, 4]}


MALFORMED = [
    '{"mono": 1%s, "command": "land-all", "vehicles": ["uav1"]}' % ("0" * 400),
    '{"mono": NaN, "command": "land-all", "vehicles": ["uav1"]}',
    '{"mono": Infinity, "command": "land-all", "vehicles": ["uav1"]}',
    '{"mono": 12.0, "command": ["land-all"], "vehicles": ["uav1"]}',
    '{"mono": 12.0, "command": "land-all", "vehicles": "uav1"}',
    "[" * 100_000,
    "\x00" * 200_000,
    '{"mono": 12.0, "comm',
]


@pytest.mark.parametrize(
    "line", MALFORMED, ids=["huge", "NaN", "inf", "command", "vehicles", "deep", "long", "torn"]
)
def test_malformed_line_is_skipped_and_the_next_record_is_read(tmp_path, line):
    rig = missing_router(tmp_path)
    rig.file.write_text(line if line.endswith("comm") else f"{line}\n")
    rig.step()
    assert rig.processes.missed.vehicles == set()
    rig.record(at=12.0)
    rig.step()
    assert rig.got() == [3]


def test_landing_with_a_time_in_the_future_can_be_released(tmp_path):
    rig = missing_router(tmp_path)
    rig.record(at=1e9)
    rig.step()
    rig.begin_release()
    rig.confirm("link.uav1")
    rig.confirm("router")
    assert rig.got() == [3] and rig.processes.missed.vehicles == set()


@pytest.mark.parametrize("kind", ["pipe", "link"])
def test_pipe_or_link_in_place_of_the_file_is_not_read(tmp_path, kind):
    rig = missing_router(tmp_path)
    other = tmp_path / "other"
    other.mkdir()
    record_command(other, "land-all", ["uav1"], 12.0)
    if kind == "pipe":
        os.mkfifo(rig.file)
    else:
        rig.file.symlink_to(other / "emergency.jsonl")
    reader = threading.Thread(target=rig.step, daemon=True)
    reader.start()
    reader.join(20.0)
    assert not reader.is_alive() and rig.got() == []


def test_request_that_cannot_be_sent_is_kept_and_sent_before_later_requests(tmp_path):
    ours, process = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, process:
        ours.setblocking(False)
        child = Child(spec=router(), pid=0, start_s=0.0, log=tmp_path / "log", channel=ours)
        while child.send({"do": "operator"}):
            pass
        assert not child.send({"do": "restore"}, keep=True)
        process.recv(65536)
        process.recv(65536)
        assert child.send({"do": "release"})
        process.setblocking(False)
        received = []
        while len(received) < 2 or received[-1] != {"do": "release"}:
            received.append(json.loads(process.recv(65536)))
        assert received[-2:] == [{"do": "restore"}, {"do": "release"}]


def test_kept_request_is_sent_without_a_later_request(start):
    """A router that is paused does not read its requests. Its status socket is full when the landing is sent."""
    run = start(plan_of(router(stopped_for_s=None), vehicles=(vehicle(),)))
    run.until("router", "READY")
    os.kill(run.pid("router"), signal.SIGSTOP)
    eventually(lambda: any("paused by" in e.get("event", "") for e in run.events("router")))
    for _ in range(2000):  # each release is one request
        with contextlib.suppress(RunError):
            run.control().ask(do="release", vehicles=["uav1"], by="a" * 2000)
    record_command(run.folder, "land-all", ["uav1"])
    eventually(lambda: run.control().ask(do="ps")["releases"]["uav1"] == ["router"])
    os.kill(run.pid("router"), signal.SIGCONT)
    eventually(lambda: LANDING in run.log("router"), what="the landing, in the log of the router")
    end(run)
