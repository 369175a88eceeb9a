"""The stand-in: PX4's command line, startup and lockstep around the built-in autopilot."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.px4_startup import read_startup, rotors
from arena.autopilot.sitl_standin import BANNER, FREE_RUN, StandIn, take_lock
from arena.errors import InputError
from arena.plan import make_plan
from arena.plan.px4_startup import reset_by_startup
from arena.px4.simulator_link import SimulatorLink
from arena.schema import load_arena

from .fake import HIL, PERIOD_S, own_address, sensors

PARAMS = {
    "MAV_SYS_ID": 7.0,
    "CA_ROTOR_COUNT": 4.0,
    **{
        f"CA_ROTOR{i}_{key}": value
        for i, row in enumerate(
            ((0.13, 0.22, 0.05), (-0.13, -0.2, 0.05), (0.13, -0.22, -0.05), (-0.13, 0.2, -0.05))
        )
        for key, value in zip(("PX", "PY", "KM"), row, strict=True)
    },
}


def slice_of(folder: Path, address: str) -> dict[str, Any]:
    """Return the slice of the process px4 for a vehicle that the stand-in flies, filled in as by the supervisor."""
    file = folder / "arena.yaml"
    file.write_text(
        f"address: {address}\npx4: {{home: stand-in}}\nvehicles: {{uav1: {{autopilot: px4, id: 7}}}}\n"
    )
    made = make_plan(load_arena(file)).slices["px4.uav1.json"]
    return {**made, "folder": str(folder / "px4" / "uav1"), "clock": str(folder / "clock")}


def scripts(folder: Path, **texts: str) -> Path:
    """Write a startup folder; its rcS sources the two other scripts."""
    (folder / "rcS").write_text("#!/bin/sh\n. px4-rc.mavlinksim\n. px4-rc.mavlink  # links\n")
    for name, text in texts.items():
        (folder / f"px4-rc.{name}").write_text(text)
    return folder / "rcS"


def test_stand_in_reads_the_plans_scripts(tmp_path: Path) -> None:
    address = own_address()
    made = slice_of(tmp_path, address)
    for name, text in made["scripts"].items():
        (tmp_path / name).write_text(text)
    found = read_startup(scripts(tmp_path), {"PX4_PARAM_MPC_THR_HOVER": "0.55", "HOME": "x"})
    assert found.simulator == (address, 24079) and found.skipped == []
    startup = {"MAV_SYS_ID": 7.0, "EKF2_MULTI_IMU": 0.0, "SENS_IMU_MODE": 1.0}
    assert found.params == {
        "MPC_THR_HOVER": 0.55,
        **startup,
        **reset_by_startup(made["params"], made["version"]),
    }
    assert {link.name: [link.local, list(link.remote)] for link in found.links} == {
        name: [made["links"][name]["local"][1], made["links"][name]["remote"]]
        for name in ("router", "vision", "panic", "ground")
    }


def test_parameter_order_is_default_environment_script(tmp_path: Path) -> None:
    text = "param set-default A 1\nparam set-default B 1\nparam set C 1\nsimulator_mavlink start -c 4560\n"
    found = read_startup(
        scripts(tmp_path, mavlinksim=text, mavlink=""), {"PX4_PARAM_A": "5", "PX4_PARAM_C": "5"}
    )
    assert found.params == {"A": 5.0, "B": 1.0, "C": 1.0} and found.simulator == ("127.0.0.1", 4560)


def test_unknown_startup_lines_are_reported(tmp_path: Path) -> None:
    text = "simulator_mavlink start -t 127.0.0.9 4561\nif true; then\nmavlink start -u 14550\n"
    found = read_startup(scripts(tmp_path, mavlinksim=text, mavlink="mavlink stream -r 5 -s X -u 1"), {})
    assert found.skipped == ["if true; then", "mavlink start -u 14550"] and found.links == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("param set A b\nsimulator_mavlink start -c 4560", "A: got 'b', expected a number"),
        ("param set A 1", "the line `simulator_mavlink start` is missing"),
        ("simulator_mavlink start -c 0", "got '0', expected a port"),
        (". none", "none: cannot be read: No such file"),
    ],
)
def test_an_invalid_startup_is_an_error(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_startup(scripts(tmp_path, mavlinksim=text, mavlink=""), {})


def test_rotors_come_from_the_control_allocation_parameters() -> None:
    found = rotors(PARAMS)
    assert [r["direction"] for r in found] == ["ccw", "ccw", "cw", "cw"] and found[1]["position_m"] == [
        -0.13,
        -0.2,
        0.0,
    ]
    with pytest.raises(InputError, match="CA_ROTOR_COUNT is not given"):
        rotors({})
    with pytest.raises(
        InputError, match="CA_ROTOR3_KM is not given: set the environment variable PX4_PARAM_CA_ROTOR3_KM"
    ):
        rotors({k: v for k, v in PARAMS.items() if k != "CA_ROTOR3_KM"})


def decoded(data: bytes) -> list[Any]:
    found: list[Any] = mavlink.MAVLink(None).parse_buffer(data) or []
    return found


def test_stand_in_connects_with_px4s_first_messages() -> None:
    wanted, beat = decoded(StandIn("x", PARAMS).greeting())
    assert (wanted.get_type(), wanted.command, wanted.param1, wanted.param2) == (
        "COMMAND_LONG",
        511,
        115.0,
        5000.0,
    )
    assert beat.get_type() == "HEARTBEAT" and beat.get_srcSystem() == 7


def test_stand_in_runs_free_then_replies_once_per_sample() -> None:
    link, px4 = SimulatorLink(4, HIL), StandIn("x", PARAMS)
    answers = [decoded(px4.receive_simulator(link.sample(PERIOD_S * k, sensors(1), 0))) for k in range(1, 61)]
    assert [len(a) for a in answers] == [0] * FREE_RUN + [1] * (60 - FREE_RUN)
    for k, (m,) in enumerate(answers[FREE_RUN:], FREE_RUN + 1):
        assert m.time_usec == 4000 * k and m.flags == 1 and not m.mode & 128 and m.controls == [0.0] * 16


def test_a_sample_in_pieces_is_answered_once_complete() -> None:
    link, px4 = SimulatorLink(4, HIL), StandIn("x", PARAMS)
    for k in range(1, FREE_RUN + 1):
        px4.receive_simulator(link.sample(PERIOD_S * k, sensors(1), 0))
    data = link.sample(1.0, sensors(1), 0)
    assert b"".join(px4.receive_simulator(data[i : i + 1]) for i in range(len(data) - 1)) == b""
    assert len(decoded(px4.receive_simulator(data[-1:]))) == 1


def test_magnetometer_and_barometer_keep_their_last_sample() -> None:
    px4, codec = StandIn("x", PARAMS), mavlink.MAVLink(None)
    for k, (fields, mag, height) in enumerate(
        ((0x1FFF, 0.3, 100.0), (0x03F, 9.0, 900.0), (0x03F, 9.0, 900.0)), 1
    ):
        floats = [0.0, 0.0, -9.8, 0.0, 0.0, 0.0, mag, 0.0, 0.4, 1000.0, 0.0, height, 25.0]
        px4.receive_simulator(mavlink.MAVLink_hil_sensor_message(4000 * k, *floats, fields).pack(codec))
    assert px4._held["mag_b"][0] == pytest.approx([0.3, 0.0, 0.4]) and px4._held["baro_alt_m"].tolist() == [
        100.0
    ]


def test_stand_in_sends_with_its_configured_system_id() -> None:
    link, px4 = SimulatorLink(4, HIL), StandIn("x", PARAMS)
    said: dict[str, set[str]] = {}
    for k in range(1, 400):
        px4.receive_simulator(link.sample(PERIOD_S * k, sensors(1), 0))
        for name, data in px4.transmit():
            for m in decoded(data):
                assert (
                    m.get_type().startswith("UNKNOWN") or m.get_srcSystem() == 7
                )  # the dialect has no CURRENT_MODE yet
                said.setdefault(name, set()).add(m.get_type())
    assert {"HEARTBEAT", "ATTITUDE", "HIGHRES_IMU"} <= said["router"] and "HEARTBEAT" in said[
        "vision"
    ] & said["panic"]


def test_invalid_samples_do_not_start_the_stand_in() -> None:
    link, px4 = SimulatorLink(4, HIL), StandIn("x", PARAMS)
    px4.receive_simulator(np.random.default_rng(1).bytes(5000))
    for _ in range(30):
        assert px4.receive_simulator(link.sample(1.0, sensors(1), 0)) == b""


def _yaw_after(samples: Iterable[int]) -> float:
    """Return the estimated yaw of a stand-in that turns at 0.5 rad/s and receives the samples of these numbers."""
    link, px4 = SimulatorLink(4, HIL), StandIn("x", PARAMS)
    turning = {**sensors(1), "gyro_b": np.array([[0.0, 0.0, 0.5]])}
    for k in samples:
        px4.receive_simulator(link.sample(PERIOD_S * k, turning, 0))
    assert px4._autopilot is not None
    return px4._autopilot.vehicles[0].yaw()


def test_rotation_during_missing_samples_is_not_lost() -> None:
    whole = _yaw_after(range(1, 1001))
    assert _yaw_after(k for k in range(1, 1001) if k < 500 or k % 20 == 0) == pytest.approx(whole, abs=0.01)


def test_a_sample_that_is_missing_at_the_start_does_not_change_the_sensor_period() -> None:
    assert _yaw_after([1, *range(4, 1001)]) == pytest.approx(_yaw_after(range(1, 1001)), abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-w", "none", "."], "no such folder"),
        (["."], "rcS: cannot be read: No such file"),
        (["-d"], "ROOTFS"),
    ],
)
def test_an_invalid_command_line_exits_with_2(tmp_path: Path, arguments: list[str], said: str) -> None:
    argv = [sys.executable, "-m", "arena.autopilot.sitl_standin", "-d", "-i", "0", *arguments]
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        argv, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 2 and said in done.stderr
    assert BANNER in done.stdout or "usage" in done.stderr


def test_lock_does_not_follow_a_symbolic_link(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    (tmp_path / f"arena-standin-{os.getuid()}-127.58.1.1-3.lock").symlink_to(tmp_path / "target")
    with pytest.raises(OSError):
        take_lock(3, "127.58.1.1")
    assert not (tmp_path / "target").exists()
    with take_lock(4, "127.58.1.1") as lock:
        assert Path(lock.name).is_file()
