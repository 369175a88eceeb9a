"""What a referee sees and does, without an arena: truth and words become a look, deeds become signals and faults."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError, RunError
from arena.fault_injection import FaultReceiver
from arena.plan import Plan, make_plan
from arena.schema import load_arena
from arena.smoke.flying.actions import ActionRunner, faults
from arena.smoke.flying.observation import Eyes
from arena.smoke.flying.run_log import RunLog, Tail
from arena.smoke.flying.session import free_address
from arena.smoke.flying.telemetry_listener import SYSTEM, TelemetryListener
from arena.smoke.language.model import Deed, Place
from arena.smoke.language.vocabulary import DEEDS
from arena.supervisor import RunFolder, proc_fs
from arena.supervisor.run_folder import Member, myself
from arena.wire.telemetry import Heart, Local, Telemetry
from arena.wire.truth_page import Truth

PLACE = Place(file="x", line=1, text="")


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    (tmp_path / "arena.yaml").write_text(
        f"address: {free_address()}\ndefaults: {{autopilot: builtin}}\n"
        "vehicles:\n  uav1: {mocap_body: red}\n  uav2: {start: {position: [2, 0, 0]}, mocap_body: blue}\n"
    )
    return make_plan(load_arena(tmp_path / "arena.yaml"))


def deed(verb: Any, **more: Any) -> Deed:
    return Deed(verb=verb, place=PLACE, **more)


# -- seeing

PROFILE = {"height_m": 0.1, "radius_m": 0.25}


def truth(height_m: float, roll: float = 0.0, motors: float = 0.5) -> Truth:
    """Of one vehicle whose origin is so far above the floor."""
    zero = np.zeros((1, 3))
    q = np.array([[np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0]])
    return Truth(
        time_s=1.0,
        p_n=np.array([[0.0, 0.0, -height_m]]),
        q_nb=q,
        v_n=zero,
        omega_b=zero,
        accel_b=zero,
        motors=np.full((1, 4), motors),
    )


def see(eyes: Eyes, at: Truth, told: Telemetry | None = None, now: float = 1.0) -> Any:
    return eyes.see(at, {"a": told or Telemetry(1)}, {}, now)["a"]


def test_height_is_that_of_the_lowest_point_of_a_leaning_cylinder():
    eyes = Eyes([{"name": "a", "profile": PROFILE}])
    assert see(eyes, truth(1.05)).height_m == pytest.approx(1.0)
    leaning = see(eyes, truth(1.0, roll=0.5))
    assert leaning.height_m == pytest.approx(1.0 - 0.05 * np.cos(0.5) - 0.25 * np.sin(0.5))
    assert leaning.tilt_rad == pytest.approx(0.5)
    assert see(eyes, truth(0.25, roll=np.pi / 2)).height_m == pytest.approx(
        0.0, abs=1e-9
    )  # it lies on its side


def test_airborne_does_not_flicker_at_the_floor():
    eyes = Eyes([{"name": "a", "profile": PROFILE}])
    flown = [see(eyes, truth(0.05 + h)).airborne for h in (0.0, 0.08, 0.12, 0.08, 0.04, 0.02, 0.08)]
    assert flown == [False, False, True, True, True, False, False]


def test_words_older_than_a_second_are_unknown_and_a_silent_vehicle_with_still_rotors_is_not_armed():
    eyes, told = Eyes([{"name": "a", "profile": PROFILE}]), Telemetry(1)
    told.heart = Heart(heard=1.0, mode="OFFBOARD", armed=True)
    told.local = Local(heard=1.0, boot_s=1.0, pos=np.array([1.0, 2.0, 3.0]), vel=np.zeros(3))
    fresh = see(eyes, truth(1.0), told, now=2.0)
    assert (fresh.mode, fresh.armed, fresh.est_p_n, fresh.landed) == ("OFFBOARD", True, (1.0, 2.0, 3.0), None)
    stale = see(eyes, truth(1.0), told, now=2.02)
    assert (stale.mode, stale.armed, stale.est_p_n) == ("", None, None)
    assert see(eyes, truth(1.0, motors=0.0), told, now=2.02).armed is False
    assert see(eyes, truth(1.0, motors=0.0), told, now=2.0).armed is True  # its own word comes first


# -- hearing


def test_ears_ask_for_each_heartbeat_and_for_rates_until_they_hold(plan: Plan):
    tools = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in plan.vehicles]
    for sock, vehicle in zip(tools, plan.vehicles, strict=True):
        sock.bind((vehicle.router.partner_host, vehicle.tools_port))
        sock.settimeout(5)
    ears, voice = (
        TelemetryListener(plan.vehicles),
        mavlink.MAVLink(None, srcSystem=plan.vehicles[0].id, srcComponent=1),
    )
    try:
        ears.listen(1.0)
        asked, sender = _asked(tools[0], 3)
        assert {(m.command, m.param1) for m in asked} == {(512, 0), (511, 245), (511, 85)}
        assert {m.get_srcSystem() for m in asked} == {SYSTEM} and all(m.target_system == 1 for m in asked)
        told = [
            mavlink.MAVLink_heartbeat_message(2, 12, 128 | 1, 6 << 16, 3, 3),
            mavlink.MAVLink_extended_sys_state_message(0, 2),
            mavlink.MAVLink_local_position_ned_message(1020, 1, 2, 3, 0, 0, 0),
        ]
        for message in told:
            tools[0].sendto(message.pack(voice), sender)
        ears.listen(1.04)
        heart, ground = ears.told["uav1"].heart, ears.told["uav1"].ground
        assert heart and heart.mode == "OFFBOARD" and heart.armed and ground and not ground.landed
        assert [m.command for m in _asked(tools[0], 1)[0]] == [512]  # the rates hold
    finally:
        ears.close()
        for sock in tools:
            sock.close()


def _asked(sock: socket.socket, count: int) -> tuple[list[Any], Any]:
    found, parser, sender = [], mavlink.MAVLink(None), None
    for _ in range(count):
        data, sender = sock.recvfrom(2048)
        found += parser.parse_buffer(data)
    return found, sender


# -- reading


def test_a_tail_gives_whole_lines_once(tmp_path: Path):
    tail, file = Tail(tmp_path / "x"), tmp_path / "x"
    assert tail.lines() == []
    file.write_text("one\ntw")
    assert tail.lines() == ["one"]
    file.write_text("one\ntwo\n")
    assert tail.lines() == ["two"] and tail.lines() == []


def test_a_chronicle_tells_states_events_and_crashes_also_those_that_only_the_world_wrote_down(
    tmp_path: Path,
):
    (tmp_path / "logs").mkdir()
    chronicle = RunLog(tmp_path, ["world", "router"])
    assert not chronicle.started
    lines = [
        {"process": "world", "from": "STOPPED", "to": "READY", "reason": "it says so"},
        {"process": "router", "from": "STARTING", "to": "FATAL", "reason": "exit 1"},
        {"process": "world", "event": "uav1 crashed: touched a wall at 3.20 s"},
    ]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines) + '{"half')
    (tmp_path / "logs" / "world.log").write_text(
        "uav2 crashed: tilted 90 degrees at 4.00 s\nthe second up to 4.0 s: x\n"
    )
    told = chronicle.read()
    assert told == [
        "world: READY: it says so",
        "router: FATAL: exit 1",
        "world: uav1 crashed: touched a wall at 3.20 s",
    ]
    assert chronicle.started and chronicle.states == {"world": "READY", "router": "FATAL"}
    assert chronicle.crashed == {"uav1": "touched a wall at 3.20 s", "uav2": "tilted 90 degrees at 4.00 s"}


# -- doing


@pytest.fixture
def run(plan: Plan, tmp_path: Path) -> RunFolder:
    """The run folder of an arena of which nothing runs; the rooms' slices name sockets for faults."""
    folder = RunFolder(path=tmp_path / "run", rt=tmp_path / "rt")
    for made in (folder.path / "slices", folder.path / "logs", folder.rt):
        made.mkdir(parents=True)
    for room in ("world", "mocap", "router"):
        given = {**plan.slices[f"{room}.json"], "faults": str(folder.rt / f"{room}.faults")}
        (folder.path / "slices" / f"{room}.json").write_text(json.dumps(given))
    return folder


def doer(plan: Plan, run: RunFolder) -> ActionRunner:
    ears: Any = SimpleNamespace(command=lambda *_: None, set_parameter=lambda *_: None)
    return ActionRunner(plan, run.path, run.rt, RunLog(run.path, []), ears)


SPOILT = [
    (deed("mocap dropout", vehicles=("uav1",)), "mocap", {"do": "dropout", "body": "red", "on": True}),
    (
        deed("mocap swap", vehicles=("uav1", "uav2")),
        "mocap",
        {"do": "swap", "bodies": ["red", "blue"], "on": True},
    ),
    (
        deed("mocap jump", vehicles=("uav2",), by=(1.0, 0.0, 0.5)),
        "mocap",
        {"do": "jump", "body": "blue", "by_m": [1.0, 0.0, 0.5], "yaw_deg": 0.0},
    ),
    (deed("mocap delay", number=200.0), "mocap", {"do": "delay", "ms": 200.0}),
    (
        deed("link loss", vehicles=("uav1",), number=0.3),
        "router",
        {"do": "loss", "vehicle": "uav1", "share": 0.3},
    ),
    (deed("ground station loss"), "router", {"do": "heartbeat", "on": False}),
    (deed("ground station loss", undo=True), "router", {"do": "heartbeat", "on": True}),
    (deed("rc loss", vehicles=("uav1",)), "world", {"do": "sticks", "vehicle": "uav1", "on": False}),
    (
        deed("motor loss", vehicles=("uav1",), number=2.0),
        "world",
        {"do": "motor", "vehicle": "uav1", "rotor": 2, "thrust": 0.0},
    ),
    (
        deed("battery drain", vehicles=("uav1",), number=20.0, undo=True),
        "world",
        {"do": "battery", "vehicle": "uav1", "empty_in_s": None},
    ),
    (deed("wind", by=(3.0, 0.0, 0.0)), "world", {"do": "wind", "wind_m_s": [3.0, 0.0, 0.0]}),
]


@pytest.mark.parametrize(("given", "room", "expected"), SPOILT, ids=lambda x: getattr(x, "verb", None))
def test_a_deed_reaches_its_room(
    plan: Plan, run: RunFolder, given: Deed, room: str, expected: dict[str, Any]
):
    listening = FaultReceiver(run.rt / f"{room}.faults")
    doer(plan, run).do(given)
    assert listening.take() == [expected]
    listening.close()


@pytest.mark.parametrize("form", [f for f in DEEDS if f.lasting and f.verb != "hang"], ids=lambda f: f.verb)
def test_every_deed_that_lasts_is_a_fault_and_is_taken_back_by_another_one(plan: Plan, form: Any):
    given = deed(form.verb, vehicles=("uav1", "uav2"), number=1.0, by=(1.0, 2.0, 3.0), for_s=1.0)
    by_name, world = {v.name: v for v in plan.vehicles}, plan.slices["world.json"]
    done, undone = faults(given, by_name, world), faults(replace(given, undo=True), by_name, world)
    assert done and [room for room, _ in done] == [room for room, _ in undone]
    assert all(a != b and a["do"] == b["do"] for (_, a), (_, b) in zip(done, undone, strict=True))


def test_a_room_that_does_not_listen_is_told_of(plan: Plan, run: RunFolder):
    with pytest.raises(RunError, match="no process receives faults"):
        doer(plan, run).do(deed("wind"))


def test_signals_go_to_the_recorded_process_and_to_no_other_that_has_its_number(plan: Plan, run: RunFolder):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
    try:
        member = Member(pid=child.pid, pgid=child.pid, start_s=proc_fs.start_time(child.pid) or 0.0)
        run.write_state(plan, {"router": replace(member, start_s=member.start_s - 1.0)})
        with pytest.raises(RunError, match="router does not run"):
            doer(plan, run).do(deed("kill", processes=("router",)))
        run.write_state(plan, {"router": member})
        hand = doer(plan, run)
        hand.do(deed("hang", processes=("router",)))
        _, status = os.waitpid(child.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)
        hand.do(deed("kill", processes=("router",)))
        assert child.wait(20) == -signal.SIGKILL
        with pytest.raises(RunError, match="router does not run"):
            hand.do(deed("resume", processes=("router",)))
        hand.do(deed("hang", processes=("router",), undo=True))  # somebody has ended it meanwhile
    finally:
        child.kill()
        child.wait()


def test_the_supervisor_is_a_process_too_and_a_restart_needs_it(plan: Plan, run: RunFolder):
    run.write_state(plan, {})
    assert doer(plan, run)._chronicle.member("supervisor") == myself()
    with pytest.raises(RunError, match="no arena answers"):
        doer(plan, run).do(deed("restart", processes=("router",)))


def test_addresses_on_which_a_router_listens_are_not_free():
    first = free_address()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind((first, 24000))
        assert free_address() != first


def test_real_vehicles_are_refused(tmp_path: Path):
    from arena.smoke.flying.fly_scenario import refuse_real

    (tmp_path / "arena.yaml").write_text(
        "mocap: {source: natnet, server: 127.0.0.2}\nvehicles:\n  uav1: {autopilot: builtin}\n"
        "  uav2: {autopilot: hardware, url: 'udpin:127.0.0.1:14600', start: {position: [2, 0, 0]}}\n"
    )
    with pytest.raises(InputError, match="uav2: got a real vehicle"):
        refuse_real(load_arena(tmp_path / "arena.yaml"))
