"""Rows of a log from received telemetry, poses and truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import Array, euler_from_quat, quat_from_euler
from arena.recorder.recorder import Recorder
from arena.recorder.samples import MAX_GAP_S

from .synthetic import OFFBOARD, STEPS, stream, truth_at

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def cells(recorder: Recorder, line: str) -> dict[str, str]:
    return dict(zip(recorder.header.strip().split(","), line.strip().split(","), strict=True))


def three(row: dict[str, str], group: str, parts: str = "north east down") -> list[float]:
    return [float(row[f"{group}.{part}"]) for part in parts.split()]


def fed(
    recorder: Recorder, *, boot_s: float = 1.0, received: float = 1.0, ref: tuple[float, ...] = STEPS[0]
) -> Recorder:
    recorder.receive(stream(boot_s, np.zeros(3), ref, OFFBOARD, True, False), received)
    return recorder


def test_magnetic_field_and_body_rates_have_their_own_columns():
    recorder = fed(Recorder(1, None))
    row = cells(recorder, recorder.row(1.0, 1.0))
    assert three(row, "imu.ang_vel", "roll pitch yaw") == [4, 5, 6]
    assert three(row, "imu.mag") == pytest.approx([7e-4, 8e-4, 9e-4])


def test_captured_attitude_is_not_the_estimate():
    recorder = fed(Recorder(1, None))
    recorder.receive_pose(np.zeros(3), np.array([np.cos(0.2), 0, 0, np.sin(0.2)]), 1.0, 1.0)
    row = cells(recorder, recorder.row(1.0, 1.0))
    assert float(row["mocap.att_euler.yaw"]) == pytest.approx(0.4)
    assert float(row["ekf.att_euler.yaw"]) == pytest.approx(0.0)


def test_stale_values_are_empty_cells():
    recorder = fed(Recorder(1, 0))
    recorder.receive_pose(np.zeros(3), LEVEL, 1.0, 1.0)
    row = cells(recorder, recorder.row(2.0, 2.0))
    measured = ("ekf", "imu", "mocap", "pos_ref", "att", "truth", "err")
    assert {row[name] for name in row if name.startswith(measured)} == {""}
    assert row["info.flight_mode"] == "OFFBOARD"  # heartbeats come once a second
    assert cells(recorder, recorder.row(30.0, 30.0))["info.is_armed"] == ""


def test_uncontrolled_axis_is_an_empty_cell():
    recorder = fed(Recorder(1, None), ref=(math.nan,) * 3)
    assert cells(recorder, recorder.row(1.0, 1.0))["pos_ref.north"] == ""


def moving(t: float) -> Array:
    """A circle of 1 m radius at 2 rad/s: position and velocity [NED] (6,)."""
    return np.array([np.cos(2 * t), np.sin(2 * t), -1.0, -2 * np.sin(2 * t), 2 * np.cos(2 * t), 0.0])


def receive_circle(recorder: Recorder, until: float, *, boot: float = 0.0, delay: float = 0.02) -> None:
    """Send estimates at 30 Hz, attitudes at 50 Hz and poses at 180 Hz of a vehicle on the circle that yaws at
    1 rad/s.
    """
    out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for k in range(round(until * 30)):
        t = k / 30
        message = mavlink.MAVLink_local_position_ned_message(round((t + boot) * 1e3), *moving(t))
        recorder.receive(message.pack(out), t + delay)
    for k in range(round(until * 50)):
        t = k / 50
        attitude = mavlink.MAVLink_attitude_quaternion_message(
            round((t + boot) * 1e3), *quat_from_euler([0, 0, t]), 0, 0, 1
        )
        recorder.receive(attitude.pack(out), t + delay)
    for k in range(round(until * 180)):
        t = k / 180
        recorder.receive_pose(moving(t)[:3], quat_from_euler([0.0, 0.0, t]), t, t + delay)


@pytest.mark.parametrize("t", [1.0, 1.0123, 1.0250])
def test_every_group_of_a_row_is_of_the_same_instant(t: float):
    recorder = Recorder(1, 0)
    receive_circle(recorder, 2.0)
    truth = truth_at(moving(t)[:3], moving(t)[3:], (0.0, 0.0, t))
    row = cells(recorder, recorder.row(t, t, truth))
    assert three(row, "ekf.pos") == pytest.approx(three(row, "truth.pos"), abs=2e-3)  # stamps are whole ms
    assert three(row, "mocap.pos") == pytest.approx(three(row, "truth.pos"), abs=1e-4)
    assert float(row["ekf.att_euler.yaw"]) == pytest.approx(t, abs=1e-3)
    assert three(row, "err.pos") == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    assert three(row, "err.att_euler", "roll pitch yaw") == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


def test_datagrams_read_together_do_not_repeat_a_measurement():
    recorder = Recorder(1, 0)
    out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for k in range(
        11
    ):  # the logger wakes 40 ms late and reads what has arrived, all at one time of its clock
        t = 0.04 * k
        local = mavlink.MAVLink_local_position_ned_message(round(t * 1e3), *moving(t))
        attitude = mavlink.MAVLink_attitude_quaternion_message(
            round(t * 1e3), *quat_from_euler([0, 0, t]), 0, 0, 1
        )
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
        for message in (local, attitude, heartbeat):
            recorder.receive(message.pack(out), t + 0.036)
    t = 0.236  # the time of reception of the samples at 0.2 s
    row = cells(recorder, recorder.row(t, t, truth_at(moving(t)[:3], moving(t)[3:], (0.0, 0.0, t))))
    assert three(row, "err.pos") == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    assert three(row, "err.att_euler", "roll pitch yaw") == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


def test_stamps_of_an_autopilot_that_booted_earlier_are_converted():
    recorder = Recorder(1, 0)
    receive_circle(recorder, 2.0, boot=100.0, delay=0.0)
    row = cells(recorder, recorder.row(1.3, 1.3))
    assert three(row, "ekf.pos") == pytest.approx(list(moving(1.3)[:3]), abs=3e-3)


def test_error_is_the_estimate_minus_the_truth():
    recorder = fed(Recorder(1, 0))
    truth = truth_at(np.array([0.5, 0.0, 0.0]), np.zeros(3), (0.0, 0.0, 0.1))
    row = cells(recorder, recorder.row(1.0, 1.0, truth))
    assert float(row["err.pos.north"]) == pytest.approx(0.01 - 0.5, abs=1e-6)
    assert float(row["err.att_euler.yaw"]) == pytest.approx(-0.1, abs=1e-6)


def test_row_waits_until_every_live_stream_has_passed_it():
    recorder = fed(Recorder(1, None))
    recorder.sample(1.01, 1.01)
    assert list(recorder.take_rows(1.05)) == []
    fed(recorder, boot_s=1.02, received=1.06)
    (line,) = recorder.take_rows(1.06)
    assert cells(recorder, line)["ekf.pos.north"] == "0.01"


def test_row_of_a_silent_vehicle_is_written_after_the_longest_gap():
    recorder = fed(Recorder(1, None))
    recorder.sample(1.01, 1.01)
    assert list(recorder.take_rows(1.01 + MAX_GAP_S)) == []
    (line,) = recorder.take_rows(1.02 + MAX_GAP_S)
    assert cells(recorder, line)["ekf.pos.north"] == ""


def test_remaining_rows_are_written_at_the_end():
    recorder = fed(Recorder(1, None))
    for k in range(3):
        recorder.sample(1.01 + k / 30, 1.01 + k / 30)
    assert len(list(recorder.take_rows())) == recorder.rows == 3


def reference(t: float, p_n: tuple[float, ...], mask: int, v_n: tuple[float, ...] = (0.0, 0.0, 0.0)) -> bytes:
    """A program's datagram with its reference."""
    out = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    return mavlink.MAVLink_position_target_local_ned_message(
        round(t * 1e3), 1, mask, *p_n, *v_n, 0, 0, 0, 0.5, 0
    ).pack(out)


def test_published_reference_wins_over_the_setpoint_axis_by_axis():
    recorder = fed(Recorder(1, None), ref=(9.0, 9.0, -9.0))
    recorder.receive(reference(1.0, (1.0, 2.0, -3.0), 0b0100, (4.0, 5.0, 6.0)), 1.0)
    row = cells(recorder, recorder.row(1.0, 1.0))
    assert three(row, "pos_ref") == [1.0, 2.0, -9.0] and three(row, "vel_ref") == [4.0, 5.0, 6.0]
    assert float(row["pos_ref.yaw"]) == 0.5
    assert recorder.datagrams == 1, "only the autopilot's datagrams are counted"


def test_published_reference_is_valid_from_its_time_stamp_for_half_a_second():
    recorder = Recorder(1, None)
    for t, north in ((1.0, 1.0), (1.1, 2.0)):
        recorder.receive(reference(t, (north, 0.0, 0.0), 0), t + 0.03)
    found = [cells(recorder, recorder.row(t, t))["pos_ref.north"] for t in (0.9, 1.0, 1.09, 1.1, 1.6, 1.7)]
    assert found == ["", "1", "1", "2", "2", ""]


def test_reference_of_another_program_is_ignored():
    recorder = Recorder(2, None)
    recorder.receive(reference(1.0, (1.0, 0.0, 0.0), 0), 1.0)
    assert cells(recorder, recorder.row(1.0, 1.0))["pos_ref.north"] == ""


def test_messages_of_another_vehicle_are_ignored():
    assert fed(Recorder(2, None)).first_received is None


def test_attitude_interpolation_is_used_for_the_captured_pose():
    recorder = Recorder(1, None)
    for t, yaw in ((1.0, 0.0), (1.1, 1.0)):
        recorder.receive_pose(np.zeros(3), quat_from_euler([0.0, 0.0, yaw]), t, t)
    row = cells(recorder, recorder.row(1.05, 1.05))
    q_nb = np.array([float(row[f"mocap.att_q.{part}"]) for part in "wxyz"])
    assert euler_from_quat(q_nb)[2] == pytest.approx(0.5)
