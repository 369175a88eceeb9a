"""Decoding of offboard setpoint messages."""

from __future__ import annotations

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.control.setpoints import Level
from arena.autopilot.mavlink.offboard_setpoints import from_attitude_target, from_position_target
from arena.geometry import euler_from_quat, quat_from_euler

GENERIC_RPY = np.radians([10.0, -20.0, 35.0])


def test_body_velocity_is_rotated_by_yaw_alone_and_position_ignored():
    q = quat_from_euler([0.3, -0.2, np.pi / 2]).tolist()
    m = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0b010111000000, 9, 9, 9, 1, 0, 0.5, 0, 0, 0, 0, 0.2
    )
    o = from_position_target(m, q)
    assert np.all(np.isnan(o.p_n))
    assert np.allclose(o.v_n, [0, 1, 0.5], atol=1e-9)


def test_attitude_targets_are_normalised_and_invalid_ones_refused():
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
