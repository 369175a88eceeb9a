"""The poses that the forwarder sends and drops, their encoding, and the origin."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import quat_from_euler
from arena.mocap.client import CapturedFrame, Pose
from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.natnet.receiver import NatNetReceiver
from arena.mocap.natnet.server import NatNetServer
from arena.pose_forwarder.forwarder import Forwarder
from arena.wire.truth_page import Truth
from tests.mocap.rig import row

SETTINGS = {
    "name": "forward.uav1",
    "vehicle": "uav1",
    "id": 3,
    "body": "aero2",
    "frame_rate_hz": 180,
    "rate_hz": 60,
    "stale_s": 0.1,
    "noise": {"position_m": 0.001, "rotation_deg": 0.5},
    "origin": {"lat_deg": 38.7, "lon_deg": -9.1, "alt_m": 100.0},
}
GENERIC_RPY = np.radians([10.0, -20.0, 35.0])


def frame(
    number: int, *, at: float | None = None, x: float | None = None, tracked: bool = True
) -> CapturedFrame:
    x = 0.001 * number if x is None else x
    pose = Pose("aero2", (x, 2.0, -1.0), tuple(quat_from_euler(GENERIC_RPY).tolist()))
    return CapturedFrame(
        number,
        number / 180.0 if at is None else at,
        (pose,) if tracked else (),
        () if tracked else ("aero2",),
    )


def decode(data: bytes):
    (message,) = mavlink.MAVLink(None).parse_buffer(data)
    return message


def from_autopilot(message, system: int = 3) -> bytes:
    return message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1))


def heartbeat(armed: bool = False) -> bytes:
    return from_autopilot(mavlink.MAVLink_heartbeat_message(2, 12, 128 if armed else 1, 0, 4, 3))


def test_every_third_frame_is_sent_also_after_lost_frames():
    forwarder = Forwarder(SETTINGS)
    sent = [n for n in range(300) if n not in (30, 31, 100, 102) and forwarder.on_frame(frame(n), n / 180)]
    assert sent == [{30: 32, 102: 103}.get(n, n) for n in range(0, 300, 3)]


def test_odometry_has_ned_pose_covariance_and_vision_type():
    m = decode(Forwarder(SETTINGS).on_frame(frame(0), 0.0))
    assert m.get_type() == "ODOMETRY"
    assert (m.frame_id, m.child_frame_id) == (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD)
    assert m.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_VISION
    assert (m.get_srcSystem(), m.get_srcComponent()) == (3, 197)
    assert (m.x, m.y, m.z) == (0.0, 2.0, -1.0)
    assert np.allclose(m.q, quat_from_euler(GENERIC_RPY), atol=1e-6)
    assert all(math.isnan(v) for v in (m.vx, m.vy, m.vz, m.rollspeed, m.pitchspeed, m.yawspeed))
    diagonal = [m.pose_covariance[k] for k in (0, 6, 11, 15, 18, 20)]
    assert diagonal == pytest.approx([1e-6] * 3 + [math.radians(0.5) ** 2] * 3)
    assert sum(c != 0 for c in m.pose_covariance) == 6, (
        "independent noise; NaN off the diagonal would say that nothing is known"
    )
    assert math.isnan(m.velocity_covariance[0])


def test_untracked_body_sends_nothing():
    forwarder = Forwarder(SETTINGS)
    assert forwarder.on_frame(frame(0), 0.0)
    assert all(forwarder.on_frame(frame(n, tracked=False), n / 180) is None for n in range(1, 30))
    assert forwarder.counts["untracked"] == 29


def test_frozen_pose_is_dropped():
    forwarder = Forwarder(SETTINGS)
    assert forwarder.on_frame(frame(0, x=1.0), 0.0)
    assert all(forwarder.on_frame(frame(n, x=1.0), n / 180) is None for n in range(1, 30))
    assert forwarder.counts["frozen"] == 29


def test_repeated_and_reordered_frames_are_dropped():
    forwarder = Forwarder(SETTINGS)
    assert forwarder.on_frame(frame(6), 0.0)
    assert forwarder.on_frame(frame(6, x=9.0), 0.001) is None
    assert forwarder.on_frame(frame(3), 0.002) is None
    assert forwarder.counts["repeated frame"] == 2


def test_stale_pose_is_dropped():
    forwarder = Forwarder(SETTINGS)
    for n in range(0, 180):
        forwarder.on_frame(frame(n), n / 180 + 0.01)
    held = [forwarder.on_frame(frame(n), 1.5) for n in range(180, 220)]
    assert not any(held)
    assert forwarder.counts["stale"] > 0
    assert forwarder.on_frame(frame(273), 273 / 180 + 0.012)


def test_restarted_server_is_accepted():
    forwarder = Forwarder(SETTINGS)
    before = decode(forwarder.on_frame(frame(200), 500.0))
    sent = [decode(d) for n in range(30) if (d := forwarder.on_frame(frame(n), 510.0 + n / 180))]
    assert len(sent) == 8, "nine old frames in a row are no reordering; from then on every third"
    assert {m.reset_counter for m in sent} == {before.reset_counter + 1}


def test_readiness_needs_poses_and_an_autopilot_that_may_arm():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_frame(frame(0), 0.0)
    assert not forwarder.serving
    bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK

    def status(health):
        return from_autopilot(
            mavlink.MAVLink_sys_status_message(bit, bit, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        )

    forwarder.on_mavlink(status(0), 0.1)
    assert not forwarder.serving
    forwarder.on_mavlink(status(bit), 0.2)
    assert forwarder.serving


def test_forwarder_is_ready_for_a_landed_vehicle_in_auto_land():
    forwarder = Forwarder(SETTINGS)
    land = mavlink.MAVLink_heartbeat_message(2, 12, 1, 4 << 16 | 6 << 24, 4, 3)
    forwarder.on_frame(frame(0), 0.0)
    assert not forwarder.serving
    forwarder.on_mavlink(from_autopilot(land), 0.1)
    assert forwarder.serving


def origins(datagrams: list[bytes]) -> list:
    return [m for m in map(decode, datagrams) if m.get_type() == "SET_GPS_GLOBAL_ORIGIN"]


def test_origin_is_sent_until_confirmed_and_never_while_armed():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_frame(frame(0), 0.0)
    assert not origins(forwarder.tick(0.0)), "nobody is there to hear it"
    forwarder.on_mavlink(heartbeat(), 1.0)
    (m,) = origins(forwarder.tick(1.1))
    assert (m.latitude, m.longitude) == (387000000, -91000000)
    assert m.altitude == 0, (
        "PX4 v1.16 takes its height anew after a gap as if this were 0, and sees itself fall by any other"
    )
    forwarder.on_mavlink(
        from_autopilot(mavlink.MAVLink_gps_global_origin_message(387000000, -91000000, 100000, 0)), 1.2
    )
    forwarder.on_mavlink(heartbeat(), 2.1)
    assert not origins(forwarder.tick(2.2))
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_system_time_message(0, 50_000)), 2.3)
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_system_time_message(0, 100)), 2.4)
    assert origins(forwarder.tick(3.3)), "time ran backwards: the autopilot has restarted"
    forwarder.on_mavlink(heartbeat(armed=True), 3.4)
    assert not origins(forwarder.tick(5.0))


def test_restart_without_a_gap_in_time_is_found_by_the_sequence_numbers():
    """A PX4 in lockstep restarts within a second, and its time since boot is the simulation time."""
    forwarder, codec = Forwarder(SETTINGS), mavlink.MAVLink(None, srcSystem=3, srcComponent=1)

    def pass_on(message, now: float) -> None:
        forwarder.on_mavlink(message.pack(codec), now)
        codec.seq = (codec.seq + 1) % 256

    def send(count: int, now: float, *, armed: bool = False) -> None:
        for _ in range(count):
            base = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
            pass_on(mavlink.MAVLink_heartbeat_message(2, 12, base, 0, 4, 3), now)

    forwarder.on_frame(frame(0), 0.0)
    send(100, 1.0)
    assert origins(forwarder.tick(1.1))
    origin = mavlink.MAVLink_gps_global_origin_message(387000000, -91000000, 100000, 0)
    pass_on(origin, 1.2)
    send(300, 1.3)
    assert not origins(forwarder.tick(2.2)), "the number after 255 is 0"
    codec.seq = (codec.seq + 7) % 256
    send(300, 2.3)
    assert not origins(forwarder.tick(3.2)), "lost messages are no restart"
    codec.seq = 250
    send(50, 3.21)
    pass_on(origin, 3.22)
    codec.seq = 254
    send(100, 3.23)
    codec.seq = 0
    send(1, 3.3)
    assert origins(forwarder.tick(4.2))
    pass_on(origin, 4.3)
    send(100, 4.4, armed=True)
    codec.seq = 0
    send(1, 4.5, armed=True)
    send(50, 4.6)
    assert not origins(forwarder.tick(5.4)), "messages were lost: the vehicle was still armed after the jump"
    send(100, 5.5, armed=True)
    codec.seq = 0
    send(2, 5.6)  # the first heartbeats of a restarted PX4
    assert origins(forwarder.tick(6.5))


def standing(state: int = mavlink.MAV_LANDED_STATE_ON_GROUND) -> bytes:
    return from_autopilot(mavlink.MAVLink_extended_sys_state_message(0, state))


def sent_between(forwarder: Forwarder, first: int, last: int) -> int:
    return sum(forwarder.on_frame(frame(n), n / 180) is not None for n in range(first, last))


def test_first_heartbeat_is_requested_once_a_second_from_the_first_message_on():
    def requests(datagrams: list[bytes]) -> list[tuple[int, float]]:
        found = [decode(d) for d in datagrams]
        return [(m.command, m.param1) for m in found if m.get_type() == "COMMAND_LONG"]

    forwarder = Forwarder(SETTINGS)
    assert requests(forwarder.tick(0.0)) == []
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_extended_sys_state_message(0, 1)), 0.1)
    assert requests(forwarder.tick(0.2)) == [(mavlink.MAV_CMD_REQUEST_MESSAGE, 0.0)]
    assert requests(forwarder.tick(0.3)) == [] and requests(forwarder.tick(1.3)) != []
    forwarder.on_mavlink(heartbeat(), 1.4)
    assert requests(forwarder.tick(2.6)) == []


def test_origin_and_position_precede_the_first_pose_on_the_ground():
    """Otherwise PX4's preflight check reports "horizontal position unstable"."""
    forwarder = Forwarder(SETTINGS)
    assert sent_between(forwarder, 0, 18) == 6, "to one that is not heard they go at once: it may be flying"
    forwarder.on_mavlink(heartbeat(), 0.1)
    forwarder.on_mavlink(standing(), 0.1)
    assert sent_between(forwarder, 18, 180) == 0 and forwarder.counts["held for the origin"] == 54
    origin, place = (decode(d) for d in forwarder.tick(1.0) if decode(d).get_type() != "HEARTBEAT")
    assert origin.get_type() == "SET_GPS_GLOBAL_ORIGIN" and (place.command, place.target_system) == (
        43003,
        forwarder.system,
    )
    assert math.isnan(place.z), "its height is left to the poses"
    refused = mavlink.MAVLink_command_ack_message(
        43003, mavlink.MAV_RESULT_UNSUPPORTED, 0, 0, forwarder.system, 197
    )
    forwarder.on_mavlink(from_autopilot(refused), 1.01)
    assert sent_between(forwarder, 183, 201) == 6, (
        "any answer will do: an autopilot that does not know the command goes on"
    )


@pytest.mark.parametrize(
    "said", [heartbeat(armed=True), standing(mavlink.MAV_LANDED_STATE_IN_AIR)], ids=["armed", "in the air"]
)
def test_vehicle_that_may_be_flying_gets_poses_at_once(said: bytes):
    forwarder = Forwarder(SETTINGS)
    forwarder.on_mavlink(heartbeat(), 0.0)
    forwarder.on_mavlink(said, 0.0)
    assert sent_between(forwarder, 0, 18) == 6


def test_wait_for_the_origin_is_limited():
    unknown, deaf = Forwarder(SETTINGS), Forwarder(SETTINGS)
    for forwarder in (unknown, deaf):
        forwarder.on_mavlink(heartbeat(), 0.0)
    deaf.on_mavlink(standing(), 0.0)
    assert sent_between(unknown, 0, 54) == 0 and sent_between(unknown, 54, 72) == 6
    assert sent_between(deaf, 0, 540) == 0 and sent_between(deaf, 540, 558) == 6


def test_first_pose_waits_briefly_for_the_autopilots_first_message():
    """An autopilot that has booted before its forwarder would otherwise follow the first pose before it has an origin."""
    forwarder = Forwarder(SETTINGS, wait_s=0.3)
    assert sent_between(forwarder, 0, 54) == 0 and sent_between(forwarder, 54, 72) == 6
    heard = Forwarder(SETTINGS, wait_s=0.3)
    heard.on_mavlink(heartbeat(armed=True), 0.0)
    assert sent_between(heard, 0, 18) == 6


def test_global_position_has_the_offset_of_the_pose():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_frame(frame(0, x=11.0), 0.0)
    forwarder.on_mavlink(heartbeat(), 0.0)
    (place,) = (m for m in map(decode, forwarder.tick(0.1)) if m.get_type() == "COMMAND_INT")
    degree = 6_371_000.0 * math.radians(1.0)
    assert place.x - 387000000 == pytest.approx(1e7 * 11.0 / degree, abs=1)
    assert place.y + 91000000 == pytest.approx(1e7 * 2.0 / degree / math.cos(math.radians(38.7)), abs=1)


def test_timesync_is_never_answered():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_timesync_message(0, 123456)), 0.0)
    kinds = {decode(d).get_type() for d in forwarder.tick(0.1)}
    assert kinds <= {"HEARTBEAT", "SET_GPS_GLOBAL_ORIGIN", "COMMAND_LONG"}


def test_messages_of_other_vehicles_are_ignored():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_mavlink(
        from_autopilot(mavlink.MAVLink_heartbeat_message(2, 12, 129, 0, 4, 3), system=4), 0.0
    )
    assert not forwarder.autopilot.armed
    assert forwarder.counts["foreign message"] == 1


def test_messages_that_the_forwarder_does_not_read_are_no_foreign_messages():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_estimator_status_message(0, *(0,) * 9)), 0.5)
    assert forwarder.autopilot.since == 0.5, "the autopilot sends"
    forwarder.on_mavlink(from_autopilot(mavlink.MAVLink_estimator_status_message(0, *(0,) * 9), 4), 0.6)
    assert forwarder.counts["foreign message"] == 1
    assert not forwarder.garbled


def test_heartbeat_of_mavlink_1_is_read():
    forwarder, sender = Forwarder(SETTINGS), mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    message = mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)
    forwarder.on_mavlink(message.pack(sender, force_mavlink1=True), 0.5)
    autopilot = forwarder.autopilot
    assert (autopilot.armed, autopilot.mode, autopilot.last_heartbeat) == (True, "OFFBOARD", 0.5)


@given(st.lists(st.binary(max_size=300), max_size=10))
def test_any_bytes_on_the_link_are_accepted(chunks):
    forwarder = Forwarder(SETTINGS)
    for chunk in chunks:
        forwarder.on_mavlink(chunk, 0.0)
    forwarder.on_mavlink(heartbeat(armed=True), 1.0)
    forwarder.on_mavlink(heartbeat(armed=True), 1.1)
    assert forwarder.autopilot.armed


@pytest.mark.parametrize("version", ["3.1", "4.1"])
def test_truth_passes_unchanged_through_emulator_client_and_forwarder(version):
    """World -> emulator -> NatNet bytes -> receiver -> forwarder -> ODOMETRY, at a generic attitude and place."""
    truth = Truth(
        time_s=1.0,
        p_n=np.array([[9.0, 9.0, 9.0], [1.25, -0.5, -1.75]]),
        q_nb=np.array([[1.0, 0, 0, 0], quat_from_euler(GENERIC_RPY)]),
        v_n=np.zeros((2, 3)),
        omega_b=np.zeros((2, 3)),
        accel_b=np.zeros((2, 3)),
        motors=np.zeros((2, 4)),
    )
    slice_ = {
        "version": version,
        "rate_hz": 180,
        "latency_ms": 10,
        "bodies": [
            {"name": "other", "number": 1, "index": 0},
            {"name": "aero2", "number": 2, "index": 1},
        ],
        "noise": {"position_m": 0.0, "rotation_deg": 0.0},
        "seed": 1,
        "transport": "multicast",
        "data_port": 1511,
        "group": "239.255.42.99",
    }
    cameras, server = EmulatedCameras(slice_), NatNetServer(slice_)
    receiver = NatNetReceiver(["aero2"])
    for _ in range(2):
        receiver.receive(server.reply(receiver.next_request(), ("127.0.0.1", 5), 0.0))
    packet = server.encode(cameras.measure(180, row(truth)), 1.01)
    m = decode(Forwarder(SETTINGS).on_frame(receiver.receive(packet), 1.01))
    assert np.allclose((m.x, m.y, m.z), truth.p_n[1], atol=1e-6)
    assert np.allclose(m.q, truth.q_nb[1], atol=1e-6)
