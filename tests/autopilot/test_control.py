"""Control allocation, attitude and rate control, take-off ramp: signs, orders and time constants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import (
    AttitudeControl,
    PositionControl,
    RateControl,
)
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import TakeoffRamp
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.geometry import (
    matrix_from_quat,
    quat_conj,
    quat_exp,
    quat_from_euler,
    quat_multiply,
    quat_rotate,
)
from arena.kernels.position_control import attitude_from_thrust
from arena.vehicle_models import VEHICLE_MODELS

QUAD_X = [
    {"position_m": [0.2, 0.2, 0.0], "direction": "ccw"},
    {"position_m": [-0.2, -0.2, 0.0], "direction": "ccw"},
    {"position_m": [0.2, -0.2, 0.0], "direction": "cw"},
    {"position_m": [-0.2, 0.2, 0.0], "direction": "cw"},
]
ALLOCATION = VEHICLE_MODELS["multirotor"].allocation
GENERIC_RPY = np.radians([10.0, -20.0, 35.0])


def mixer() -> ControlAllocator:
    return ControlAllocator(ALLOCATION(QUAD_X)[None], np.ones((1, 4), bool))


def test_rows_of_a_symmetric_quadrotor_are_px4s():
    assert np.allclose(np.abs(ALLOCATION(QUAD_X)), [[0.7071, 0.7071, 1.0]] * 4, atol=1e-4)


def test_roll_lifts_left_pitch_lifts_front_yaw_lifts_ccw_rotors():
    u, _ = mixer().allocate(np.array([[0.1, 0.0, 0.0]]), np.array([0.5]))
    assert u[0, 1] > 0.5 > u[0, 0]
    assert u[0, 2] > 0.5 > u[0, 3]
    u, _ = mixer().allocate(np.array([[0.0, 0.1, 0.0]]), np.array([0.5]))
    assert u[0, 0] > 0.5 > u[0, 1]
    u, _ = mixer().allocate(np.array([[0.0, 0.0, 0.1]]), np.array([0.5]))
    assert u[0, 0] > 0.5 > u[0, 2]


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.floats(0, 1))
def test_motor_commands_stay_in_range_and_tilt_has_priority_over_yaw(torque, thrust):
    u, _ = mixer().allocate(np.array([torque]), np.array([thrust]))
    assert np.all((u >= 0) & (u <= 1))
    no_yaw, _ = mixer().allocate(np.array([[*torque[:2], 0.0]]), np.array([thrust]))
    rows = ALLOCATION(QUAD_X)[:, :2]
    assert np.allclose(u @ rows, no_yaw @ rows, atol=1e-9)


@pytest.mark.parametrize("yaw", [0.3, -0.3])
def test_full_thrust_leaves_15_percent_for_yaw(yaw):
    u, short = mixer().allocate(np.array([[0.0, 0.0, yaw]]), np.array([1.0]))
    weights = ALLOCATION(QUAD_X)[:, 2]
    assert u[0] @ weights / (weights @ weights) == pytest.approx(0.15 * np.sign(yaw))
    assert u.max() == pytest.approx(1.0) and short[0, 2] == np.sign(yaw)


def test_small_yaw_torque_takes_no_thrust_below_full_thrust():
    u, short = mixer().allocate(np.array([[0.0, 0.0, 0.1]]), np.array([0.9]))
    assert u.mean() == pytest.approx(0.9) and not short.any()


def velocity_setpoint(p_n, v_n, limit):
    """Return the velocity setpoint of the position controller for a vehicle at rest at the origin [m/s] [NED] (3,)."""
    params = Params(1)
    params.set(0, "MPC_XY_VEL_MAX", limit)
    params.set(0, "MPC_XY_P", 1.0)
    control, sp = PositionControl(params, 1, 0.008), Setpoints(1)
    sp.set_position(0, p_n=p_n, v_n=v_n, yaw=0.0)
    control.update(sp, Estimator(params, 1, 0.004))
    return control.v_sp_n[0]


@pytest.mark.parametrize(
    ("error", "feed", "result"),
    [
        ((2.0, 0.0), (0.0, 1.0), (1.0, 0.0)),  # the correction alone reaches the limit
        ((0.6, 0.0), (0.0, 2.0), (0.6, 0.8)),  # the feed-forward is shortened
        ((0.6, 0.0), (2.0, 0.0), (1.0, 0.0)),
        ((0.0, 0.0), (0.0, 2.0), (0.0, 1.0)),
        ((2.0, 0.0), (-1.5, 0.0), (0.5, 0.0)),  # the sum is below the limit
        ((0.3, 0.0), (0.0, 0.4), (0.3, 0.4)),
    ],
)
def test_velocity_limit_gives_priority_to_the_position_correction(error, feed, result):
    assert velocity_setpoint((*error, 0.0), (*feed, 0.0), 1.0)[:2] == pytest.approx(result)


@pytest.mark.parametrize("east", [0.0, 0.3])
def test_vertical_integral_stops_while_thrust_saturates(east):
    """With a horizontal setpoint the limit of the vertical thrust is below MPC_THR_MAX, and the integral stops too."""
    params = Params(1)
    params.set(0, "MPC_THR_HOVER", 0.7)
    est, sp = Estimator(params, 1, 0.004), Setpoints(1)
    est.v_n[:] = [0.0, 0.0, -1.0]  # it cannot climb faster
    sp.set_position(0, v_n=(0.0, east, -3.0), yaw=0.0)
    control = PositionControl(params, 1, 0.008)
    for _ in range(500):
        control.update(sp, est)
    assert np.linalg.norm(control.thrust_n) == pytest.approx(1.0)
    assert control.integral[0, 2] > -GRAVITY_M_S2 / 2


@given(st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2), st.floats(-3.1, 3.1))
def test_attitude_from_thrust_is_opposite_to_it_and_keeps_the_heading(tilt, yaw):
    thrust = np.array([[*tilt, -1.0]])
    q = np.array([attitude_from_thrust(*thrust[0], yaw)])
    assert np.allclose(quat_rotate(q, [0, 0, -1.0]), thrust / np.linalg.norm(thrust))
    nose = quat_rotate(q, [1.0, 0, 0])[0]
    assert (
        abs(
            np.arctan2(np.sin(np.arctan2(nose[1], nose[0]) - yaw), np.cos(np.arctan2(nose[1], nose[0]) - yaw))
        )
        < 0.35
    )


def test_attitude_control_turns_towards_the_setpoint():
    control = AttitudeControl(Params(3), 3)
    q = np.tile(quat_from_euler(GENERIC_RPY), (3, 1))
    q_sp = np.stack([quat_multiply(q[0], quat_exp(0.1 * axis)) for axis in np.eye(3)])
    rates = control.update(q, matrix_from_quat(q), q_sp, np.zeros(3))
    assert np.all(np.diag(rates) > 0.2)
    # Roll and pitch errors are met along their own axis; yaw, weighted down, may lag.
    assert np.abs(rates[0, 1:]).max() < 0.2 * rates[0, 0]
    assert np.abs(rates[1, [0, 2]]).max() < 0.2 * rates[1, 1]


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.sampled_from([0.1, 0.4, 1.0]))
def test_attitude_control_corrects_tilt_first_and_yaw_by_its_weight(turns, weight):
    params = Params(1)
    params.set(0, "MC_YAW_WEIGHT", weight)
    q, q_sp = quat_exp(turns[:3]), quat_exp(turns[3:])
    z, z_sp = quat_rotate(q, [0, 0, 1.0]), quat_rotate(q_sp, [0, 0, 1.0])
    tilt = np.array([1.0 + z @ z_sp, *np.cross(z, z_sp)])
    reduced = quat_multiply(tilt / np.linalg.norm(tilt), q)
    left = quat_multiply(quat_conj(reduced), q_sp)
    half = weight * np.arctan(left[3] / left[0])
    error = quat_multiply(quat_conj(q), quat_multiply(reduced, [np.cos(half), 0, 0, np.sin(half)]))
    gains = [float(params[f"MC_{axis}_P"][0]) for axis in ("ROLL", "PITCH", "YAW")]
    limits = np.radians([float(params[f"MC_{axis}RATE_MAX"][0]) for axis in ("ROLL", "PITCH", "YAW")])
    wanted = 2.0 * np.sign(error[0]) * error[1:] * gains / [1.0, 1.0, weight]
    rates = AttitudeControl(params, 1).update(q[None], matrix_from_quat(q)[None], q_sp[None], np.zeros(1))[0]
    assert np.allclose(rates, np.clip(wanted, -limits, limits), atol=1e-9)


def test_takeoff_ramp_begins_without_thrust_and_ends_at_the_full_rate():
    params = Params(2)
    ramp = TakeoffRamp(params, 2)
    armed, up = np.zeros(2), np.ones(2, bool)
    offboard = np.array([True, False])
    full = np.array([params["MPC_Z_VEL_MAX_UP"][0], params["MPC_TKO_SPEED"][1]])
    assert full[0] > full[1]
    start = -GRAVITY_M_S2 / params["MPC_Z_VEL_P_ACC"][0]
    assert ramp.climb_rate_limit(0.0, offboard) == pytest.approx([start, start])
    ramp.update(2.0, armed, up, up)  # spooled up, with a setpoint to climb
    assert ramp.climb_rate_limit(2.0, offboard) == pytest.approx([start, start])
    assert ramp.climb_rate_limit(3.5, offboard) == pytest.approx((start + full) / 2)
    ramp.update(5.0, armed, ~up, up)
    assert np.isinf(ramp.climb_rate_limit(5.0, offboard)).all(), "no limit after the take-off"


def test_yaw_torque_is_filtered_and_tilt_torque_is_not():
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
