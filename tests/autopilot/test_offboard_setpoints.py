"""Decoding of offboard setpoint messages."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.mavlink.offboard_setpoints import receive_setpoint
from arena.geometry import euler_from_quat, quat_from_euler
from arena.kernels.arrays import array

GENERIC_RPY = np.radians([10.0, -20.0, 35.0])
LOCAL, BODY = 1, 8
NAN = math.nan


def vehicle(q_nb: Any = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """Return what the decoders use of a vehicle: the store of setpoints, row and time."""
    setpoints = Setpoints(1)
    offboard = setpoints.offboard_setpoints(np.array([q_nb], float))
    return SimpleNamespace(offboard=offboard, setpoints=setpoints, row=0, now=5.0, heading=0.0, home_n=None)


def receive(v: Any, mask: int, frame: int, *values: float) -> str | None:
    """Store a position setpoint. values: position, velocity, acceleration, yaw, yaw rate (11,)"""
    array(v.offboard.target)[:] = values
    refusal: str | None = v.offboard.set_local_target(0, mask, frame, 5.0)
    v.offboard.copy(0)
    return refusal


def test_body_velocity_is_rotated_by_yaw_alone_and_position_ignored():
    v = vehicle(quat_from_euler([0.3, -0.2, np.pi / 2]))
    assert receive(v, 0b010111000000, BODY, 9, 9, 9, 1, 0, 0.5, 0, 0, 0, 0, 0.2) is None
    assert np.all(np.isnan(v.setpoints.p_n[0]))
    assert np.allclose(v.setpoints.v_n[0], [0, 1, 0.5], atol=1e-9)
    assert v.setpoints.yaw_rate[0] == 0.2 and v.offboard.contents[0] == 2


def test_body_acceleration_is_rotated_by_the_whole_attitude():
    q = quat_from_euler(GENERIC_RPY)
    v = vehicle(q)
    assert receive(v, 0b110000111111, BODY, *[9.0] * 6, 0.3, -0.4, 0.5, 0, 0) is None
    roll, pitch, yaw = GENERIC_RPY
    cr, sr, cp, sp, cy, sy = (f(x) for x in (roll, pitch, yaw) for f in (math.cos, math.sin))
    matrix = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    assert np.allclose(v.setpoints.a_n[0], np.array(matrix) @ [0.3, -0.4, 0.5], atol=1e-9)


@pytest.mark.parametrize(
    ("mask", "frame", "values", "refusal"),
    [
        (0, 7, [0.0] * 11, "coordinate frame 7 is not supported"),
        (0, LOCAL, [1e30, *[0.0] * 10], "infinite value in setpoint"),
        (0, LOCAL, [*[0.0] * 9, math.inf, 0.0], "infinite value in setpoint"),
        (0x3F | 1 << 9, LOCAL, [0.0] * 11, "force setpoints are not supported"),
        (0x1FF, LOCAL, [0.0] * 11, "setpoint without position, velocity or acceleration"),
        (0, LOCAL, [NAN] * 11, "setpoint without position, velocity or acceleration"),
    ],
)
def test_setpoint_that_px4_would_not_fly_is_refused_and_not_stored(mask, frame, values, refusal):
    v = vehicle()
    assert receive(v, mask, frame, *values) == refusal
    assert v.offboard.level[0] == 0 and v.offboard.received_at[0] < 0.0
    assert v.setpoints.level[0] == Level.NONE


@pytest.mark.parametrize("mask", [0b110111111100, 0b110111111010, 0b110111000001, 0b110000111001])
def test_incomplete_setpoint_stops_the_vehicle(mask):
    v = vehicle()
    assert receive(v, mask, LOCAL, *[1.0] * 11) is None
    assert np.isnan(v.setpoints.p_n[0]).all() and np.isnan(v.setpoints.a_n[0]).all()
    assert v.setpoints.v_n[0].tolist() == [0.0, 0.0, 0.0]
    assert math.isnan(v.setpoints.yaw[0]) and v.offboard.contents[0] == 2


def test_a_new_setpoint_leaves_nothing_of_the_one_before():
    v = vehicle()
    attitude = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 3, [0, 0, 0, 1], 0, 0, 0.3, 0.7)
    assert receive_setpoint(attitude, v) is None
    v.offboard.copy(0)
    assert v.setpoints.yaw_rate_ff[0] == pytest.approx(0.3) and v.offboard.contents[0] == 8
    assert receive(v, 0b110111111000, LOCAL, 1.0, 2.0, -3.0, *[0.0] * 8) is None
    assert v.setpoints.level[0] == Level.POSITION and v.setpoints.p_n[0].tolist() == [1.0, 2.0, -3.0]
    assert v.setpoints.q_nb[0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert v.setpoints.thrust[0] == v.setpoints.yaw_rate_ff[0] == 0.0
    assert np.isnan((v.setpoints.yaw[0], v.setpoints.yaw_rate[0])).all()
    assert v.offboard.contents[0] == 1 and v.offboard.received_at[0] == 5.0


def test_attitude_targets_are_normalised_and_invalid_ones_refused():
    q, v = quat_from_euler(GENERIC_RPY), vehicle()
    m = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, (1.5 * q).tolist(), 0, 0, 0, 2.0)
    assert receive_setpoint(m, v) is None
    v.offboard.copy(0)
    assert v.setpoints.level[0] == Level.ATTITUDE
    assert np.allclose(euler_from_quat(v.setpoints.q_nb[0]), GENERIC_RPY)
    assert v.setpoints.thrust[0] == 1.0
    for bad in ([0, 0, 0, 0], [NAN, 0, 0, 1]):
        m = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, bad, 0, 0, 0, 0.5)
        assert receive_setpoint(m, v)
    no_thrust = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 71, q.tolist(), 0, 0, 0, 0.5)
    assert receive_setpoint(no_thrust, v)
    assert v.offboard.thrust[0] == 1.0
