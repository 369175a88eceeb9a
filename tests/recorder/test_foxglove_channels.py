"""Channels for viewers: counts, decoded values, frames of the 3D view."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from recorded_flights import OFFBOARD
from viewer_records import (
    FENCE,
    GENERIC_RPY,
    OBSTACLES,
    Q_NB,
    UAV1,
    ViewerRecord,
    attitude,
    frame,
    full_flight,
    position,
    reference,
    sender,
    sent,
    truth,
)

from arena.geometry import matrix_from_quat, q_wf_from_q_nb, world_from_ned
from arena.kernels.viewer_messages import arena_attitude
from arena.kernels.viewer_meters import Throttle
from arena.mocap.client import Pose
from arena.recorder.viewer_scene import shape_of
from arena.wire.mavlink_frame import SEEDS, pack_frame
from arena.wire.mavlink_layout import payload_bytes
from arena.wire.planned_path import path_messages
from arena.wire.viewer_topics import ARENA_TOPICS, VEHICLE_TOPICS, topic_name

P_N = (1.0, -2.0, -0.7)
_HANDLED = (
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_WIND_COV,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
)


def test_every_topic_of_the_table_is_published():
    topics = {topic_name(content, "uav1") for content in VEHICLE_TOPICS} | set(map(topic_name, ARENA_TOPICS))
    assert set(full_flight().messages()) == topics


def test_rates_are_limited_and_unlimited_topics_complete():
    found = full_flight().messages()
    for topic, rate_hz in {
        "local_position": 15,
        "attitude": 15,
        "imu": 15,
        "battery": 1,
        "mocap/pose": 15,
        "truth/pose": 15,
    }.items():
        assert len(found[f"/uav1/{topic}"]) == pytest.approx(12 * rate_hz, abs=2), topic
    assert len(found["/scene"]) == len(found["/uav1/model"]) == 3
    assert len(found["/uav1/estimator"]) == len(found["/faults"]) == 1


def test_log_times_are_those_of_reception():
    record = ViewerRecord()
    sent(record, position(P_N), 12.345678)
    assert [t for t, _ in record.messages()["/uav1/local_position"]] == [pytest.approx(12.345678, abs=1e-9)]


@pytest.mark.parametrize(
    "sent_pressure", [1013.25, 101325.0], ids=["hPa, as MAVLink defines", "Pa, as PX4 sends"]
)
def test_pressure_is_in_hpa_for_every_autopilot(sent_pressure):
    record = ViewerRecord()
    values = (0.1, 0.2, -9.8, *(0.0,) * 6, sent_pressure, 0.0, 1.5, 20.0, 0x1FFF)
    sent(record, mavlink.MAVLink_highres_imu_message(1000, *values))
    (_, found) = record.messages()["/uav1/imu"][0]
    assert found.pressure == pytest.approx(1013.25)


def test_estimate_is_a_frame_and_a_pose_with_generic_attitude():
    record = ViewerRecord()
    sent(record, position(P_N))
    sent(record, attitude(Q_NB))
    found = record.messages()
    (_, transform), (_, pose) = found["/tf"][0], found["/uav1/estimate/pose"][0]
    assert (transform.parent_frame_id, transform.child_frame_id, pose.frame_id) == ("arena", "uav1", "arena")
    for p, q in ((transform.translation, transform.rotation), (pose.pose.position, pose.pose.orientation)):
        np.testing.assert_allclose((p.x, p.y, p.z), world_from_ned(P_N), atol=1e-6)
        turned = matrix_from_quat(np.array((q.w, q.x, q.y, q.z)))
        np.testing.assert_allclose(turned, matrix_from_quat(q_wf_from_q_nb(Q_NB)), atol=1e-6)
    nose = matrix_from_quat(np.array((q.w, q.x, q.y, q.z)))[:, 0]
    roll, pitch, yaw = GENERIC_RPY  # yaw from north to east, nose below the horizon
    expected = (np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch))
    np.testing.assert_allclose(nose, expected, atol=1e-6)
    assert roll > 0 > pitch


def test_captured_and_true_poses_have_frames_of_their_own():
    record = ViewerRecord()
    record.channels.on_frame(frame(1, 1.0, Pose("body1", P_N, Q_NB), Pose("other", P_N, Q_NB)), True, 1.0)
    record.channels.on_truth(truth(P_N, Q_NB, 1.0), 1.0)
    found = record.messages()
    assert [m.child_frame_id for _, m in found["/tf"]] == ["uav1/mocap", "uav1/truth"]
    for topic in ("/uav1/mocap/pose", "/uav1/truth/pose"):
        p = found[topic][0][1].pose.position
        np.testing.assert_allclose((p.x, p.y, p.z), (-2.0, 1.0, 0.7), atol=1e-9)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_attitude_in_the_arena_frame_equals_the_geometry_package(q):
    unit = np.array(q) / np.linalg.norm(q)
    np.testing.assert_allclose(
        matrix_from_quat(np.array(arena_attitude(unit.tolist()))),
        matrix_from_quat(q_wf_from_q_nb(unit)),
        atol=1e-12,
    )


def test_attitude_has_quaternion_euler_angles_and_rates():
    record = ViewerRecord()
    sent(record, attitude(Q_NB))
    ((_, m),) = record.messages()["/uav1/attitude"]
    assert (m.q_w, m.q_x, m.q_y, m.q_z) == pytest.approx(Q_NB, abs=1e-6)
    assert (m.roll, m.pitch, m.yaw) == pytest.approx(GENERIC_RPY, abs=1e-6)
    assert (m.roll_rate, m.pitch_rate, m.yaw_rate) == pytest.approx((0.4, 0.5, 0.6))


def test_setpoint_without_velocity_and_yaw_keeps_the_yaw_of_the_vehicle():
    record = ViewerRecord()
    sent(record, attitude(Q_NB))
    sent(record, reference(1.0))
    found = record.messages()
    ((_, m),) = found["/uav1/position_setpoint"]
    assert (m.north, m.east, m.down) == (1, 2, -1)
    assert all(map(math.isnan, (m.v_north, m.v_east, m.v_down, m.yaw)))
    ((_, pose),) = found["/uav1/setpoint/pose"]
    expected = q_wf_from_q_nb([math.cos(GENERIC_RPY[2] / 2), 0, 0, math.sin(GENERIC_RPY[2] / 2)])
    o = pose.pose.orientation
    assert abs(np.dot((o.w, o.x, o.y, o.z), expected)) == pytest.approx(1.0, abs=1e-6)


def test_reference_of_the_program_has_its_own_topic():
    record = ViewerRecord()
    sent(record, reference(1.0, 0.5))
    sent(record, reference(3.0, 0.5), component=191)
    found = record.messages()
    assert [m.north for _, m in found["/uav1/position_setpoint"]] == [1.0]
    assert [m.north for _, m in found["/uav1/program_reference"]] == [3.0]


def test_commands_of_other_senders_are_not_shown_as_telemetry():
    record = ViewerRecord()
    record.channels.on_datagrams([("uav1", True, position(P_N).pack(sender(190)), 1.0)])
    record.channels.on_datagrams([("uav1", False, position(P_N).pack(mavlink.MAVLink(None, 2, 1)), 1.0)])
    assert "/uav1/local_position" not in record.messages()


@settings(max_examples=100)
@given(
    st.sampled_from(sorted(_HANDLED)),
    st.binary(min_size=1, max_size=255),
    st.sampled_from([1, 191]),
    st.booleans(),
)
def test_no_content_of_a_message_is_an_error(message, payload, component, up):
    record = ViewerRecord()
    size = payload_bytes(message)
    data = pack_frame(message, payload[:size].ljust(size, b"\x7f"), sender(component), SEEDS[message])
    for time_s in (1.0, 2.5):
        record.channels.on_datagrams([("uav1", up, data, time_s)])
        sent(record, attitude(Q_NB), time_s)
    record.messages()


def test_a_pose_that_is_not_finite_is_no_frame():
    record = ViewerRecord()
    sent(record, position((math.nan, 0.0, -1.0)))
    sent(record, attitude(Q_NB))
    found = record.messages()
    assert "/uav1/local_position" in found and "/tf" not in found


def test_all_rotors_are_shown_and_unused_outputs_are_not_a_number():
    record = ViewerRecord()
    sent(record, mavlink.MAVLink_servo_output_raw_message(0, 0, 1500, 2000, 1000, 1250, 900, 2100, 1000, 0))
    ((_, m),) = record.messages()["/uav1/actuators"]
    outputs = [getattr(m, f"rotor{k}") for k in range(1, 9)]
    assert outputs[:7] == [0.5, 1.0, 0.0, 0.25, 0.0, 1.0, 0.0]
    assert math.isnan(outputs[7])


def test_battery_units_and_unknown_values():
    record = ViewerRecord()
    sent(record, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 11800, 1250, 87, 0, 0, 0, 0, 0, 0), 1.0)
    sent(record, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0), 2.5)
    (_, known), (_, unknown) = record.messages()["/uav1/battery"]
    assert (known.voltage, known.current, known.remaining) == pytest.approx((11.8, 12.5, 87.0))
    assert all(map(math.isnan, (unknown.voltage, unknown.current, unknown.remaining)))


def test_state_is_published_at_each_change():
    record = ViewerRecord()
    for t, mode, armed, landed in (
        (0, 3 << 16, False, True),
        (0.1, OFFBOARD, True, True),
        (0.2, OFFBOARD, True, False),
    ):
        sent(record, mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, mode, 4, 3), t)
        sent(record, mavlink.MAVLink_extended_sys_state_message(0, 1 if landed else 2), t)
    states = [(m.mode, m.armed, m.landed, m.health) for _, m in record.messages()["/uav1/state"]]
    assert states == [
        ("POSCTL", False, False, "ACTIVE"),
        ("POSCTL", False, True, "ACTIVE"),
        ("OFFBOARD", True, True, "ACTIVE"),
        ("OFFBOARD", True, False, "ACTIVE"),
    ]


def test_status_text_in_parts_is_one_log_line():
    record = ViewerRecord()
    text = "A long sentence of the autopilot that does not fit into one message"
    for k in range(2):
        part = text[50 * k : 50 * (k + 1)].encode()
        sent(record, mavlink.MAVLink_statustext_message(4, part, 7, k))
    sent(record, mavlink.MAVLink_statustext_message(6, b"Landing detected"))
    lines = [(m.level, m.name, m.message) for _, m in record.messages()["/log"]]
    assert lines == [(3, "uav1", text), (2, "uav1", "Landing detected")]


def test_events_are_log_lines_and_faults_also_have_a_topic():
    record = ViewerRecord()
    for line in (
        {"process": "router", "event": "uav1: armed, OFFBOARD"},
        {"process": "mocap", "from": "READY", "to": "FATAL", "reason": "ended with 1"},
        {"process": "world", "event": "fault: motor 1 of uav1 0 %"},
        {"process": "router", "audit": {"command": 400}},
    ):
        record.channels.on_event(json.dumps(line).encode(), line, 3.0)
    found = record.messages()
    assert [(m.level, m.name, m.message) for _, m in found["/log"]] == [
        (2, "router", "uav1: armed, OFFBOARD"),
        (4, "mocap", "READY -> FATAL: ended with 1"),
        (3, "world", "fault: motor 1 of uav1 0 %"),
    ]
    assert [(m.fault, m.process) for _, m in found["/faults"]] == [("motor 1 of uav1 0 %", "world")]


def test_health_shows_lost_frames_and_the_age_of_the_last_pose():
    record = ViewerRecord()
    for k in range(90):  # 90 Hz for 1 s; every third frame is missing, and the body disappears after 0.5 s
        if k % 3:
            poses = (Pose("body1", P_N, Q_NB),) if k <= 45 else ()
            record.channels.on_frame(frame(k, k / 90, *poses), True, k / 90)
    record.channels.on_truth(truth(P_N, Q_NB, 1.1), 1.1)
    found = record.messages()
    ((_, health),) = found["/mocap/frames/health"]
    assert health.rate == pytest.approx(60, rel=0.1)
    assert health.lost == pytest.approx(29 / (1.1 - 1 / 90), rel=0.01)
    ((_, body),) = found["/uav1/mocap/health"]
    assert body.age == body.gap == pytest.approx(1.1 - 44 / 90, abs=1e-5)


def test_link_counts_datagrams_bytes_and_lost_messages():
    record = ViewerRecord()
    out = sender()
    for k in range(11):
        out.seq = 250 + k & 0xFF
        data = position(P_N).pack(out)
        if k != 4:
            record.channels.on_datagrams([("uav1", False, data, 0.1 * k)])
    ((_, link),) = record.messages()["/uav1/link"]
    assert (link.down, link.up, link.lost) == pytest.approx((9, 0, 1))
    assert link.down_bytes == pytest.approx(9 * len(data))


def test_room_and_fence_are_drawn_with_north_along_y():
    record = ViewerRecord()
    record.channels.on_truth(truth(P_N, Q_NB, 0.0), 0.0)
    ((_, scene),) = record.messages()["/scene"]
    entities = {entity.id: entity for entity in scene.entities}
    assert {entity.frame_id for entity in scene.entities} == {"arena"}
    floor = entities["floor"].cubes[0]
    assert (floor.size.x, floor.size.y) == (6.0, 8.0)
    corners = np.array([(p.x, p.y, p.z) for p in entities["geofence"].lines[0].points])
    assert len(corners) == 24
    (north, east, up) = FENCE
    assert [tuple(c) for c in zip(corners.min(0), corners.max(0), strict=True)] == [east, north, up]


def test_obstacles_are_drawn_where_the_world_has_them():
    """The corners of the drawn box, cylinder and sphere are those of the obstacle's surface in z-up axes."""
    record = ViewerRecord()
    record.channels.on_truth(truth(P_N, Q_NB, 0.0), 0.0)
    ((_, scene),) = record.messages()["/scene"]
    entities = {entity.id: entity for entity in scene.entities}
    for one, kind in zip(OBSTACLES, ("cubes", "cylinders", "spheres"), strict=True):
        (body,) = getattr(entities[f"obstacle/{one.name}"], kind)
        p, q, size = body.pose.position, body.pose.orientation, body.size
        r_wf = matrix_from_quat(np.array([q.w, q.x, q.y, q.z]))
        half = np.array([size.x, size.y, size.z]) / 2
        tip_w = np.array([p.x, p.y, p.z]) + r_wf @ (half * (1.0, 0.0, 0.0))
        tip_n = np.array(one.centre_n) + one.r_nb @ (0.5 * np.array(one.size_m) * (1.0, 0.0, 0.0))
        assert tip_w == pytest.approx(world_from_ned(tip_n), abs=1e-6)
        top_w = np.array([p.x, p.y, p.z]) + r_wf @ (half * (0.0, 0.0, 1.0))
        top_n = np.array(one.centre_n) + one.r_nb @ (0.5 * np.array(one.size_m) * (0.0, 0.0, -1.0))
        assert top_w == pytest.approx(world_from_ned(top_n), abs=1e-6)
    color = entities["obstacle/pole"].cylinders[0].color
    assert (color.r, color.g, color.b, color.a) == pytest.approx((1.0, 128 / 255, 0.0, 1.0))


def test_model_stands_in_the_frame_of_the_estimate_with_red_front_rotors():
    record = ViewerRecord()
    record.channels.on_truth(truth(P_N, Q_NB, 0.0), 0.0)
    ((_, scene),) = record.messages()["/uav1/model"]
    (model,) = scene.entities
    assert (model.frame_id, model.frame_locked) == ("uav1", True)
    assert UAV1.shape is not None
    places = [(c.pose.position.x, c.pose.position.y) for c in model.cylinders]
    assert places == [(x, -y) for x, y, _ in UAV1.shape.rotors]
    assert [c.color.r > 0.5 for c in model.cylinders] == [x > 0 for x, _, _ in UAV1.shape.rotors]


def test_planned_path_is_drawn_until_it_is_replaced():
    record = ViewerRecord()
    program = sender(mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    planned = np.array([(1.0, -2.0, -0.7), (2.0, 0.0, -1.0), (3.0, 1.0, -2.0)])
    for time_s, points in ((1.0, planned), (8.0, planned[:0])):
        for message in path_messages(points, int(1e6 * time_s)):
            record.channels.on_datagrams([("uav1", True, message.pack(program), time_s)])
        for k in range(5):
            record.channels.on_truth(truth(P_N, Q_NB, time_s), time_s + 0.4 * k)
    found = [e for _, s in record.messages()["/uav1/path"] for e in s.entities if e.id == "uav1/planned"]
    assert all((e.lifetime.seconds, e.frame_id) == (0, "arena") for e in found)
    first, last = found[0].lines[0].points, found[-1].lines[0].points
    drawn = np.array([(p.x, p.y, p.z) for p in first])
    assert drawn == pytest.approx(np.array([(-2.0, 1.0, 0.7), (0.0, 2.0, 1.0), (1.0, 3.0, 2.0)]))
    assert len(last) == 0


def test_pieces_of_the_path_join():
    found = full_flight().messages()["/uav1/path"]
    flown = [e for _, m in found for e in m.entities if "/flown/" in e.id]
    assert len({e.id for e in flown}) == len(flown) >= 11
    for before, after in itertools.pairwise(flown):
        assert before.lines[0].points[-1] == after.lines[0].points[0]
    assert flown[0].lifetime.seconds == 20


def test_throttle_keeps_the_mean_rate_of_a_faster_source():
    limit = Throttle(1 / 25)
    assert sum(limit.due(k / 180) for k in range(1800)) == pytest.approx(250, abs=2)


def test_throttle_continues_after_the_clock_was_set_back():
    limit = Throttle(1.0)
    assert limit.due(1000.0)
    assert limit.due(10.0)
    assert not limit.due(10.5)


@pytest.mark.parametrize(("given", "expected"), [(0.11, 0.11), (None, 0.3 - 0.2)])
def test_propellers_of_unknown_radius_end_at_the_radius_of_the_vehicle(given, expected):
    rotors = [[0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.2, 0.0, 0.0], [0.0, -0.2, 0.0]]
    raw = {"rotors_m": rotors, "radius_m": 0.3, "height_m": 0.1, "rotor_radius_m": given}
    assert shape_of(raw).rotor_radius_m == pytest.approx(expected)
