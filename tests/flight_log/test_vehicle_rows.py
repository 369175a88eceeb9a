"""Rows of a log from recorded messages, poses and true states. The row times of a simulated vehicle are those of its true states."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from record_files import UAV1
from recorded_flights import LEVEL, OFFBOARD, STEPS, ZERO, stream

from arena.flight_log.columns import RPY, WXYZ
from arena.flight_log.flight import Flight
from arena.flight_log.vehicle_record import VehicleRecord
from arena.flight_log.vehicle_rows import make_flight_of
from arena.geometry import Array, euler_from_quat, quat_from_euler
from arena.wire.flight_record import pack_true_state


def recorded(ref: tuple[float, ...] = STEPS[0], boot_s: float = 1.0, received: float = 1.0) -> VehicleRecord:
    """The record of one datagram with all messages."""
    record = VehicleRecord(UAV1)
    record.add_down(received, stream(boot_s, np.zeros(3), ref, OFFBOARD, True, False))
    return record


def rows(record: VehicleRecord, *at: float, truth: Array | None = None) -> Flight:
    """The log with rows at some times. truth: p_n, v_n, q_nb, omega_b of all true states (13,)."""
    values = np.concatenate([ZERO, ZERO, LEVEL, ZERO]) if truth is None else truth
    for t in at:
        record.add_truth(t, pack_true_state(values[:3], values[3:6], values[6:10], values[10:]))
    flight = make_flight_of(record, 30.0)
    assert flight is not None
    return flight


def test_magnetic_field_and_body_rates_have_their_own_columns():
    flight = rows(recorded(), 1.0)
    assert flight.group("imu.ang_vel", RPY)[0] == pytest.approx([4, 5, 6])
    assert flight.group("imu.mag")[0] == pytest.approx([7e-4, 8e-4, 9e-4])


def test_captured_attitude_is_not_the_estimate():
    record = recorded()
    record.add_pose(1.0, 1.0, (np.cos(0.2), 0.0, 0.0, np.sin(0.2), 0.0, 0.0, 0.0))
    flight = rows(record, 1.0)
    assert flight.numbers["mocap.att_euler.yaw"][0] == pytest.approx(0.4)
    assert flight.numbers["ekf.att_euler.yaw"][0] == pytest.approx(0.0)


def test_attitude_interpolation_is_used_for_the_captured_pose():
    record = recorded()
    for t, yaw in ((1.0, 0.0), (1.1, 1.0)):
        record.add_pose(t, t, (*quat_from_euler([0.0, 0.0, yaw]).tolist(), 0.0, 0.0, 0.0))
    q_nb = rows(record, 1.05).group("mocap.att_q", WXYZ)[0]
    assert euler_from_quat(q_nb)[2] == pytest.approx(0.5)


def test_stale_values_are_unknown():
    record = recorded()
    record.add_pose(1.0, 1.0, (*LEVEL, 0.0, 0.0, 0.0))
    flight = rows(record, 2.0, 30.0)
    measured = ("ekf", "imu", "mocap", "pos_ref", "att", "err", "act")
    assert all(np.isnan(v).all() for name, v in flight.numbers.items() if name.startswith(measured))
    assert list(flight.mode) == ["OFFBOARD", ""]  # heartbeats come once a second
    assert np.isnan(flight.numbers["info.is_armed"]).tolist() == [False, True]
    assert np.isnan(flight.numbers["info.battery"]).tolist() == [False, True]


def test_uncontrolled_axis_is_unknown():
    flight = rows(recorded(ref=(math.nan,) * 3), 1.0)
    assert np.isnan(flight.group("pos_ref")).all()


def test_error_is_the_estimate_minus_the_truth():
    truth = np.concatenate([(0.5, 0.0, 0.0), ZERO, quat_from_euler([0.0, 0.0, 0.1]), ZERO])
    flight = rows(recorded(), 1.0, truth=truth)
    assert flight.numbers["err.pos.north"][0] == pytest.approx(0.01 - 0.5)
    assert flight.numbers["err.att_euler.yaw"][0] == pytest.approx(-0.1)


def moving(t: float) -> Array:
    """A circle of 1 m radius at 2 rad/s: position and velocity [NED] (6,)."""
    return np.array([np.cos(2 * t), np.sin(2 * t), -1.0, -2 * np.sin(2 * t), 2 * np.cos(2 * t), 0.0])


def circle(until: float, *, boot: float = 0.0, delay: float = 0.02) -> VehicleRecord:
    """Estimates at 30 Hz, attitudes at 50 Hz and poses at 180 Hz of a vehicle on the circle that yaws at 1 rad/s."""
    out, record = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), VehicleRecord(UAV1)
    for k in range(round(until * 30)):
        t = k / 30
        message = mavlink.MAVLink_local_position_ned_message(round((t + boot) * 1e3), *moving(t))
        record.add_down(t + delay, message.pack(out))
    for k in range(round(until * 50)):
        t = k / 50
        q_nb = quat_from_euler([0, 0, t])
        attitude = mavlink.MAVLink_attitude_quaternion_message(round((t + boot) * 1e3), *q_nb, 0, 0, 1)
        record.add_down(t + delay, attitude.pack(out))
    for k in range(round(until * 180)):
        t = k / 180
        pose = (*quat_from_euler([0.0, 0.0, t]).tolist(), *moving(t)[:3].tolist())
        record.add_pose(t + delay, t, pose)
    return record


@pytest.mark.parametrize("t", [1.0, 1.0123, 1.0250])
def test_every_group_of_a_row_is_of_the_same_instant(t: float):
    truth = np.concatenate([moving(t), quat_from_euler([0.0, 0.0, t]), ZERO])
    flight = rows(circle(2.0), t, truth=truth)
    assert flight.group("ekf.pos")[0] == pytest.approx(moving(t)[:3], abs=2e-3)  # stamps are whole ms
    assert flight.group("mocap.pos")[0] == pytest.approx(moving(t)[:3], abs=1e-4)
    assert flight.numbers["ekf.att_euler.yaw"][0] == pytest.approx(t, abs=1e-3)
    assert flight.group("err.pos")[0] == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    assert flight.group("err.att_euler", RPY)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


def test_velocity_in_body_axes_is_rotated_by_the_estimated_attitude():
    flight = rows(circle(2.0), 1.0)
    north, east = moving(1.0)[3:5]
    forward, right = np.cos(1.0) * north + np.sin(1.0) * east, np.cos(1.0) * east - np.sin(1.0) * north
    assert flight.group("ekf.vel_body")[0] == pytest.approx([forward, right, 0.0], abs=5e-3)


def test_stamps_of_an_autopilot_that_booted_earlier_are_converted():
    flight = rows(circle(2.0, boot=100.0, delay=0.0), 1.3)
    assert flight.group("ekf.pos")[0] == pytest.approx(moving(1.3)[:3], abs=3e-3)


def reference(
    t: float,
    p_n: tuple[float, ...],
    mask: int = 0,
    v_n: tuple[float, ...] = ZERO,
    system: int = 1,
) -> bytes:
    """A program's datagram with its reference."""
    out = mavlink.MAVLink(None, srcSystem=system, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    return mavlink.MAVLink_position_target_local_ned_message(
        round(t * 1e3), 1, mask, *p_n, *v_n, 0, 0, 0, 0.5, 0
    ).pack(out)


def test_published_reference_wins_over_the_setpoint_axis_by_axis():
    record = recorded(ref=(9.0, 9.0, -9.0))
    record.add_up(1.0, reference(1.0, (1.0, 2.0, -3.0), 0b0100, (4.0, 5.0, 6.0)))
    flight = rows(record, 1.0)
    assert flight.group("pos_ref")[0].tolist() == [1.0, 2.0, -9.0]
    assert flight.group("vel_ref")[0].tolist() == [4.0, 5.0, 6.0]
    assert flight.numbers["pos_ref.yaw"][0] == 0.5


def test_published_reference_is_valid_from_its_time_stamp_for_half_a_second():
    record = recorded(ref=(math.nan,) * 3, boot_s=0.5, received=0.5)
    for t, north in ((1.0, 1.0), (1.1, 2.0)):
        record.add_up(t + 0.03, reference(t, (north, 0.0, 0.0)))
    found = rows(record, 0.9, 1.0, 1.09, 1.1, 1.6, 1.7).numbers["pos_ref.north"].tolist()
    assert found == pytest.approx([math.nan, 1, 1, 2, 2, math.nan], nan_ok=True)


def test_reference_of_another_program_is_ignored():
    record = recorded(ref=(math.nan,) * 3)
    record.add_up(1.0, reference(1.0, (1.0, 0.0, 0.0), system=2))
    assert np.isnan(rows(record, 1.0).numbers["pos_ref.north"]).all()


def test_messages_of_another_vehicle_are_ignored():
    record = VehicleRecord(replace(UAV1, id=2))
    record.add_down(1.0, stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, True, False))
    assert make_flight_of(record, 30.0) is None


def test_log_begins_with_the_first_message():
    flight = rows(recorded(), 0.5, 0.9, 1.0, 1.1)
    assert flight.numbers["time.seconds"].tolist() == [1.0, 1.1]


def test_outputs_are_those_of_the_port_with_the_rotors():
    out, record = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), VehicleRecord(UAV1)
    for k in range(20):
        t = 1.0 + k / 20
        rotors = (1500 + 10 * k,) * 4 + (900,) * 4
        for port, values in ((0, (1000,) * 8), (1, rotors)):
            message = mavlink.MAVLink_servo_output_raw_message(round(t * 1e6), port, *values)
            record.add_down(t + 0.001 * port, message.pack(out))
    flight = rows(record, 1.51)
    assert flight.numbers["act.output.1"][0] == pytest.approx(0.6)
    assert flight.numbers["act.output.5"][0] == 0.0


def test_unknown_voltage_and_current_stay_unknown():
    out, record = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), VehicleRecord(UAV1)
    message = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0)
    record.add_down(1.0, message.pack(out))
    flight = rows(record, 1.0)
    assert np.isnan([flight.numbers[f"bat.{n}"][0] for n in ("voltage", "current")]).all()
    assert np.isnan(flight.numbers["info.battery"][0])
