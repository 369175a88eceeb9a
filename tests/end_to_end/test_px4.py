"""Tests of arenas that fly PX4: its stand-in on every machine, the real one where it is found."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml
from pymavlink.dialects.v20 import common as mavlink

from arena.schema import load_arena
from arena.schema.px4 import find_px4
from arena.supervisor import open_run
from arena.wire.mavlink_codec import Codec

from .flight import ROOT, STANDS_M, Flight, Hangar, eventually

pytestmark = pytest.mark.flight
REPORT = True  # with the figures of PX4

FIRST_ID = 200 + os.getpid() % 40
"""PX4 binds its ports on every address, so these ids are used by no other test."""
VEHICLES = ("uav1", "uav2")
BOTH = ("stand-in", pytest.param("real", marks=pytest.mark.px4))
MAV_TYPE = {
    4: mavlink.MAV_TYPE_QUADROTOR,
    6: mavlink.MAV_TYPE_HEXAROTOR,
    8: mavlink.MAV_TYPE_OCTOROTOR,
}
"""Number of rotors -> type in HEARTBEAT."""


@pytest.fixture
def px4(request: pytest.FixtureRequest) -> list[str]:
    """Return the options with which `arena up` flies this PX4."""
    if request.param == "stand-in":
        return ["--set", "px4.home=stand-in"]
    return real_px4()


def real_px4() -> list[str]:
    found = find_px4()
    if found is None or found.stand_in:
        pytest.skip("no PX4 is found: set PX4_HOME")
    return []


def flown_by_px4(*vehicles: str) -> list[str]:
    sets = [
        f"vehicles.{name}.{what}"
        for i, name in enumerate(vehicles)
        for what in ("autopilot=px4", f"id={FIRST_ID + i}")
    ]
    return [word for each in sets for word in ("--set", each)]


def px4_process(flight: Flight, vehicle: str) -> psutil.Process:
    """Return the PX4 process, a child of `px4.<vehicle>`."""
    run = open_run(flight.folder)
    assert run is not None
    (child,) = psutil.Process(run.processes[f"px4.{vehicle}"].pid).children()
    return child


@pytest.mark.parametrize("px4", BOTH, indirect=True)
def test_px4_and_builtin_autopilot_fly_in_one_arena(hangar: Hangar, px4: list[str]) -> None:
    flight = hangar.fly(
        {"uav1": "lands", "uav2": "lands"},
        *("--until-done", "--speed", "max", "--processes", "--time-limit", "300"),
        *(*px4, *flown_by_px4("uav1")),
    )
    code = flight.wait(360)
    assert code == 0, flight.said()
    for vehicle in ("uav1", "uav2"):
        told = flight.summary["vehicles"][vehicle]
        assert (
            told["landing"]["landed"] and told["crashed"] == "" and told["verdict"]["max_height_m"] > 0.9
        ), vehicle
        assert all(s["error_m"] <= 0.15 for s in told["setpoints"]["each"]), vehicle
    assert set(flight.summary["px4"]) == {"uav1"}
    assert (
        flight.summary["px4"]["uav1"]["stand_in"] is bool(px4)
        and flight.summary["px4"]["uav1"]["ended"] == ""
    )
    assert ("This is not PX4" in flight.log("px4.uav1")) is bool(px4)
    assert ("arena's stand-in for PX4" in flight.said()) is bool(px4)
    assert flight.stats("world")["autopilot"]["uav1"]["answers"] > 250 * 5
    assert "the world goes on without it" not in flight.said()
    flight.assert_nothing_left()


def ring_profile(folder: Path, rotors: int) -> Path:
    """Write the profile of a vehicle with this number of rotors on a circle of 0.25 m; the rest is the iris's."""
    profile = yaml.safe_load((ROOT / "profiles" / "iris.yaml").read_text())
    angles = [2.0 * math.pi * (k + 0.5) / rotors for k in range(rotors)]
    profile["name"], profile["num_rotors"] = f"ring{rotors}", rotors
    profile["rotors"] = [
        {
            "position_m": [round(0.25 * math.cos(a), 4), round(0.25 * math.sin(a), 4), -0.02],
            "direction": "ccw" if k % 2 else "cw",
        }
        for k, a in enumerate(angles)
    ]
    file = folder / f"ring{rotors}.yaml"
    file.write_text(yaml.safe_dump(profile))
    return file


@pytest.mark.parametrize(
    ("rotors", "px4"),
    [
        (6, "stand-in"),
        pytest.param(4, "real", marks=pytest.mark.px4),
        pytest.param(6, "real", marks=pytest.mark.px4),
        pytest.param(8, "real", marks=pytest.mark.px4),
    ],
    indirect=["px4"],
)
def test_fused_arena_flies_px4_with_all_rotors_and_builtin_autopilot(
    hangar: Hangar, px4: list[str], tmp_path: Path, rotors: int
) -> None:
    profile = ["--set", f"vehicles.uav1.profile={ring_profile(tmp_path, rotors)}"]
    flight = hangar.fly(
        {"uav1": "tours", "uav2": "lands"},
        *("--until-done", "--speed", "max", "--time-limit", "300"),
        *(*px4, *flown_by_px4("uav1"), *profile),
    )
    with contextlib.closing(GroundStation(hangar.address)) as station:
        assert flight.wait(360) == 0, flight.said()
    assert station.newest[FIRST_ID, "HEARTBEAT"].type == MAV_TYPE[rotors]
    processes = flight.outcome["processes"]
    assert processes["router"]["member_of"] == "world" and processes["px4.uav1"]["starts"] == 1
    assert processes["forward.uav1"]["stats"]["poses"] > 100
    for vehicle in ("uav1", "uav2"):
        told = flight.summary["vehicles"][vehicle]
        assert told["landing"]["landed"] and told["crashed"] == "", vehicle
        assert told["verdict"]["max_tilt_deg"] < 40.0
        assert all(s["error_m"] <= 0.15 for s in told["setpoints"]["each"]), vehicle
    in_the_air = [row for row in flight.rows("uav1") if float(row["truth.pos.down"] or 0.0) < -0.5]
    for k in range(8):
        output = [float(row[f"act.output.{k + 1}"]) for row in in_the_air if row[f"act.output.{k + 1}"]]
        assert (0.3 < sum(output) / len(output) < 0.9) is (k < rotors), f"output {k + 1}"
    flight.assert_nothing_left()


def test_fused_arena_with_a_px4_that_does_not_start_flies_the_others(hangar: Hangar) -> None:
    home = broken_px4(hangar.folder, "echo libfoo.so.1: no such file >&2; exit 127")
    options = ("--until-done", "--speed", "max", "--time-limit", "300", "--set", f"px4.home={home}")
    flight = hangar.fly({"uav1": "lands", "uav2": "lands"}, *options, *flown_by_px4("uav1"))
    assert flight.wait(360) == 1
    assert "needs px4.uav1" in flight.said()
    second = flight.summary["vehicles"]["uav2"]
    assert second["landing"]["landed"] and second["verdict"]["max_height_m"] > 0.9
    flight.assert_nothing_left()


@pytest.mark.parametrize("px4", BOTH, indirect=True)
def test_killed_px4_falls_and_stopped_px4_recovers(hangar: Hangar, px4: list[str]) -> None:
    flight = hangar.fly(
        {"uav1": "hovers", "uav2": "hovers", "uav3": "tours"},
        "--until-done",
        "--time-limit",
        "300",  # wall time: a starved machine simulates slowly, and a limit in the landing stops the program (143)
        # far from uav2, which flies away before its PX4 replies again
        *("--set", "world.size=[30, 8, 5]", "--set", "vehicles.uav3.start.position=[12, 0, 0]"),
        *px4,
        *flown_by_px4("uav1", "uav2"),
    )
    flight.until_up(0.8, 60)
    killed, stopped = px4_process(flight, "uav1"), px4_process(flight, "uav2")
    began = flight.truth().time_s
    killed.kill()
    stopped.suspend()
    again = "uav2: PX4 replies again after "
    before = flight.said().count(again)  # on a busy machine it may have been late before
    try:
        # longer than the 1 s after which the program of uav2 has no valid telemetry, so that it ends
        eventually(lambda: flight.truth().time_s > began + 2.0, 30, "the world steps on", flight.said)
        assert flight.said().count(again) == before
    finally:
        stopped.resume()
    eventually(lambda: flight.said().count(again) > before, 10, again, flight.said)
    flight.until_event("program.uav3", "EXITED", 100)
    assert flight.wait(100) == 1, (
        "what the world sees down is not waited for, though its PX4 may believe for ever that it flies"
    )
    said, summary = flight.said(), flight.summary
    assert "uav1: PX4 has closed the simulator link: its motors stop, the world goes on without it" in said
    assert "uav1: PX4 has ended by itself (killed by SIGKILL); nothing flies this vehicle any more" in said
    assert "uav2: PX4 has not replied for 0.5 s" in said and "uav2: PX4 has ended by itself" not in said
    assert any(words.startswith("px4.uav1: exit 1") for words in summary["failed"]), summary["failed"]
    assert not any("px4.uav2" in words for words in summary["failed"])
    assert summary["px4"]["uav1"]["ended"] == "killed by SIGKILL" and summary["px4"]["uav2"]["ended"] == ""
    assert "ENDED BY ITSELF (killed by SIGKILL)" in (flight.folder / "summary.txt").read_text()
    third = summary["vehicles"]["uav3"]
    assert third["landing"]["landed"] and third["crashed"] == "" and third["verdict"]["max_height_m"] > 1.2
    assert summary["processes"]["program.uav3"]["exit_code"] == 0
    flight.assert_nothing_left()


@pytest.mark.parametrize("px4", BOTH, indirect=True)
def test_program_cannot_arm_after_a_land_all_without_router(hangar: Hangar, px4: list[str]) -> None:
    flight = hangar.fly({"uav1": "hovers"}, *px4, *flown_by_px4("uav1"))
    router = eventually(lambda: flight.state.processes.get("router"), 20, "a router", flight.said)
    supervisor = flight.state.supervisor.pid
    os.kill(supervisor, signal.SIGSTOP)  # it would restart the router at once
    os.kill(router.pid, signal.SIGKILL)
    try:
        told = flight.cli("land-all")
    finally:
        os.kill(supervisor, signal.SIGCONT)
    assert told.returncode == 0 and "uav1: already on the ground" in told.stdout, told.stdout + told.stderr
    flight.until_event("program.uav1", "EXITED", 60)
    assert "land-all has control: run `arena release`" in flight.log("program.uav1"), flight.said()
    assert flight.fact("uav1.armed") is False and flight.heights().max() < STANDS_M
    assert flight.cli("release", "uav1").returncode == 0
    assert flight.cli("restart", "program.uav1").returncode == 0
    flight.until_up()
    assert flight.cli("down").returncode == 0
    flight.wait()
    flight.assert_nothing_left()


def broken_px4(folder: Path, script: str) -> Path:
    """Make the folder of a PX4 that is installed and does not run. script: what its binary does."""
    home = folder / "home"
    for name in ("bin", "etc/init.d-posix"):
        (home / name).mkdir(parents=True)
    (home / "etc/init.d-posix/rcS").touch()
    (home / "bin/px4").write_text(f"#!/bin/sh\n{script}\n")
    (home / "bin/px4").chmod(0o755)
    return home


def landed_all(said: str) -> bool:
    return any(f"land: uav2: {words}" in said for words in ("landed and disarmed", "already on the ground"))


def test_px4_that_never_connects_is_reported_and_others_fly(hangar: Hangar) -> None:
    ends, hangs = "echo libfoo.so.1: no such file >&2; exit 127", "exec sleep 1000"
    home = broken_px4(hangar.folder, f'case "$PWD" in */uav1) {ends};; *) {hangs};; esac')
    options = ("--until-done", "--time-limit", "90", "--set", f"px4.home={home}")
    flight = hangar.fly(
        {"uav1": "lands", "uav2": "hovers", "uav3": "lands"}, *options, *flown_by_px4("uav1", "uav3")
    )
    flight.until_said("uav1, uav3: no heartbeat for 10 s; starting the other vehicles", 40)
    flight.until_said("uav2: in the air", 40)
    flight.until_said("uav3: PX4 is not ready after 20 s. It has printed nothing", 40)
    assert flight.cli("down", "--run", str(flight.folder)).returncode == 1
    assert flight.wait(60) == 1 and landed_all(flight.said())
    for name, why in (("uav1", "has ended"), ("uav3", "has never connected to the world")):
        assert f"the landing does not wait for {name}: its PX4 {why}" in flight.said()
    assert "PX4 ended before it was ready (exit 127)" in flight.said() and "needs px4.uav1" in flight.said()
    assert not any("landing was not confirmed" in words for words in flight.outcome["failed"])
    flight.assert_nothing_left()


class GroundStation:
    """A receiver at the port for ground stations. newest: (system id, message type) -> message.

    replies: reply to each HEARTBEAT with one. The built-in autopilot sends its streams only to a station that sends.
    """

    def __init__(self, address: str, *, replies: bool = False) -> None:
        self._replies = replies
        self.newest: dict[tuple[int, str], Any] = {}
        self.in_the_air: dict[int, list[Any]] = {}
        self.was_ready: set[int] = set()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 14550))
        self._codec = Codec(255, 190)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(5.0)
        self._socket.close()

    def _listen(self) -> None:
        own = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        while received := self._receive():
            for m in self._codec.parse(received[0]):
                self._hear(m, m.get_srcSystem())
                if self._replies and m.get_type() == "HEARTBEAT":
                    self._socket.sendto(self._codec.pack(own), received[1])

    def _receive(self) -> tuple[bytes, Any] | None:
        try:
            data, sender = self._socket.recvfrom(65536)
        except OSError:
            return None
        return (data, sender) if data else None

    def _hear(self, m: Any, system: int) -> None:
        self.newest[system, m.get_type()] = m
        if m.get_type() == "ESTIMATOR_STATUS" and self._flies(system):
            self.in_the_air.setdefault(system, []).append(m)
        elif (
            m.get_type() == "SYS_STATUS"
            and m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
        ):
            self.was_ready.add(system)

    def _flies(self, system: int) -> bool:
        state = self.newest.get((system, "EXTENDED_SYS_STATE"))
        return state is not None and state.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR


Example = tuple[Flight, GroundStation]


@pytest.fixture(scope="module")
def example(shared_hangar: Hangar) -> Iterator[Example]:
    """The first example flown by the real PX4."""
    real_px4()
    station = GroundStation(shared_hangar.address)
    yaml = ROOT / "examples" / "01_two_quads" / "arena.yaml"
    ids = [
        word for i, name in enumerate(VEHICLES) for word in ("--set", f"vehicles.{name}.id={FIRST_ID + i}")
    ]
    flight = shared_hangar.up(
        yaml, "--until-done", "--time-limit", "120", "--set", "defaults.autopilot=px4", *ids
    )
    code = flight.wait(180)
    station.close()
    print(flight.said())
    assert code == 0, flight.said()
    yield flight, station


@pytest.mark.px4
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_real_px4_reaches_every_setpoint_of_the_first_example(example: Example, vehicle: str) -> None:
    told = example[0].summary["vehicles"][vehicle]
    assert told["judged_by"] == "truth" and len(told["setpoints"]["each"]) == 5
    assert all(s["error_m"] <= 0.15 for s in told["setpoints"]["each"])
    assert told["landing"]["landed"] and told["landing"]["error_m"] <= 0.3 and told["crashed"] == ""


@pytest.mark.px4
@pytest.mark.parametrize("system", [FIRST_ID, FIRST_ID + 1], ids=VEHICLES)
def test_real_px4_estimator_fuses_external_vision(example: Example, system: int) -> None:
    station = example[1]
    held = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_VELOCITY_HORIZ | mavlink.ESTIMATOR_VELOCITY_VERT
    held |= mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_VERT_ABS
    told = station.in_the_air[system]
    assert len(told) > 7  # sent every 2 s
    for status in told:
        assert status.flags & held == held and not status.flags & mavlink.ESTIMATOR_CONST_POS_MODE, status
        assert 0.0 < status.pos_horiz_ratio < 1.0 and status.pos_horiz_accuracy < 0.1, status
    assert system in station.was_ready
    said = example[0].log(f"px4.{VEHICLES[system - FIRST_ID]}")
    assert "Ready for takeoff!" in said and "Preflight Fail" not in said and "ailsafe" not in said
    last = station.newest[system, "SYS_STATUS"]
    # landed in OFFBOARD without a program it must not arm, and no RC is configured; all other checks pass
    expected = mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    ill = last.onboard_control_sensors_enabled & ~last.onboard_control_sensors_health & ~expected
    assert ill == 0, hex(ill)


@pytest.mark.px4
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_run_folder_contains_the_ulog_of_px4(example: Example, vehicle: str) -> None:
    flight, _ = example
    told = flight.summary["px4"][vehicle]
    assert told["version"].startswith("1.") and not told["stand_in"] and len(told["ulogs"]) == 1
    log = flight.folder / told["ulogs"][0]
    assert log.read_bytes()[:7] == b"ULog\x01\x12\x35" and log.stat().st_size > 1_000_000
    assert told["ulogs"][0] in Path(flight.folder, "summary.txt").read_text()


@pytest.mark.px4
@pytest.mark.crowd
def test_ten_real_px4_fly_the_ten_vehicle_example(hangar: Hangar) -> None:
    real_px4()
    yaml = ROOT / "examples" / "10_ten_quads" / "arena.yaml"
    names = [v.name for v in load_arena(yaml, ["defaults.autopilot=builtin"]).vehicles]
    flight = hangar.up(yaml, "--until-done", "--speed", "max", "--time-limit", "240", *flown_by_px4(*names))
    assert flight.wait(300) == 0, flight.said()
    print((flight.folder / "summary.txt").read_text())
    for vehicle, told in flight.summary["vehicles"].items():
        assert told["landing"]["landed"] and told["crashed"] == "" and told["setpoints"]["count"] >= 2, (
            vehicle
        )
        assert all(s["error_m"] <= 0.15 for s in told["setpoints"]["each"]), (vehicle, told["setpoints"])
        # ten boots on few cores: a check can run before its sensor has data
        _, ready, after = flight.log(f"px4.{vehicle}").partition("Ready for takeoff!")
        assert ready and "Preflight Fail" not in after
        assert len(flight.summary["px4"][vehicle]["ulogs"]) == 1
    flight.assert_nothing_left()


@pytest.mark.px4
def test_real_px4_arms_in_time_and_leaves_no_process(example: Example) -> None:
    flight, _ = example
    first_up = max(flight.summary["vehicles"][v]["airborne_after_s"] for v in VEHICLES)
    print(f"all airborne after {first_up} s")
    assert first_up < 20.0  # 12 s to armed is promised; the machine may be shared
    flight.assert_nothing_left()
    names = [
        p.name()
        for p in psutil.process_iter()
        if p.name() == "px4" and str(flight.folder) in " ".join(p.cmdline())
    ]
    assert names == []
