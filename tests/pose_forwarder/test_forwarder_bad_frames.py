"""Bad frames: wrong time stamps, queues, restarts, and frames without noise."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.mocap.client import CapturedFrame, Pose
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet.receiver import NatNetReceiver
from arena.pose_forwarder.forwarder import Forwarder

RATE = 180
SETTINGS = {
    "name": "forward.uav1",
    "vehicle": "uav1",
    "id": 3,
    "body": "b",
    "frame_rate_hz": RATE,
    "rate_hz": 60,
    "stale_s": 0.1,
    "noise": {"position_m": 0.001, "rotation_deg": 0.5},
    "origin": {"lat_deg": 38.7, "lon_deg": -9.1, "alt_m": 100.0},
}
WITHOUT_NOISE = {"noise": {"position_m": 0.0, "rotation_deg": 0.0}}


def frame(number: int, stamp: float | None = None, pose: Pose | None = None) -> CapturedFrame:
    pose = pose or Pose("b", (0.001 * (number % 5000), 2.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    return CapturedFrame(number, number / RATE if stamp is None else stamp, (pose,), ())


def fly(forwarder: Forwarder, numbers, delay: float = 0.01) -> int:
    """Pass frames one by one, each `delay` after its stamp; return the number of poses sent."""
    return sum(forwarder.on_frame(frame(n), n / RATE + delay) is not None for n in numbers)


def arm(forwarder: Forwarder, armed: bool = True) -> None:
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 129 if armed else 1, 0, 4, 3)
    forwarder.on_mavlink(beat.pack(mavlink.MAVLink(None, srcSystem=3, srcComponent=1)), 0.0)


def decode(data: bytes):
    (message,) = mavlink.MAVLink(None).parse_buffer(data)
    return message


@pytest.mark.parametrize("lost_every", [4, 5, 7, 100])
def test_60_poses_a_second_are_sent_although_single_frames_are_lost(lost_every):
    assert fly(Forwarder(SETTINGS), (n for n in range(1800) if n % lost_every)) == 600


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf, 1e300, -1e300, 5.0 + 180 / RATE])
def test_single_wrong_time_stamp_drops_one_frame(stamp):
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180))
    assert forwarder.on_frame(frame(180, stamp), 180 / RATE + 0.01) is None
    assert fly(forwarder, range(181, 360)) == 60
    assert fly(forwarder, range(360, 400), delay=0.25) == 0, "the guard still stands"


def test_no_pose_is_sent_from_a_frame_with_two_bodies_of_the_same_id():
    version, forwarder, receiver = (4, 1), Forwarder(SETTINGS), NatNetReceiver(["b"])
    info = natnet.ServerInfo(
        name="x", app_version=(4, 1, 0, 0), version=version, clock_hz=RATE, data_port=9, group=""
    )
    receiver.receive(natnet.encode_server_info(info))
    receiver.receive(natnet.encode_models([(5, "b")], version))
    sent = []
    for number in range(30):
        places = (0.01 * number, 3.0) if 10 <= number < 20 else (0.01 * number,)
        bodies = tuple(natnet.Body(5, (east, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)) for east in places)
        data = natnet.encode_frame(natnet.Frame(number, number / RATE, number, bodies), version)
        if forwarder.on_frame(receiver.receive(data), number / RATE) is not None:
            sent.append(number)
    assert sent == [0, 3, 6, 9, 20, 21, 24, 27]
    assert forwarder.counts["untracked"] == 10


def test_queue_of_old_frames_is_dropped():
    """Frames of 11 s are waiting: the oldest one must not become the reference of the others."""
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180))
    held = [frame(n) for n in range(180, 440)]
    assert forwarder.on_frames(held, 12.0) is None
    assert forwarder.counts["stale"] == len(held)
    assert fly(forwarder, range(2160, 2340)) == 60


def test_only_the_newest_of_waiting_frames_is_sent():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    m = decode(forwarder.on_frames([frame(n) for n in range(180, 190)], 189 / RATE + 0.01))
    assert m.x == pytest.approx(0.189)
    assert forwarder.counts["superseded"] == 3


def test_full_queue_is_stale_while_flying():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    arm(forwarder)
    assert fly(forwarder, range(180, 180 + 20 * RATE), delay=0.4) == 0


def test_server_clock_set_back_is_accepted_on_the_ground():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    assert fly(forwarder, range(180, 180 + 2 * RATE), delay=0.4) == 0
    assert fly(forwarder, range(180 + 2 * RATE, 180 + 6 * RATE), delay=0.4) > 100


def test_server_clock_set_forward_is_accepted_after_nine_frames():
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180), delay=9.0)
    assert fly(forwarder, range(180, 360), delay=4.0) >= 57


def test_body_at_rest_without_noise_is_not_frozen():
    still = Pose("b", (1.0, 2.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    ideal = Forwarder({**SETTINGS, **WITHOUT_NOISE, "simulated": True})
    assert sum(ideal.on_frame(frame(n, pose=still), n / RATE) is not None for n in range(180)) == 60


def test_frozen_pose_of_real_cameras_is_dropped_whatever_the_noise():
    """`mocap.noise` is the noise of the emulator: 0 in the YAML does not switch off this check for a real vehicle."""
    still = Pose("b", (1.0, 2.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    real = Forwarder({**SETTINGS, **WITHOUT_NOISE, "simulated": False})
    assert sum(real.on_frame(frame(n, pose=still), n / RATE) is not None for n in range(180)) == 1
    assert real.counts["frozen"] == 179


@given(st.tuples(*[st.floats()] * 3), st.tuples(*[st.floats()] * 4), st.floats(), st.integers(0, 2**31))
def test_only_valid_poses_are_sent(p_n, q_nb, stamp, number):
    forwarder = Forwarder(SETTINGS)
    data = forwarder.on_frame(frame(number, stamp, Pose("b", p_n, q_nb)), 1.0)
    if data is not None:
        m = decode(data)
        assert all(math.isfinite(x) for x in (m.x, m.y, m.z, *m.q))
        assert 0.9 < math.sqrt(sum(x * x for x in m.q)) < 1.1


def test_foreign_origin_is_replaced():
    forwarder = Forwarder(SETTINGS)
    forwarder.on_frame(frame(0), 0.0)
    voice = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    elsewhere = mavlink.MAVLink_gps_global_origin_message(10, 10, 0, 0).pack(voice)
    asked = 0
    for second in range(10):
        forwarder.on_mavlink(elsewhere, second)
        forwarder.on_mavlink(mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3).pack(voice), second)
        asked += sum(decode(d).get_type() == "SET_GPS_GLOBAL_ORIGIN" for d in forwarder.tick(second + 0.1))
    assert asked == 5, "it is asked five times, then left alone"


def test_sequence_numbers_rise():
    forwarder = Forwarder(SETTINGS)
    sent = [decode(d).get_seq() for n in range(12) if (d := forwarder.on_frame(frame(n), n / RATE))]
    assert sent == [0, 1, 2, 3]
