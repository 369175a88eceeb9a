"""ControlAllocator, attitude from thrust, setpoints off the wire: the places where a sign or an order goes wrong."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import AttitudeControl, attitude_from_thrust
from arena.autopilot.control.setpoints import Level
from arena.autopilot.mavlink.offboard_setpoints import from_attitude_target, from_position_target
from arena.autopilot.param_table import Params
from arena.geometry import (
    euler_from_quat,
    matrix_from_quat,
    quat_conj,
    quat_exp,
    quat_from_euler,
    quat_multiply,
    quat_rotate,
)
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


def test_the_rows_of_a_symmetric_quad_are_px4s():
    assert np.allclose(np.abs(ALLOCATION(QUAD_X)), [[0.7071, 0.7071, 1.0]] * 4, atol=1e-4)


def test_roll_lifts_the_left_rotors_pitch_the_front_and_yaw_the_ccw_ones():
    u, _ = mixer().allocate(np.array([[0.1, 0.0, 0.0]]), np.array([0.5]))
    assert u[0, 1] > 0.5 > u[0, 0]
    assert u[0, 2] > 0.5 > u[0, 3]
    u, _ = mixer().allocate(np.array([[0.0, 0.1, 0.0]]), np.array([0.5]))
    assert u[0, 0] > 0.5 > u[0, 1]
    u, _ = mixer().allocate(np.array([[0.0, 0.0, 0.1]]), np.array([0.5]))
    assert u[0, 0] > 0.5 > u[0, 2]


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.floats(0, 1))
def test_commands_stay_in_range_and_yaw_gives_way_to_tilt(torque, thrust):
    u, _ = mixer().allocate(np.array([torque]), np.array([thrust]))
    assert np.all((u >= 0) & (u <= 1))
    no_yaw, _ = mixer().allocate(np.array([[*torque[:2], 0.0]]), np.array([thrust]))
    rows = ALLOCATION(QUAD_X)[:, :2]
    assert np.allclose(u @ rows, no_yaw @ rows, atol=1e-9)


@given(st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2), st.floats(-3.1, 3.1))
def test_attitude_from_thrust_opposes_the_thrust_and_keeps_the_heading(tilt, yaw):
    thrust = np.array([[*tilt, -1.0]])
    q = attitude_from_thrust(thrust, np.array([yaw]))
    assert np.allclose(quat_rotate(q, [0, 0, -1.0]), thrust / np.linalg.norm(thrust))
    nose = quat_rotate(q, [1.0, 0, 0])[0]
    assert (
        abs(
            np.arctan2(np.sin(np.arctan2(nose[1], nose[0]) - yaw), np.cos(np.arctan2(nose[1], nose[0]) - yaw))
        )
        < 0.35
    )


def test_attitude_control_turns_towards_the_setpoint_at_a_generic_attitude():
    control = AttitudeControl(Params(3))
    q = np.tile(quat_from_euler(GENERIC_RPY), (3, 1))
    q_sp = np.stack([quat_multiply(q[0], quat_exp(0.1 * axis)) for axis in np.eye(3)])
    rates = control.update(q, matrix_from_quat(q), q_sp, np.zeros(3))
    assert np.all(np.diag(rates) > 0.2)
    # Roll and pitch errors are met along their own axis; yaw, weighted down, may lag.
    assert np.abs(rates[0, 1:]).max() < 0.2 * rates[0, 0]
    assert np.abs(rates[1, [0, 2]]).max() < 0.2 * rates[1, 1]


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.sampled_from([0.1, 0.4, 1.0]))
def test_attitude_control_meets_the_tilt_by_the_shortest_way_and_the_yaw_that_is_left_by_its_weight(
    turns, weight
):
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
    rates = AttitudeControl(params).update(q[None], matrix_from_quat(q)[None], q_sp[None], np.zeros(1))[0]
    assert np.allclose(rates, np.clip(wanted, -limits, limits), atol=1e-9)


def test_body_setpoints_turn_by_yaw_alone_and_their_position_is_ignored():
    q = quat_from_euler([0.3, -0.2, np.pi / 2]).tolist()
    m = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0b010111000000, 9, 9, 9, 1, 0, 0.5, 0, 0, 0, 0, 0.2
    )
    o = from_position_target(m, q)
    assert np.all(np.isnan(o.p_n))
    assert np.allclose(o.v_n, [0, 1, 0.5], atol=1e-9)


def test_attitude_targets_are_normalised_and_nonsense_refused():
    q = quat_from_euler(GENERIC_RPY)
    o = from_attitude_target(
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, (1.5 * q).tolist(), 0, 0, 0, 2.0)
    )
    assert o.level is Level.ATTITUDE
    assert np.allclose(euler_from_quat(np.array(o.q_nb)), GENERIC_RPY)
    assert o.thrust == 1.0
    for bad in ([0, 0, 0, 0], [float("nan"), 0, 0, 1]):
        assert isinstance(
            from_attitude_target(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, bad, 0, 0, 0, 0.5)),
            str,
        )
    no_thrust = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 71, q.tolist(), 0, 0, 0, 0.5)
    assert isinstance(from_attitude_target(no_thrust), str)
