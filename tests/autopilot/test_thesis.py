"""The measure that holds our flights against the thesis's, and one such flight in one process.

What needs the data is skipped where they are not: they are no part of this project.
"""

from __future__ import annotations

import importlib.util
import math
import struct
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from flight import Flight

from arena.constants import GRAVITY_M_S2
from arena.geometry import yaw_from_quat
from arena.schema import load_profile

ROOT = Path(__file__).parents[2]


def load(file: Path) -> ModuleType:
    name = file.stem
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


THESIS = load(ROOT / "benchmarks" / "thesis.py")
FLOWN = 3  # steps: the benchmark flies all six, through `arena up`
needs_data = pytest.mark.skipif(
    not THESIS.DATA.is_dir(), reason="the thesis's flight data are not beside the repository"
)


def track(t: Any, p: Any, goal: Any, start: tuple[int, ...] = (0,)) -> Any:
    return THESIS.Track(
        t=np.asarray(t, float), p=np.asarray(p, float), goal=np.asarray(goal, float), start=start
    )


def test_delayed_copy_of_a_track_differs_by_its_lag_only():
    t = np.arange(0.0, 10.0, 0.03)
    way = np.stack([np.sin(t), np.cos(t) - 1.0, 0.1 * t], axis=1)
    one, late = track(t, way, way), track(t + 0.4, way, way)
    rms, lag = THESIS.apart(one, late)
    assert lag == pytest.approx(0.4)
    assert rms.max() < 1e-3
    off, _ = THESIS.apart(one, track(t, way + np.array([0.0, 0.0, 0.2]), way))
    assert off == pytest.approx([0.0, 0.0, 0.2], abs=0.05)


def test_step_is_measured_by_rise_overshoot_and_final_error():
    t = np.arange(0.0, 6.0, 0.01)
    along = np.minimum(t, 2.4)  # a ramp of 1 m/s to 2 m that goes 0.4 m too far
    goal = np.tile([0.0, 2.0, 0.0], (len(t), 1))
    step = track(t, np.stack([0 * t, along, 0 * t], axis=1), goal).step(0)
    assert step.rise_s == pytest.approx(1.6, abs=0.02)
    assert step.overshoot == pytest.approx(0.2, abs=0.01)
    assert step.error_m == pytest.approx(0.4, abs=0.01)


def test_old_gains_become_acceleration_gains_by_the_hover_thrust():
    old = dict.fromkeys(THESIS.SAME_NAME, 1.0) | {f"MPC_{a}_VEL_{g}": 0.2 for a in ("XY", "Z") for g in "PID"}
    old |= {"MPC_THR_HOVER": 0.5, "MPC_SPOOLUP_TIME": 1.0, "MC_DTERM_CUTOFF": 0.0}
    old |= {"MC_YAW_P": 4.0, "MC_ROLL_P": 8.0, "MC_PITCH_P": 8.0}
    now = THESIS.of_today(old, hover=0.6)
    assert now["MPC_Z_VEL_P_ACC"] == pytest.approx(0.2 * GRAVITY_M_S2 / 0.5, abs=1e-5)
    assert now["MPC_XY_VEL_P_ACC"] == pytest.approx(0.2 * GRAVITY_M_S2 / 0.6, abs=1e-5)
    assert now["MC_YAW_WEIGHT"] == 0.5


def test_initial_parameters_are_read_from_a_ulog():
    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    def parameter(key: bytes, value: bytes) -> bytes:
        return message(b"P", bytes([len(key)]) + key + value)

    log = (
        b"ULog\x01\x12\x35\x01"
        + bytes(8)
        + message(b"B", bytes(40))
        + message(b"I", b"\x0achar[3] ab" + b"abc")
    )
    log += parameter(b"float MPC_XY_P", struct.pack("<f", 0.75)) + parameter(
        b"int32_t SYS_ID", struct.pack("<i", -3)
    )
    log += message(b"D", bytes(9)) + parameter(b"float MPC_XY_P", struct.pack("<f", 0.5))
    assert THESIS.ulog_params(log) == {"MPC_XY_P": 0.75, "SYS_ID": -3}


@needs_data
def test_measure_reproduces_the_figures_of_the_data():
    for one, other, known in THESIS.PAIRS:
        a, b = (THESIS.read_track(THESIS.DATA / f"setpoints_{name}.csv") for name in (one, other))
        assert len(a.start) == len(b.start) == 6
        rms, _ = THESIS.apart(a, b)
        assert rms == pytest.approx(known, abs=0.0015)


@needs_data
def test_simulated_flight_is_nearer_to_the_real_one_than_gazebos(monkeypatch):
    real, gazebo = (
        THESIS.read_track(THESIS.DATA / f"setpoints_{name}.csv") for name in ("real_uav3", "gazebo_uav2")
    )
    end = gazebo.start[FLOWN]
    bound, _ = THESIS.apart(
        track(gazebo.t[:end], gazebo.p[:end], gazebo.goal[:end], gazebo.start[:FLOWN]), real
    )
    rms, lag = THESIS.apart(flown((THESIS.DATA / "setpoints_real_uav3.ulg").read_bytes(), monkeypatch), real)
    assert np.linalg.norm(rms) <= np.linalg.norm(bound), (rms, bound)
    assert (rms <= bound + 0.01).all(), (rms, bound)
    assert abs(lag) < 0.3


def flown(ulog: bytes, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The thesis's program in one process: the track of the estimate."""
    steps = load(THESIS.PROGRAM)
    profile = load_profile("intel_aero")
    params = THESIS.of_today(THESIS.ulog_params(ulog), profile.hover_command)
    monkeypatch.setattr("flight.PROFILE", profile.slice())
    flight = Flight(1, params=params)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    goal, yaw = estimate(flight)
    flight.run(0.5, lambda f: f.setpoint(0, goal, yaw))
    assert flight.offboard(0) == 0 and flight.arm(0) == 0
    flight.run(THESIS.STANDS_S, lambda f: f.setpoint(0, goal, yaw))
    rows, start = [], []
    for step, turn in steps.STEPS[:FLOWN]:
        goal, yaw = estimate(flight)
        goal, yaw = goal + step, yaw + math.radians(turn)
        start.append(len(rows))
        flight.run(
            steps.HOLD_S,
            lambda f, g=goal, y=yaw: (f.setpoint(0, g, y), rows.append((f.now, *estimate(f)[0], *g))),
        )
    found = np.array(rows)
    return track(
        found[:, 0] - found[0, 0], found[:, 1:4] - found[0, 1:4], found[:, 4:] - found[0, 1:4], tuple(start)
    )


def estimate(flight: Flight) -> tuple[Any, float]:
    return flight.pilots.est.p_n[0].copy(), float(yaw_from_quat(flight.pilots.est.q_nb[0]))
