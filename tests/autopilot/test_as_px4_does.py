"""Where the built-in autopilot once differed from PX4: take-off ramp, torque about yaw, what its battery and readiness tell."""

from __future__ import annotations

import numpy as np
import pytest
from flight import Flight

from arena.autopilot.control.controllers import RateControl
from arena.autopilot.estimation.land_detector import TakeoffRamp
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2


def test_the_ramp_begins_without_thrust_and_ends_at_the_climb_rate_it_is_told():
    params = Params(2)
    ramp = TakeoffRamp(params, 2)
    armed, up = np.zeros(2), np.ones(2, bool)
    full = np.array([3.0, 1.5])  # in OFFBOARD MPC_Z_VEL_MAX_UP, else MPC_TKO_SPEED
    start = -GRAVITY_M_S2 / params["MPC_Z_VEL_P_ACC"][0]
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
    assert control.update(np.zeros((1, 3)), wanted * 0, np.zeros((1, 3)))[0, 2] == 0.0, (
        "no memory of an earlier flight"
    )


def test_the_charge_drawn_is_told():
    flight = Flight().run(1.0)
    flight.heard[0].clear()
    drawn_a = flight.world.sense()["battery_current_a"][0]
    flight.run(60.0)
    told = [m.current_consumed for m in flight.heard[0] if m.get_type() == "BATTERY_STATUS"]
    assert told[-1] - told[0] == pytest.approx(drawn_a * 1000 / 3600 * (len(told) - 1) * 2.0, abs=1.1), (
        "mAh, told every 2 s"
    )


def test_poses_that_jump_keep_a_vehicle_on_the_ground():
    flight = Flight().run(4.0)
    assert flight.pilots.vehicles[0].ready_to_arm
    see = flight._see
    flight._see = lambda p, q: see(p + np.array([3.0, 0.0, 0.0]), q)  # type: ignore[method-assign]
    flight.run(0.5)
    assert not flight.pilots.vehicles[0].ready_to_arm
    assert flight.arm(0) != 0
