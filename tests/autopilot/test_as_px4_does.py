"""Where the built-in autopilot's flight once differed from PX4's: the take-off ramp, and the torque about yaw."""

from __future__ import annotations

import numpy as np
import pytest

from arena.autopilot.control import RateControl
from arena.autopilot.landing import TakeoffRamp
from arena.autopilot.params import Params

G = 9.80665


def test_the_ramp_begins_without_thrust_and_ends_at_the_climb_rate_it_is_told():
    params = Params(2)
    ramp = TakeoffRamp(params, 2)
    armed, up = np.zeros(2), np.ones(2, bool)
    full = np.array([3.0, 1.5])  # in OFFBOARD MPC_Z_VEL_MAX_UP, else MPC_TKO_SPEED
    start = -G / params["MPC_Z_VEL_P_ACC"][0]
    assert ramp.speed_up(0.0, full) == pytest.approx([start, start])
    ramp.update(2.0, armed, up, up)  # spooled up and told to climb
    assert ramp.speed_up(2.0, full) == pytest.approx([start, start])
    assert ramp.speed_up(3.5, full) == pytest.approx((start + full) / 2)
    ramp.update(5.0, armed, ~up, up)
    assert np.isinf(ramp.speed_up(5.0, full)).all(), "through with taking off nothing is held back"


def test_torque_about_yaw_follows_with_its_time_constant_and_tilt_at_once():
    params = Params(1)
    for axis in ("ROLL", "PITCH", "YAW"):
        params.set(0, f"MC_{axis}RATE_I", 0.0)
        params.set(0, f"MC_{axis}RATE_D", 0.0)
    dt, wanted = 0.004, np.array([[0.5, 0.5, 0.5]])
    control = RateControl(params, 1, dt)
    asked = wanted[0] * [params[f"MC_{axis}RATE_P"][0] for axis in ("ROLL", "PITCH", "YAW")]
    first = control.update(np.zeros((1, 3)), wanted, np.zeros((1, 3)))[0]
    assert first[:2] == pytest.approx(asked[:2])
    after_s = 1.0 / (2 * np.pi * params["MC_YAW_TQ_CUTOFF"][0])
    for _ in range(round(after_s / dt) - 1):
        last = control.update(np.zeros((1, 3)), wanted, np.zeros((1, 3)))[0]
    assert last[2] == pytest.approx(asked[2] * (1 - np.exp(-1)), rel=0.02)
    control.reset(0)
    assert control.update(np.zeros((1, 3)), wanted * 0, np.zeros((1, 3)))[0, 2] == 0.0, "no memory of an earlier flight"
