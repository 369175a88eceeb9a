"""What leaves for the autopilot, as pymavlink's decoder reads it back; and what does not leave."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import SetpointError
from arena.geometry import quat_from_euler
from arena.uav.setpoints import Encoder, attitude, duration_s, period_s, scalar, vector

BITS = "POSITION_TARGET_TYPEMASK_"
IGNORE = {name.removeprefix(BITS): getattr(mavlink, name) for name in dir(mavlink) if name.startswith(BITS)}
ENCODER = Encoder(7)
NOW = 12.3456


def on_the_wire(message):
    data = message.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=191))
    return mavlink.MAVLink(None).decode(bytearray(data)), bytes(data)


def mask(*names: str) -> int:
    return sum(IGNORE[f"{name}_IGNORE"] for name in names)


def test_a_position_is_in_local_ned_and_ignores_all_but_position_and_yaw():
    m, _ = on_the_wire(ENCODER.pos_yaw([1, 2, -3], 0.5, NOW))
    assert (m.get_type(), m.coordinate_frame, m.target_system, m.target_component) == (
        "SET_POSITION_TARGET_LOCAL_NED",
        1,
        7,
        1,
    )
    assert m.type_mask == mask("VX", "VY", "VZ", "AX", "AY", "AZ", "YAW_RATE")
    assert (m.x, m.y, m.z, m.yaw) == pytest.approx((1, 2, -3, 0.5))
    assert m.time_boot_ms == 12345


def test_a_velocity_is_in_local_ned_and_ignores_all_but_velocity_and_yaw():
    m, _ = on_the_wire(ENCODER.vel_yaw([1, 2, -3], -0.5, NOW))
    assert (m.coordinate_frame, m.type_mask) == (1, mask("X", "Y", "Z", "AX", "AY", "AZ", "YAW_RATE"))
    assert (m.vx, m.vy, m.vz, m.yaw) == pytest.approx((1, 2, -3, -0.5))


def test_a_body_velocity_is_in_body_ned_and_ignores_the_yaw():
    m, _ = on_the_wire(ENCODER.vel_body_yaw_rate([1, 2, -3], 0.7, NOW))
    assert (m.coordinate_frame, m.type_mask) == (
        mavlink.MAV_FRAME_BODY_NED,
        mask("X", "Y", "Z", "AX", "AY", "AZ", "YAW"),
    )
    assert (m.vx, m.vy, m.vz, m.yaw_rate) == pytest.approx((1, 2, -3, 0.7))


def test_an_attitude_ignores_the_rates_and_keeps_the_order_wxyz():
    q_nb = quat_from_euler(np.radians([10, -20, 35]))
    m, _ = on_the_wire(ENCODER.att_thrust(q_nb, 0.6, NOW))
    ignored = ("BODY_ROLL_RATE", "BODY_PITCH_RATE", "BODY_YAW_RATE")
    assert m.type_mask == sum(getattr(mavlink, f"ATTITUDE_TARGET_TYPEMASK_{name}_IGNORE") for name in ignored)
    assert list(m.q) == pytest.approx(q_nb.tolist(), abs=1e-6)
    assert m.thrust == pytest.approx(0.6)


def test_body_rates_ignore_the_attitude():
    m, _ = on_the_wire(ENCODER.ang_vel_thrust([0.1, 0.2, 0.3], 0.6, NOW))
    assert m.type_mask == mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    assert (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate, m.thrust) == pytest.approx(
        (0.1, 0.2, 0.3, 0.6)
    )


def test_golden_bytes_of_a_position():
    data = on_the_wire(ENCODER.pos_yaw([1.0, 0.0, -1.5], 0.25, 1.0))[1]
    assert data == bytes.fromhex(
        "fd 35 00 00 00 07 bf 54 00 00"  # MAVLink 2, 53 bytes, from 7/191, message 84
        "e8 03 00 00"  # 1000 ms
        "00 00 80 3f 00 00 00 00 00 00 c0 bf"  # 1, 0, -1.5
        "00 00 00 00 00 00 00 00 00 00 00 00"  # velocity
        "00 00 00 00 00 00 00 00 00 00 00 00"  # acceleration
        "00 00 80 3e 00 00 00 00"  # yaw 0.25, yaw rate
        "f8 09 07 01 01"  # ignore velocity, acceleration, yaw rate; to 7/1; LOCAL_NED
        "4c d3"
    )


@pytest.mark.parametrize(
    "good", [[1, 2, 3], (1, 2, 3), np.array([1, 2, 3]), np.array([[1], [2], [3]]), [[1], [2], [3]]]
)
def test_rows_and_columns_are_both_vectors(good):
    assert vector(good, "pos").tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("bad", "found"),
    [
        ([1, 2], r"\(2,\)"),
        ([[1, 2, 3]], r"\(1, 3\)"),
        (np.zeros((3, 3)), r"\(3, 3\)"),
        (1.0, r"\(\)"),
        ([1, 2, np.nan], "nan"),
        ([1, np.inf, 2], "inf"),
        ("abc", "abc"),
        ([1, [2], 3], r"\[1, \[2\], 3\]"),
        (None, "nan|None|shape"),
        ([1, 2, "x"], "x"),
    ],
)
def test_anything_else_is_refused_with_what_was_found(bad, found):
    with pytest.raises(SetpointError, match=found) as caught:
        vector(bad, "pos")
    assert str(caught.value).startswith("pos: got")


@given(arrays(np.float64, (3,), elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_nothing_that_is_not_finite_ever_leaves(value):
    try:
        m = ENCODER.pos_yaw(value, 0.0, 0.0)
    except SetpointError:
        assert not np.isfinite(value).all()
    else:
        assert np.isfinite([m.x, m.y, m.z]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, [1, 2], "fast", None])
def test_a_yaw_is_one_finite_number(bad):
    with pytest.raises(SetpointError, match=r"^yaw: got"):
        scalar(bad, "yaw")


def test_a_number_in_a_column_is_a_number():
    assert scalar(np.array([[0.5]]), "yaw") == 0.5


@pytest.mark.parametrize("bad", [0, -1, np.nan, 1e6])
def test_a_rate_that_is_none_is_refused(bad):
    with pytest.raises(SetpointError, match=r"^freq: got"):
        period_s(bad)


def test_a_time_does_not_run_backwards():
    with pytest.raises(SetpointError, match=r"^time: got -1"):
        duration_s(-1)


def test_attitudes_by_angles_and_by_quaternion_agree():
    rpy = np.radians([10, -20, 35])
    assert attitude(rpy, "euler") == pytest.approx(attitude(2.0 * quat_from_euler(rpy), "quaternion"))


@pytest.mark.parametrize(
    ("att", "kind", "found"),
    [
        ([0] * 4, "quaternion", "no rotation"),
        ([0] * 3, "degrees", "'degrees'"),
        ([0] * 3, "quaternion", r"\(3,\)"),
    ],
)
def test_what_is_no_attitude_is_refused(att, kind, found):
    with pytest.raises(SetpointError, match=found):
        attitude(att, kind)


@pytest.mark.parametrize("output", [[2.0], [0.1] * 9, [], [np.nan]])
def test_motor_commands_beyond_their_range_are_refused(output):
    with pytest.raises(SetpointError, match=r"^output: got"):
        ENCODER.act(0, output, 0.0)
