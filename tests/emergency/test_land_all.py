"""land-all and kill-all on sockets, with autopilots that obey, refuse, do not answer, or lose datagrams."""

import contextlib
import dataclasses
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from emergency_fleet import REFUSES_LANDING, Fleet, flying, target
from fake_autopilot import ARM, FORCE, SET_MODE
from served import let_pass, until

from arena.emergency import dispatch, land_all, landing_sequence
from arena.emergency.dispatch import TargetConnections, bring_down
from arena.emergency.run_record import recorded_down
from arena.emergency.targets import Found, Target, from_plan
from arena.supervisor import proc_fs
from arena.wire.mavlink_ids import EMERGENCY


def land(targets, timeout_s=20.0, action="land"):
    lines = []
    return bring_down(targets, action=action, timeout_s=timeout_s, say=lines.append), lines


def senders(messages):
    return {(m.get_srcSystem(), m.get_srcComponent()) for m in messages}


def test_all_are_landed_and_confirmed():
    with Fleet([1, flying(2, land_s=0.4)], "127.54.30.1") as fleet:
        code, lines = land(fleet.targets)
    assert code == 0
    assert [line.split(" after ")[0] for line in lines] == [
        "uav1: landed and disarmed",
        "uav2: landed and disarmed",
    ]
    assert all(a.mode == "AUTO.LAND" and not a.armed and a.landed for a in fleet.autopilots.values())
    assert senders(m for a in fleet.autopilots.values() for m in a.received) == {(253, EMERGENCY.component)}


@pytest.mark.parametrize("path", ["panic", "tools"])
def test_one_connection_is_enough(path):
    """The router may have ended, or a second land-all may hold the panic link."""
    with Fleet([1], "127.54.31.1", paths=(path,)) as fleet:
        assert land(fleet.targets)[0] == 0


def test_a_taken_panic_port_leaves_the_way_through_the_router():
    with (
        Fleet([1], "127.54.32.1") as fleet,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        other.bind(fleet.targets[0].partner)
        assert land(fleet.targets)[0] == 0


def test_without_panic_port_and_router_it_lands_unconfirmed(end_when):
    with (
        Fleet([1], "127.54.33.1", paths=("panic",)) as fleet,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        other.bind(fleet.targets[0].partner)
        end_when(lambda: fleet.autopilots[1].mode == "AUTO.LAND")
        code, lines = land(fleet.targets)
    assert (code, lines) == (1, ["uav1: NOT CONFIRMED: no telemetry received"])


def test_a_refusing_vehicle_is_not_confirmed_and_the_others_land(end_when, confirmed):
    with Fleet([1, flying(2, refuse=REFUSES_LANDING)], "127.54.34.1") as fleet:
        tries = lambda: len([c for c in fleet.autopilots[2].commands if c.command == SET_MODE])  # noqa: E731
        end_when(lambda: confirmed("uav1") and tries() >= 6)  # two paths, each half second
        code, lines = land(fleet.targets)
    assert code == 1
    assert any(
        line.startswith("uav2: ") and line.endswith("refused: denied; retrying") for line in lines[:-2]
    )
    assert lines[-2].startswith("uav1: landed and disarmed")
    assert lines[-1].startswith("uav2: NOT CONFIRMED: armed, in the air, mode OFFBOARD")
    assert all(c.command != ARM for c in fleet.autopilots[2].commands)
    assert fleet.autopilots[2].armed


@pytest.mark.parametrize("broken", ["__init__", "send", "_read"])
def test_an_error_with_one_vehicle_does_not_stop_the_others(monkeypatch, end_when, confirmed, broken):
    right = getattr(TargetConnections, broken)

    def wrong(link, *args):
        if "uav1" in (getattr(link, "target", None) or args[0]).name:
            raise OverflowError("no such port")
        return right(link, *args)

    monkeypatch.setattr(TargetConnections, broken, wrong)
    end_when(lambda: confirmed("uav2"))
    with Fleet([1, 2], "127.54.47.1") as fleet:
        code, lines = land(fleet.targets)
    assert code == 1 and fleet.autopilots[2].mode == "AUTO.LAND"
    assert lines.count("uav1: OverflowError: no such port; retrying") == 1
    assert any(line.startswith("uav2: landed and disarmed") for line in lines)
    assert any(line.startswith("uav1: NOT CONFIRMED") for line in lines)


def test_a_vehicle_without_telemetry_is_not_confirmed():
    with Fleet([1], "127.54.35.1") as fleet:
        code, lines = land([*fleet.targets, target(2, "127.54.35.1")], timeout_s=0.5)
    assert code == 1
    assert lines[-1] == "uav2: NOT CONFIRMED: no telemetry received"


def record(folder, *events):
    """Make a run folder with these events, the last one half written."""
    folder.mkdir(exist_ok=True)
    (folder / "events.jsonl").write_text("".join(json.dumps(e) + "\n" for e in events) + '{"half wri')
    return folder


PX4_DIED = {"process": "px4.uav2", "from": "READY", "to": "EXITED", "reason": "exit 1"}
CRASHED = {"process": "world", "event": "uav1 crashed: tilted 61 degrees at 3.20 s"}


def test_a_vehicle_without_its_px4_is_not_confirmed_and_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.5)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.1)
    run = record(tmp_path / "run", CRASHED, PX4_DIED)
    with Fleet([1], "127.74.30.1") as fleet:
        began = time.monotonic()
        silent = dataclasses.replace(target(2, "127.74.30.1"), run=run)
        code, lines = land([*fleet.targets, silent], timeout_s=60.0)
    assert code == 1 and 0.5 < time.monotonic() - began < 60.0
    assert (
        lines[-1] == "uav2: NOT CONFIRMED: no telemetry received; the run records: its PX4 has ended: exit 1"
    )
    assert lines[-2].startswith("uav1: landed and disarmed"), (
        "a vehicle that is recorded as crashed, and lands, has landed"
    )


WORLD_ENDED = {
    "process": "world",
    "from": "STOPPING",
    "to": "EXITED",
    "reason": "exit 0 (the run ends: done)",
}
WORLD_READY = {"process": "world", "from": "STARTING", "to": "READY", "reason": "reported ready"}


def test_a_silent_vehicle_whose_simulation_has_ended_does_not_fly(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.3)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.1)
    run = record(tmp_path / "run", WORLD_READY, WORLD_ENDED)
    silent = dataclasses.replace(target(2, "127.74.32.1"), run=run, ends_with_world=True)
    assert land([silent], timeout_s=60.0) == (0, ["uav2: does not fly: its simulation has ended"])


def test_a_vehicle_whose_simulation_ends_with_its_landing_does_not_fly(tmp_path, monkeypatch):
    """The run ends when all vehicles are disarmed, before a second heartbeat confirms it."""
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.3)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.1)
    run = record(tmp_path / "run", WORLD_READY, WORLD_ENDED)
    with Fleet([flying(1, landed=True, armed=False, period_s=60.0)], "127.74.39.1") as fleet:
        only = dataclasses.replace(fleet.targets[0], run=run, ends_with_world=True)
        assert land([only], timeout_s=60.0) == (0, ["uav1: does not fly: its simulation has ended"])


def test_a_vehicle_whose_simulation_ends_before_its_first_heartbeat_does_not_fly(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.3)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.1)
    run = record(tmp_path / "run", WORLD_READY, WORLD_ENDED)
    stands = flying(1, landed=True, armed=False, period_s=60.0)
    stands.telemetry = ("EXTENDED_SYS_STATE",)
    with Fleet([stands], "127.74.40.1") as fleet:
        only = dataclasses.replace(fleet.targets[0], run=run, ends_with_world=True)
        assert land([only], timeout_s=60.0) == (0, ["uav1: does not fly: its simulation has ended"])


@pytest.mark.parametrize("ended", [("supervisor", "world"), ("supervisor",), ("world",)])
def test_a_silent_vehicle_whose_supervisor_and_world_were_killed_does_not_fly(tmp_path, monkeypatch, ended):
    """Without the supervisor, the end of the world is not recorded."""
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.1)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.05)
    run = record(tmp_path / "run", WORLD_READY)
    with subprocess.Popen(["sleep", "60"]) as process:
        running = {"pid": process.pid, "start_s": proc_fs.start_time(process.pid)}
        members = {
            name: {**running, **({"start_s": 1.0} if name in ended else {})}
            for name in ("supervisor", "world")
        }
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        state = {"boot": boot, "supervisor": members["supervisor"], "processes": {"world": members["world"]}}
        (run / "state.json").write_text(json.dumps(state))
        silent = dataclasses.replace(target(2, "127.74.36.1"), run=run, ends_with_world=True)
        code, lines = land([silent], timeout_s=60.0 if len(ended) == 2 else 0.6)
        process.kill()
    expected = (
        "does not fly: its simulation has ended"
        if len(ended) == 2
        else "NOT CONFIRMED: no telemetry received"
    )
    assert (code, lines) == (0 if len(ended) == 2 else 1, [f"uav2: {expected}"])


@pytest.mark.parametrize(
    ("ends_with_world", "events"),
    [(True, [WORLD_READY]), (True, []), (True, [WORLD_ENDED, WORLD_READY]), (False, [WORLD_ENDED])],
    ids=["world runs", "no record", "world runs again", "flight controller in the loop"],
)
def test_a_silent_vehicle_that_may_fly_is_not_confirmed(tmp_path, monkeypatch, ends_with_world, events):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.1)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.05)
    run = record(tmp_path / "run", *events)
    silent = dataclasses.replace(target(2, "127.74.33.1"), run=run, ends_with_world=ends_with_world)
    assert land([silent], timeout_s=0.6) == (1, ["uav2: NOT CONFIRMED: no telemetry received"])


def test_a_vehicle_with_telemetry_is_landed_despite_a_recorded_end_of_its_world(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.1)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.05)
    run = record(tmp_path / "run", WORLD_ENDED)
    with Fleet([1], "127.74.34.1") as fleet:
        code, lines = land([dataclasses.replace(t, run=run, ends_with_world=True) for t in fleet.targets])
    assert code == 0 and lines[-1].startswith("uav1: landed and disarmed")


def test_lines_of_vehicles_with_one_name_give_their_run_folder(tmp_path, end_when, confirmed):
    runs = [record(tmp_path / name) for name in ("a", "b")]
    end_when(lambda: confirmed(f"uav1 of {runs[0]}"))
    with Fleet([1], "127.74.35.1") as fleet:
        flies = dataclasses.replace(fleet.targets[0], run=runs[0])
        silent = dataclasses.replace(target(2, "127.74.35.1", name="uav1"), run=runs[1])
        code, lines = land([flies, silent])
    assert code == 1 and lines[-1] == f"uav1 of {runs[1]}: NOT CONFIRMED: no telemetry received"
    assert lines[-2].startswith(f"uav1 of {runs[0]}: landed and disarmed after")


def test_a_real_vehicle_is_waited_for_despite_a_record(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_TRY_SILENT_S", 0.1)
    monkeypatch.setattr(dispatch, "_READ_RECORD_S", 0.1)
    record(tmp_path / "run", PX4_DIED)
    began = time.monotonic()
    code, lines = land([target(2, "127.74.31.1")], timeout_s=0.4)
    assert (code, lines) == (
        1,
        ["uav2: NOT CONFIRMED: no telemetry received"],
    ) and time.monotonic() - began >= 0.4


def test_a_crash_is_recorded_and_a_restarted_px4_is_not(tmp_path):
    again = {"process": "px4.uav2", "from": "STARTING", "to": "READY", "reason": "it says so"}
    program = {"process": "program.uav3", "event": "uav3 crashed: nowhere"}
    both = {"uav1": "crashed: tilted 61 degrees at 3.20 s", "uav2": "its PX4 has ended: exit 1"}
    names = ["uav1", "uav2", "uav3"]
    assert recorded_down(record(tmp_path / "a", CRASHED, PX4_DIED, program, {"process": None}), names) == both
    assert recorded_down(record(tmp_path / "b", PX4_DIED, again), names) == {}
    assert recorded_down(record(tmp_path / "a", CRASHED), ["uav2"]) == {}
    assert recorded_down(tmp_path / "none", names) == {}


def test_all_land_with_a_third_of_datagrams_lost():
    with Fleet([1, 2, 3], "127.54.36.1", paths=("panic",), loss=0.3) as fleet:
        assert land(fleet.targets)[0] == 0


def test_a_vehicle_armed_on_the_ground_is_disarmed_without_force(monkeypatch):
    monkeypatch.setattr(landing_sequence, "DISARM_AFTER_S", 0.6)
    fake = flying(1, landed=True, disarm_s=math.inf)
    with Fleet([fake], "127.54.37.1") as fleet:
        code, lines = land(fleet.targets)
    assert code == 0
    assert not fake.armed
    assert {(c.param1, c.param2) for c in fake.commands if c.command == ARM} == {(0.0, 0.0)}
    assert float(re.fullmatch(r"uav1: landed and disarmed after ([\d.]+) s", lines[-1])[1]) >= 0.6


def test_a_disarmed_vehicle_on_the_ground_is_left_alone(monkeypatch):
    monkeypatch.setattr(landing_sequence, "WATCH_S", 0.5)
    with Fleet([flying(1, landed=True, armed=False)], "127.54.38.1") as fleet:
        assert land(fleet.targets) == (0, ["uav1: already on the ground"])


def test_a_vehicle_armed_during_the_landing_is_landed_too(monkeypatch):
    monkeypatch.setattr(landing_sequence, "WATCH_S", 60.0)  # the timer of a busy machine is late
    with Fleet([flying(1, landed=True, armed=False)], "127.74.38.1") as fleet:
        fake = fleet.autopilots[1]

        def take_off():
            fake.mode, fake.armed, fake.landed = "OFFBOARD", True, False

        starter = threading.Timer(0.7, take_off)
        starter.start()
        code, (line,) = land(fleet.targets)
        starter.join()
        assert fake.landed and not fake.armed
    assert code == 0 and line.startswith("uav1: landed and disarmed after ")


def test_review_fault_5_a_pilot_who_takes_over_is_not_commanded(monkeypatch):
    fake = flying(1, land_s=math.inf)
    commands_at_takeover = []

    def pilot():
        until(lambda: fake.mode == "AUTO.LAND")
        let_pass(fake, 20)
        fake.mode = "POSCTL"
        until(lambda: any("pilot has control" in line for line in lines))
        commands_at_takeover.extend(fake.orders)
        let_pass(fake, 40)
        fake.landed, fake.armed = True, False

    lines = []
    with Fleet([fake], "127.54.48.1") as fleet:
        hands = threading.Thread(target=pilot)
        hands.start()
        assert bring_down(fleet.targets, action="land", timeout_s=60.0, say=lines.append) == 0
        hands.join()
    assert "uav1: pilot has control (POSCTL): not commanded" in lines
    assert fake.orders == commands_at_takeover and fake.mode == "POSCTL"
    assert lines[-1].startswith("uav1: landed and disarmed after ")


def test_review_fault_5_a_pilots_vehicle_in_the_air_is_not_confirmed(end_when):
    fake = flying(1, land_s=math.inf)

    def taken():
        if fake.ticks > 30:
            fake.mode = "POSCTL"
        return fake.ticks > 60

    end_when(taken)
    with Fleet([fake], "127.54.49.1") as fleet:
        code, lines = land(fleet.targets)
    assert code == 1
    assert lines[-1] == (
        "uav1: NOT CONFIRMED: pilot has control (POSCTL): not commanded; armed, in the air, mode POSCTL"
    )


def test_kill_all_stops_the_motors_in_the_air():
    with Fleet([flying(1, refuse=REFUSES_LANDING)], "127.54.39.1") as fleet:
        code, lines = land(fleet.targets, action="kill")
    assert code == 0
    assert lines[0].startswith("uav1: motors stopped after ")
    assert {(c.command, c.param1, c.param2) for c in fleet.autopilots[1].orders} == {(ARM, 0.0, FORCE)}


def test_telemetry_from_another_address_confirms_nothing():
    """A heartbeat on the ground counts only from the vehicle's own link or router."""
    host = "127.54.40.1"
    lie = flying(1, landed=True, armed=False)
    moved = Target(
        name="uav1", id=1, autopilot=(host, 30000), partner=target(1, host).partner, tools=(host, 30001)
    )
    with Fleet([lie], host, paths=("panic",)):
        code, lines = land([moved], timeout_s=0.5)
    assert (code, lines) == (1, ["uav1: NOT CONFIRMED: no telemetry received"])


def router_slice(host, ids):
    vehicles = [
        {
            "name": f"uav{k}",
            "id": k,
            "link": {"local": [host, 24001 + 10 * k], "remote": [host, 24000 + 10 * k]},
            "serve": [host, 24008 + 10 * k],
            "tools": [host, 24006 + 10 * k],
            "clients": [],
            "logger": None,
        }
        for k in ids
    ]
    return {
        "name": "router",
        "vehicles": vehicles,
        "gcs_local": [host, 24000],
        "gcs": [],
        "heartbeat": True,
        "simulated": True,
    }


def test_all_are_landed_and_confirmed_through_a_real_router(tmp_path):
    host = "127.54.46.1"
    file = tmp_path / "router.json"
    file.write_text(json.dumps(router_slice(host, (1, 2))))
    with Fleet([1, 2], host, paths=("router",)) as fleet:
        router = subprocess.Popen([sys.executable, "-m", "arena.mavlink_router", str(file)])
        try:
            code, lines = land(fleet.targets)
        finally:
            router.terminate()
            assert router.wait(20) == 0
    assert code == 0, lines
    assert senders(c for a in fleet.autopilots.values() for c in a.commands) == {(253, EMERGENCY.component)}


# the commands


def arena(*arguments, module="arena.cli", cwd=None, env=None):
    return subprocess.run(
        [sys.executable, "-m", module, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=180,
        cwd=cwd,
        check=False,
        env={**os.environ, **(env or {})},
    )


def empty_runtime(tmp_path):
    return {"XDG_RUNTIME_DIR": str(tmp_path), "TMPDIR": str(tmp_path)}


def test_the_command_lands_from_a_broken_yaml_with_exit_code_0(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text(
        "address: 127.54.41.1\nworld: {size: [\nvehicles:\n  one: {profile: nosuch}\n  two: {start: [0, 0}\n"
    )
    with Fleet([1, 2], "127.54.41.1"):
        done = arena("land-all", file, "--timeout", "20", env=empty_runtime(tmp_path))
    assert done.returncode == 0, done.stderr
    first, *rest = done.stdout.splitlines()
    assert first == f"landing one, two (addresses from {file})"
    assert [line.split(" after")[0] for line in rest] == [
        "one: landed and disarmed",
        "two: landed and disarmed",
    ]


def test_land_all_spares_the_excepted_vehicles(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.54.42.1\nvehicles:\n  one:\n  two:\n")
    with Fleet([1, 2], "127.54.42.1") as fleet:
        done = arena("land-all", file, "--except", "two", env=empty_runtime(tmp_path))
    assert done.returncode == 0
    assert not fleet.autopilots[2].commands
    assert arena("land-all", file, "--only", "three", env=empty_runtime(tmp_path)).returncode == 2


@pytest.mark.parametrize("module", ["arena.cli", "arena.emergency.land_all"])
def test_an_unconfirmed_vehicle_gives_exit_code_1(tmp_path, module):
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.54.43.1\nvehicles:\n  one:\n")
    verb = ("land-all",) if module == "arena.cli" else ()
    done = arena(*verb, file, "--timeout", "0.3", module=module, env=empty_runtime(tmp_path))
    assert (done.returncode, done.stdout.splitlines()[-1]) == (1, "one: NOT CONFIRMED: no telemetry received")


def test_kill_all_requires_yes(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.54.44.1\nvehicles:\n  one:\n")
    with Fleet([1], "127.54.44.1") as fleet:
        refused = arena("kill-all", file, env=empty_runtime(tmp_path))
        assert not fleet.autopilots[1].commands
        done = arena("kill-all", file, "--yes", env=empty_runtime(tmp_path))
    assert (refused.returncode, done.returncode) == (2, 0)
    assert "--yes" in refused.stderr
    assert not fleet.autopilots[1].armed


HEAVY = {
    "numpy",
    "pydantic",
    "rich",
    "typer",
    "click",
    "matplotlib",
    "pybullet",
    "psutil",
    "jinja2",
    "serial",
    "yaml",
    "arena.schema",
    "arena.plan",
    "arena.supervisor",
    "pymavlink",
}


def test_land_all_imports_no_heavy_package(tmp_path):
    """Runs the command line on the plan of a run, until all have landed."""
    host = "127.66.20.1"
    link = {"autopilot_host": host, "autopilot_port": 24014, "partner_host": host, "partner_port": 24015}
    vehicle = {"name": "uav1", "id": 1, "simulated": True, "panic": link, "router": link, "tools_port": 24016}
    (tmp_path / "plan.json").write_text(json.dumps({"vehicles": [vehicle]}))
    code = (
        "import sys, json; from arena.cli import main; code = main(sys.argv[1:]); "
        "print(json.dumps([code, sorted(sys.modules)]))"
    )
    for verb in (["land-all"], ["kill-all", "--yes"]):
        with Fleet([1], host):
            argv = [sys.executable, "-c", code, *verb, "--run", str(tmp_path)]
            done = subprocess.run(argv, capture_output=True, text=True, timeout=120, check=True)
        exit_code, loaded = json.loads(done.stdout.splitlines()[-1])
        assert exit_code == 0 and "arena.emergency.dispatch" in loaded
        assert not HEAVY & set(loaded)


@pytest.mark.parametrize("verb", ["land-all", "kill-all"])
def test_the_help_and_the_command_have_the_same_options(verb):
    shown, short = arena(verb, "--help"), arena(verb, "--no-such-option")
    assert (shown.returncode, short.returncode) == (0, 2)
    options = [set(re.findall(r"--[a-z]+", text)) for text in (shown.stdout, short.stderr)]
    assert options[0] - {"--help"} == options[1] - {"--no"}


@pytest.mark.parametrize("paths", [("panic",), ("tools",), ("panic", "tools")])
def test_two_at_once_both_confirm(tmp_path, paths):
    host, file = f"127.66.21.{1 + len(''.join(paths))}", tmp_path / "arena.yaml"
    file.write_text(f"address: {host}\nvehicles:\n  one:\n  two:\n")
    argv = [sys.executable, "-m", "arena.cli", "land-all", str(file)]
    with Fleet([1, 2], host, paths=paths):
        both = [
            subprocess.Popen(argv, stdout=subprocess.PIPE, env={**os.environ, **empty_runtime(tmp_path)})
            for _ in range(2)
        ]
        said = [process.communicate(timeout=180)[0].decode() for process in both]
    assert [process.returncode for process in both] == [0, 0], said


@pytest.mark.parametrize("verb", [("land-all",), ("kill-all", "--yes")])
def test_commands_succeed_with_a_third_of_datagrams_lost(tmp_path, verb):
    host, file = f"127.66.22.{len(verb)}", tmp_path / "arena.yaml"
    file.write_text(f"address: {host}\nvehicles:\n" + "".join(f"  v{k}:\n" for k in range(1, 11)))
    with Fleet(range(1, 11), host, loss=0.3) as fleet:
        done = arena(*verb, file, env=empty_runtime(tmp_path))
    assert done.returncode == 0, done.stdout
    assert not any(fake.armed for fake in fleet.autopilots.values())


def test_kill_all_spares_the_excepted_vehicles(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.66.23.1\nvehicles:\n  one:\n  two:\n  three:\n")
    with Fleet([1, 2, 3], "127.66.23.1") as fleet:
        done = arena(
            "kill-all", file, "--yes", "--only", "one,two", "--except", "two", env=empty_runtime(tmp_path)
        )
    assert done.returncode == 0 and "of one (addresses" in done.stdout
    assert [fake.armed for fake in fleet.autopilots.values()] == [False, True, True]
    assert not fleet.autopilots[2].commands and not fleet.autopilots[3].commands


def test_a_landing_continues_when_the_terminal_is_closed(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.66.24.1\nvehicles:\n  one:\n")
    with Fleet([flying(1, land_s=0.7)], "127.66.24.1") as fleet:
        argv = [sys.executable, "-m", "arena.cli", "land-all", str(file)]
        process = subprocess.Popen(
            argv, stdout=subprocess.PIPE, env={**os.environ, **empty_runtime(tmp_path)}
        )
        assert process.stdout.readline().startswith(b"landing one")
        process.stdout.close()
        while not fleet.autopilots[1].commands:
            time.sleep(0.01)
        process.send_signal(signal.SIGHUP)
        process.wait(120)
    assert fleet.autopilots[1].landed and not fleet.autopilots[1].armed
    assert process.returncode == 0


def test_a_landing_does_not_wait_for_a_frozen_terminal(tmp_path):  # review fault 8
    """A pipe that is full stands for a terminal after Ctrl-S."""
    file = tmp_path / "arena.yaml"
    file.write_text("address: 127.66.25.1\nvehicles:\n  one:\n")
    unread, pipe = os.pipe()
    os.set_blocking(pipe, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(pipe, b"x" * 4096):
            pass
    os.set_blocking(pipe, True)
    with Fleet([flying(1, land_s=0.7)], "127.66.25.1") as fleet:
        argv = [sys.executable, "-m", "arena.cli", "land-all", str(file)]
        process = subprocess.Popen(argv, stdout=pipe, env={**os.environ, **empty_runtime(tmp_path)})
        try:
            assert process.wait(120) == 0
        finally:
            process.kill()
            os.close(unread)
            os.close(pipe)
    assert fleet.autopilots[1].landed and not fleet.autopilots[1].armed


def test_a_landing_does_not_wait_for_the_disk_of_the_run(monkeypatch):  # review fault 8
    """The record of the command in the run folder is not written until the vehicle has landed."""
    go, recorded = threading.Event(), []
    monkeypatch.setattr(land_all, "record_command", lambda *given: recorded.append(go.wait(60.0)) or "")
    with Fleet([1], "127.66.26.1") as fleet:
        targets = tuple(dataclasses.replace(t, run=Path("/no/such/run")) for t in fleet.targets)
        monkeypatch.setattr(land_all, "find", lambda **given: Found(targets=targets, source="test"))
        assert land_all.land_all(run=Path("/no/such/run")) == 0
        assert fleet.autopilots[1].landed and recorded == []
        go.set()
        assert land_all._RECORDS.flush(60.0)


def land_recorded(monkeypatch, fleet, run):
    """Land the vehicles of a fleet whose run folder is `run`. Return the exit code."""
    targets = tuple(dataclasses.replace(t, run=run) for t in fleet.targets)
    monkeypatch.setattr(land_all, "find", lambda **given: Found(targets=targets, source="test"))
    return land_all.land_all(run=run)


def test_a_frozen_terminal_does_not_delay_the_record(monkeypatch, tmp_path):
    go = threading.Event()
    monkeypatch.setattr(land_all, "_print", lambda line: go.wait(60.0))
    monkeypatch.setattr(land_all, "_FLUSH_S", 0.2)
    try:
        with Fleet([1], "127.66.27.1") as fleet:
            assert land_recorded(monkeypatch, fleet, tmp_path) == 0
        assert land_all._RECORDS.flush(60.0)
        assert '"command": "land-all"' in (tmp_path / "emergency.jsonl").read_text()
    finally:
        go.set()
        assert land_all._OUTPUT.flush(60.0)


def test_the_record_has_the_time_before_the_first_command(monkeypatch, tmp_path):
    first = []
    monkeypatch.setattr(land_all, "send_first_commands", lambda *given: first.append(time.monotonic()))
    with Fleet([1], "127.66.28.1") as fleet:
        assert land_recorded(monkeypatch, fleet, tmp_path) == 0
    assert land_all._RECORDS.flush(60.0)
    (line,) = filter(None, (tmp_path / "emergency.jsonl").read_text().splitlines())
    assert first[0] - 1.0 < json.loads(line)["mono"] <= first[0]


def test_the_record_has_real_vehicles_too(tmp_path):
    """The supervisor latches the recorded landing in a router or hardware link that was not ready."""
    ends = {"panic": {"autopilot_host": "127.0.0.1", "autopilot_port": 1, "partner_host": "127.0.0.1"}}
    ends["panic"]["partner_port"] = 2
    ends |= {"router": {"partner_host": "127.0.0.1"}, "tools_port": 3}
    vehicles = [{"name": f"uav{k}", "id": k, "simulated": k == 1, **ends} for k in (1, 2)]
    wire = {"kind": "serial", "device": "/dev/none", "baud": 57600}
    plan = {"vehicles": vehicles, "slices": {"link.uav2.json": {"wire": wire, "uid": ""}}}
    land_all._record("land-all", from_plan(json.dumps(plan), tmp_path), 5.0)
    assert land_all._RECORDS.flush(60.0)
    (line,) = filter(None, (tmp_path / "emergency.jsonl").read_text().splitlines())
    assert json.loads(line) == {"mono": 5.0, "command": "land-all", "vehicles": ["uav1", "uav2"]}


def test_a_command_that_could_not_be_recorded_is_reported(monkeypatch, tmp_path, capfd):
    (tmp_path / "emergency.jsonl").mkdir()
    with Fleet([1], "127.66.29.1") as fleet:
        assert land_recorded(monkeypatch, fleet, tmp_path) == 0
    words = "land-all could not be recorded, so a program may arm a vehicle whose router was not ready: Is a directory"
    assert f"{tmp_path / 'emergency.jsonl'}: {words}\n" in capfd.readouterr().out


def test_a_disk_that_does_not_respond_is_reported(monkeypatch, tmp_path, capfd):
    go = threading.Event()
    monkeypatch.setattr(land_all, "record_command", lambda *given: str(not go.wait(60.0))[:0])
    monkeypatch.setattr(land_all, "_FLUSH_S", 0.2)
    with Fleet([1], "127.66.30.1") as fleet:
        assert land_recorded(monkeypatch, fleet, tmp_path) == 0
    go.set()
    assert land_all._RECORDS.flush(60.0)
    assert "router was not ready: the disk of the run folder does not respond\n" in capfd.readouterr().out


def test_fifty_vehicles_are_all_commanded_and_confirmed(tmp_path):
    """How fast is measured by benchmarks/panic.py."""
    file, host = tmp_path / "arena.yaml", "127.54.45.1"
    file.write_text(f"address: {host}\nvehicles:\n" + "".join(f"  v{k}:\n" for k in range(1, 51)))
    with Fleet(range(1, 51), host) as fleet:
        done = arena("land-all", file, env=empty_runtime(tmp_path))
    assert done.returncode == 0, done.stdout
    assert all(a.commands for a in fleet.autopilots.values())
