"""The simulator API for one vehicle, without sockets: messages to PX4 and its replies."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.px4.simulator_link import SimulatorLink
from arena.wire.truth_page import Truth

from .fake import HIL, answer, sensors

IMU, MAG, BARO = 0x03F, 0x1C0, 0x1A00
SENSORS = sensors(1)


def decoded(data: bytes) -> list[Any]:
    found: list[Any] = mavlink.MAVLink(None).parse_buffer(data) or []
    return found


def in_step(link: SimulatorLink) -> SimulatorLink:
    link.receive(answer([0.0] * 4, armed=False))
    return link


def test_a_sample_is_a_hil_sensor_with_these_bytes() -> None:
    data = SimulatorLink(4, HIL).sample(1.5, SENSORS, 0)
    assert data[0] == 0xFD and data[7:10] == bytes([107, 0, 0]) and len(data) == 10 + data[1] + 2
    payload = data[10 : 10 + data[1]].ljust(65, b"\0")
    time_usec, *floats = struct.unpack("<Q13f", payload[:60])
    fields, sensor_id = struct.unpack("<IB", payload[60:])
    accel, gyro, mag, (pressure_hpa, difference, height, celsius) = (
        floats[:3],
        floats[3:6],
        floats[6:9],
        floats[9:],
    )
    assert time_usec == 1_500_000 and sensor_id == 0
    assert accel == pytest.approx([0.01, -0.02, -9.81]) and gyro == pytest.approx([0.001, 0.002, -0.003])
    assert mag == pytest.approx([0.2, 0.01, 0.43])
    assert height == 488.0 and difference == 0.0 and celsius == 25.0
    assert pressure_hpa == pytest.approx(956.0, abs=0.5)  # the standard atmosphere's at 488 m
    assert fields == IMU | MAG | BARO


def test_each_group_of_fields_is_sent_whole_at_its_rate() -> None:
    link = SimulatorLink(4, HIL)
    fields = [decoded(link.sample(0.004 * k, SENSORS, 0))[0].fields_updated for k in range(1, 61)]
    for one in fields:
        rest = one
        for group in (IMU, MAG, BARO):
            assert one & group in (0, group)
            rest &= ~group
        assert rest == 0 and one & IMU
    assert sum(bool(f & MAG) for f in fields) == 20 and sum(bool(f & BARO) for f in fields) == 12


def test_each_vehicle_gets_its_own_row() -> None:
    three = sensors(3)
    heights = [decoded(SimulatorLink(4, HIL).sample(1.0, three, row))[0].pressure_alt for row in range(3)]
    assert heights == [488.0, 488.5, 489.0]


def test_one_reply_per_sample_is_awaited_once_in_step() -> None:
    link = SimulatorLink(4, HIL)
    for k in range(1, 21):
        link.sample(0.004 * k, SENSORS, 0)
    assert link.unanswered == 0 and not link.in_step
    in_step(link)
    assert link.in_step and link.unanswered == 0
    link.sample(0.1, SENSORS, 0)
    assert link.unanswered == 1
    link.receive(answer([0.5] * 4))
    assert link.unanswered == 0
    link.receive(answer([0.5] * 4))  # one too many is no credit
    link.sample(0.104, SENSORS, 0)
    assert link.unanswered == 1


def test_a_reply_to_an_older_sample_is_not_the_awaited_one() -> None:
    link = SimulatorLink(4, HIL)
    for k in (1, 2, 3):
        link.sample(0.004 * k, SENSORS, 0)
    link.receive(
        answer([0.5] * 4, time_usec=8000)
    )  # the free run's: two behind, and the first of all answers
    link.sample(0.016, SENSORS, 0)
    link.receive(answer([0.5] * 4, time_usec=12000))
    assert link.unanswered == 1
    link.receive(answer([0.5] * 4, time_usec=16000))
    assert link.unanswered == 0


def test_a_reply_far_behind_in_the_free_run_is_not_the_awaited_one() -> None:
    link = SimulatorLink(4, HIL)
    for k in range(1, 1001):  # a busy machine: the world is far ahead of PX4's first reply
        link.sample(0.004 * k, SENSORS, 0)
    link.receive(answer([0.5] * 4, time_usec=4000))
    assert link.in_step
    link.sample(4.004, SENSORS, 0)
    for k in range(2, 1001):
        link.receive(answer([0.5] * 4, time_usec=4000 * k))
        assert link.unanswered == 1
    link.receive(answer([0.5] * 4, time_usec=4_004_000))
    assert link.unanswered == 0


def test_replies_with_own_time_stamps_are_counted() -> None:
    link = SimulatorLink(4, HIL)
    link.sample(0.002, SENSORS, 0)
    in_step(link)
    for k in range(1, 4):
        link.sample(0.004 * k, SENSORS, 0)
        link.receive(answer([0.5] * 4, time_usec=3))
        assert link.unanswered == 0


def test_a_reply_without_lockstep_flag_starts_no_lockstep() -> None:
    link = SimulatorLink(4, HIL)
    m = mavlink.MAVLink_hil_actuator_controls_message(0, [0.0] * 16, 0, 0)
    link.receive(m.pack(mavlink.MAVLink(None)))
    assert not link.in_step


def test_motors_are_the_first_controls_limited_to_0_and_1() -> None:
    link = SimulatorLink(4, HIL)
    link.receive(answer([0.1, 0.9, 1.7, -0.3, 0.8, 0.8]))
    assert link.armed and link.motors == pytest.approx([0.1, 0.9, 1.0, 0.0])


def test_a_disarmed_px4_has_motors_at_zero() -> None:
    link = SimulatorLink(4, HIL)
    link.receive(answer([0.6] * 4))
    link.receive(answer([0.6] * 4, armed=False))
    assert not link.armed and link.motors.tolist() == [0.0] * 4


def test_nan_and_infinite_controls_are_zero() -> None:
    link = SimulatorLink(4, HIL)
    link.receive(answer([math.nan, 0.5, math.inf, -math.inf]))
    assert link.motors.tolist() == [0.0, 0.5, 0.0, 0.0]


def test_a_reply_in_pieces_counts_once_complete() -> None:
    link, data = SimulatorLink(4, HIL), answer([0.5] * 4)
    for i in range(len(data)):
        assert not link.in_step
        link.receive(data[i : i + 1])
    assert link.in_step and link.counts["answers"] == 1


@given(st.binary(max_size=200))
def test_garbage_never_raises_and_the_next_reply_is_decoded(data: bytes) -> None:
    link = SimulatorLink(4, HIL)
    link.receive(data)
    # what looks like the head of a long frame swallows up to 280 bytes; after that the stream is itself again
    for _ in range(10):
        link.receive(answer([0.25] * 4))
    assert link.in_step and link.motors == pytest.approx([0.25] * 4)


def test_other_messages_change_nothing() -> None:
    link, codec = SimulatorLink(4, HIL), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.receive(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3).pack(codec))
    link.receive(mavlink.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0).pack(codec))
    assert not link.in_step and link.counts["answers"] == 0


def test_a_new_connection_resets_the_state() -> None:
    link = SimulatorLink(4, HIL)
    link.receive(answer([0.5] * 4))
    link.receive(answer([0.5] * 4)[:20])
    link.reset()
    assert (link.in_step, link.armed, link.unanswered) == (False, False, 0)
    assert link.motors.tolist() == [0.0] * 4
    link.receive(answer([0.25] * 4))
    assert link.counts["garbage"] == 0 and link.in_step


def test_truth_is_sent_every_fifth_sample_in_message_units() -> None:
    link = SimulatorLink(4, HIL)
    row = {
        "q_nb": [0.5, 0.5, -0.5, 0.5],
        "p_n": [10.0, -20.0, -3.0],
        "v_n": [1.0, -2.0, 0.5],
        "omega_b": [0.1, 0.2, 0.3],
        "accel_b": [0.0, 9.80665, -400.0],
        "motors": [0.0] * 4,
    }
    truth = Truth(time_s=1.0, **{key: np.array([value]) for key, value in row.items()})
    sent = []
    for k in range(10):
        link.sample(0.004 * k, SENSORS, 0)
        sent += decoded(link.truth(0.004 * k, truth, 0, (38.7, -9.1, 100.0)))
    assert len(sent) == 2
    m = sent[0]
    assert m.attitude_quaternion == [0.5, 0.5, -0.5, 0.5] and (m.vx, m.vy, m.vz) == (100, -200, 50)
    assert (m.rollspeed, m.pitchspeed, m.yawspeed) == pytest.approx((0.1, 0.2, 0.3))
    assert (
        m.lat == pytest.approx(387000899, abs=20)
        and m.lon == pytest.approx(-91002305, abs=20)
        and m.alt == 103_000
    )
    assert (m.xacc, m.yacc, m.zacc) == (0, 1000, -32768)  # milli-g, held to what the message can say


def test_rc_channels_are_sent_at_50_hz_with_sticks_only() -> None:
    with_sticks, without = SimulatorLink(4, HIL, sticks=True), SimulatorLink(4, HIL)
    samples = [link.sample(i / 250, SENSORS, 0) for link in (with_sticks, without) for i in range(1, 251)]
    heard = [[m.get_type() for m in decoded(sample)] for sample in samples]
    assert sum("RC_CHANNELS" in kinds for kinds in heard[:250]) == 50
    assert not any("RC_CHANNELS" in kinds for kinds in heard[250:])
    with_sticks.sticks = False
    assert not any(
        m.get_type() == "RC_CHANNELS"
        for i in range(50)
        for m in decoded(with_sticks.sample(2 + i / 250, SENSORS, 0))
    )
