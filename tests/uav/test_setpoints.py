"""Setpoints as pymavlink decodes them, and values that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import SetpointError
from arena.geometry import quat_from_euler
from arena.uav.setpoints import Encoder, attitude, duration_s, numbers, period_s, scalar, vector

BITS = "POSITION_TARGET_TYPEMASK_"
IGNORE = {name.removeprefix(BITS): getattr(mavlink, name) for name in dir(mavlink) if name.startswith(BITS)}
ENCODER = Encoder(7)
NOW = 12.3456


def encoded(message):
    data = message.pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=191))
    return mavlink.MAVLink(None).decode(bytearray(data)), bytes(data)


def mask(*names: str) -> int:
    return sum(IGNORE[f"{name}_IGNORE"] for name in names)


def plain_message(message):
    """Return the same setpoint as a message of pymavlink's class."""
    return mavlink.mavlink_map[message.id](*(getattr(message, name) for name in message.get_fieldnames()))


@given(st.lists(st.floats(-1e3, 1e3) | st.just(0.0), min_size=8, max_size=8), st.integers(0, 255))
def test_setpoint_is_packed_to_the_bytes_of_pymavlink(values, seq):
    p, v, (yaw, rate) = values[:3], values[3:6], values[6:]
    for message in (
        ENCODER.pos_vel_yaw(p, v, yaw, NOW, acc=v, yaw_rate=rate),
        ENCODER.pos_yaw(p, 0.0, NOW),
        ENCODER.vel_body_yaw_rate(v, rate, NOW),
        ENCODER.att_thrust(quat_from_euler(np.array(p)), 0.5, NOW),
        ENCODER.ang_vel_thrust(v, 0.0, NOW),
    ):
        sender = mavlink.MAVLink(None, srcSystem=7, srcComponent=191)
        sender.seq = seq
        assert message.pack(sender) == plain_message(message).pack(sender)
        sender.signing.secret_key, sender.signing.sign_outgoing = bytes(32), True
        assert message.pack(sender)[:10] == plain_message(message).pack(sender)[:10], "a signed frame"


@pytest.mark.parametrize(
    "value",
    [
        [1, 2.5, -3],
        (1.0, np.float64(2.5), np.float32(0.1)),
        [True, 2.0, 3.0],
        ["1", "2", "3"],
        [2**60 + 1, 0, 0],
        np.array([1, 2, 3]),
        np.array([[1.0], [2.0], [3.0]]),
        [[1.0], [2.0], [3.0]],
    ],
)
def test_numbers_are_the_elements_of_the_vector(value):
    found = numbers(value, "pos")
    assert found == vector(value, "pos").tolist() and {type(x) for x in found} == {float}


@pytest.mark.parametrize("value", [[1, 2], [1.0, 2.0, float("nan")], (1.0, 2.0, 1j), "abc", [None] * 3, 5.0])
def test_numbers_raise_the_errors_of_the_vector(value):
    with pytest.raises(SetpointError) as expected:
        vector(value, "pos")
    with pytest.raises(SetpointError) as found:
        numbers(value, "pos")
    assert str(found.value) == str(expected.value)


def test_position_setpoint_ignores_all_but_position_and_yaw():
    m, _ = encoded(ENCODER.pos_yaw([1, 2, -3], 0.5, NOW))
    assert (m.get_type(), m.coordinate_frame, m.target_system, m.target_component) == (
        "SET_POSITION_TARGET_LOCAL_NED",
        1,
        7,
        1,
    )
    assert m.type_mask == mask("VX", "VY", "VZ", "AX", "AY", "AZ", "YAW_RATE")
    assert (m.x, m.y, m.z, m.yaw) == pytest.approx((1, 2, -3, 0.5))
    assert m.time_boot_ms == 12345


def test_velocity_setpoint_ignores_all_but_velocity_and_yaw():
    m, _ = encoded(ENCODER.vel_yaw([1, 2, -3], -0.5, NOW))
    assert (m.coordinate_frame, m.type_mask) == (1, mask("X", "Y", "Z", "AX", "AY", "AZ", "YAW_RATE"))
    assert (m.vx, m.vy, m.vz, m.yaw) == pytest.approx((1, 2, -3, -0.5))


def test_trajectory_setpoint_ignores_acceleration_and_yaw_rate_by_default():
    m, _ = encoded(ENCODER.pos_vel_yaw([1, 2, -3], [0.1, 0.2, 0.3], 0.5, NOW))
    assert (m.coordinate_frame, m.type_mask) == (1, mask("AX", "AY", "AZ", "YAW_RATE"))
    assert (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw) == pytest.approx((1, 2, -3, 0.1, 0.2, 0.3, 0.5))


def test_trajectory_setpoint_carries_acceleration_and_yaw_rate():
    m, _ = encoded(ENCODER.pos_vel_yaw([1, 2, -3], [0, 0, 0], 0.5, NOW, acc=[4, 5, 6], yaw_rate=0.7))
    assert m.type_mask == 0
    assert (m.afx, m.afy, m.afz, m.yaw_rate) == pytest.approx((4, 5, 6, 0.7))


def test_reference_ignores_what_it_does_not_have():
    m, _ = encoded(ENCODER.reference([1, 2, -3], None, 0.5, NOW))
    assert (m.get_type(), m.coordinate_frame, m.time_boot_ms) == ("POSITION_TARGET_LOCAL_NED", 1, 12345)
    assert m.type_mask == mask("VX", "VY", "VZ", "AX", "AY", "AZ", "YAW_RATE")
    assert (m.x, m.y, m.z, m.yaw) == pytest.approx((1, 2, -3, 0.5))
    m, _ = encoded(ENCODER.reference(None, [1, 2, 3], None, NOW))
    assert m.type_mask == mask("X", "Y", "Z", "AX", "AY", "AZ", "YAW", "YAW_RATE")


def test_empty_reference_is_refused():
    with pytest.raises(SetpointError, match="at least one of p, v and yaw"):
        ENCODER.reference(None, None, None, NOW)


def test_body_velocity_setpoint_is_in_body_ned_and_ignores_yaw():
    m, _ = encoded(ENCODER.vel_body_yaw_rate([1, 2, -3], 0.7, NOW))
    assert (m.coordinate_frame, m.type_mask) == (
        mavlink.MAV_FRAME_BODY_NED,
        mask("X", "Y", "Z", "AX", "AY", "AZ", "YAW"),
    )
    assert (m.vx, m.vy, m.vz, m.yaw_rate) == pytest.approx((1, 2, -3, 0.7))


def test_attitude_setpoint_is_wxyz_and_ignores_the_rates():
    q_nb = quat_from_euler(np.radians([10, -20, 35]))
    m, _ = encoded(ENCODER.att_thrust(q_nb, 0.6, NOW))
    ignored = ("BODY_ROLL_RATE", "BODY_PITCH_RATE", "BODY_YAW_RATE")
    assert m.type_mask == sum(getattr(mavlink, f"ATTITUDE_TARGET_TYPEMASK_{name}_IGNORE") for name in ignored)
    assert list(m.q) == pytest.approx(q_nb.tolist(), abs=1e-6)
    assert m.thrust == pytest.approx(0.6)


def test_rate_setpoint_ignores_the_attitude():
    m, _ = encoded(ENCODER.ang_vel_thrust([0.1, 0.2, 0.3], 0.6, NOW))
    assert m.type_mask == mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    assert (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate, m.thrust) == pytest.approx(
        (0.1, 0.2, 0.3, 0.6)
    )


def test_golden_bytes_of_a_position_setpoint():
    data = encoded(ENCODER.pos_yaw([1.0, 0.0, -1.5], 0.25, 1.0))[1]
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
def test_vectors_may_be_rows_or_columns(good):
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
def test_wrong_shape_is_refused_with_what_was_found(bad, found):
    with pytest.raises(SetpointError, match=found) as caught:
        vector(bad, "pos")
    assert str(caught.value).startswith("pos: got")


@given(arrays(np.float64, (3,), elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_value_that_is_not_finite_is_refused(value):
    try:
        m = ENCODER.pos_yaw(value, 0.0, 0.0)
    except SetpointError:
        assert not np.isfinite(value).all()
    else:
        assert np.isfinite([m.x, m.y, m.z]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, [1, 2], "fast", None])
def test_yaw_must_be_one_finite_number(bad):
    with pytest.raises(SetpointError, match=r"^yaw: got"):
        scalar(bad, "yaw")


def test_number_may_be_a_column():
    assert scalar(np.array([[0.5]]), "yaw") == 0.5


@pytest.mark.parametrize("bad", [0, -1, np.nan, 1e6])
def test_invalid_rate_is_refused(bad):
    with pytest.raises(SetpointError, match=r"^freq: got"):
        period_s(bad)


def test_negative_duration_is_refused():
    with pytest.raises(SetpointError, match=r"^time: got -1"):
        duration_s(-1)


def test_euler_and_quaternion_attitudes_agree():
    rpy = np.radians([10, -20, 35])
    assert attitude(rpy, "euler") == pytest.approx(attitude(2.0 * quat_from_euler(rpy), "quaternion"))


@pytest.mark.parametrize(
    ("att", "kind", "found"),
    [
        ([0] * 4, "quaternion", "norm above zero"),
        ([0] * 3, "degrees", "'degrees'"),
        ([0] * 3, "quaternion", r"\(3,\)"),
    ],
)
def test_invalid_attitude_is_refused(att, kind, found):
    with pytest.raises(SetpointError, match=found):
        attitude(att, kind)


@pytest.mark.parametrize("output", [[2.0], [0.1] * 9, [], [np.nan]])
def test_actuator_values_out_of_range_are_refused(output):
    with pytest.raises(SetpointError, match=r"^output: got"):
        ENCODER.act(0, output, 0.0)
