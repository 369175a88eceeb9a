"""What would leave a flying vehicle blind, or let it see the past: clocks, queues, restarts, and captures without noise."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.mocap.client import CapturedFrame, Pose
from arena.pose_forwarder.forwarder import Forwarder
from arena.pose_forwarder.lateness import Lateness

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


def frame(number: int, stamp: float | None = None, pose: Pose | None = None) -> CapturedFrame:
    pose = pose or Pose("b", (0.001 * (number % 5000), 2.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    return CapturedFrame(number, number / RATE if stamp is None else stamp, (pose,), ())


def fly(forwarder: Forwarder, numbers, delay: float = 0.01) -> int:
    """Frames that arrive one by one, each `delay` after its stamp; how many poses went on."""
    return sum(forwarder.on_frame(frame(n), n / RATE + delay) is not None for n in numbers)


def arm(forwarder: Forwarder, armed: bool = True) -> None:
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 129 if armed else 1, 0, 4, 3)
    forwarder.on_mavlink(beat.pack(mavlink.MAVLink(None, srcSystem=3, srcComponent=1)), 0.0)


def decode(data: bytes):
    (message,) = mavlink.MAVLink(None).parse_buffer(data)
    return message


@pytest.mark.parametrize("lost_every", [4, 5, 7, 100])
def test_sixty_poses_a_second_go_on_though_single_frames_are_lost(lost_every):
    assert fly(Forwarder(SETTINGS), (n for n in range(1800) if n % lost_every)) == 600


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf, 1e300, -1e300, 5.0 + 180 / RATE])
def test_one_mad_time_stamp_costs_one_frame_and_not_the_flight(stamp):
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180))
    assert forwarder.on_frame(frame(180, stamp), 180 / RATE + 0.01) is None
    assert fly(forwarder, range(181, 360)) == 60
    assert fly(forwarder, range(360, 400), delay=0.25) == 0, "the guard still stands"


def test_a_process_that_was_stopped_wakes_to_a_queue_and_sends_none_of_it():
    """Eleven seconds of frames are waiting: the oldest of them must not become the measure of the others."""
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180))
    held = [frame(n) for n in range(180, 440)]
    assert forwarder.on_frames(held, 12.0) is None
    assert forwarder.counts["stale"] == len(held)
    assert fly(forwarder, range(2160, 2340)) == 60


def test_of_frames_found_waiting_together_the_newest_pose_alone_goes_on():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    m = decode(forwarder.on_frames([frame(n) for n in range(180, 190)], 189 / RATE + 0.01))
    assert m.x == pytest.approx(0.189)
    assert forwarder.counts["superseded"] == 3


def test_a_queue_that_stays_full_is_stale_for_as_long_as_one_flies():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    arm(forwarder)
    assert fly(forwarder, range(180, 180 + 20 * RATE), delay=0.4) == 0


def test_on_the_ground_a_server_whose_clock_was_set_back_is_followed_after_a_while():
    forwarder = Forwarder(SETTINGS)
    fly(forwarder, range(180))
    assert fly(forwarder, range(180, 180 + 2 * RATE), delay=0.4) == 0
    assert fly(forwarder, range(180 + 2 * RATE, 180 + 6 * RATE), delay=0.4) > 100


def test_a_server_whose_clock_was_set_forward_is_followed_after_nine_frames():
    forwarder = Forwarder(SETTINGS)
    arm(forwarder)
    fly(forwarder, range(180), delay=9.0)
    assert fly(forwarder, range(180, 360), delay=4.0) >= 57


def test_a_first_frame_that_was_held_up_is_not_the_measure_of_the_others():
    lateness = Lateness(0.1)
    assert lateness.of(0.0, 0.08, True) == 0.0
    lateness.of(1.0, 1.0, True)
    assert lateness.of(2.0, 2.08, True) == pytest.approx(0.08, abs=0.001)


def test_crystals_that_drift_apart_for_an_hour_make_nothing_stale():
    lateness = Lateness(0.1)
    for drift in (1e-4, -1e-4):
        lateness.forget()
        assert max(lateness.of(t * (1 + drift), t, True) for t in (k / 20 for k in range(72_000))) < 0.01


@given(st.lists(st.tuples(st.floats(), st.floats(0, 0.1)), max_size=40))
def test_after_any_stamps_prompt_frames_are_prompt_again_within_a_second(history):
    lateness, now = Lateness(0.1), 0.0
    for stamp, dt in history:
        now += dt
        lateness.of(stamp, now, False)
    late = [lateness.of(t, t, False) for t in (now + k / RATE for k in range(4 * RATE))]
    assert late[-1] <= 0.1


def test_a_capture_without_noise_may_see_a_body_at_rest():
    still = Pose("b", (1.0, 2.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    ideal = Forwarder({**SETTINGS, "noise": {"position_m": 0.0, "rotation_deg": 0.0}})
    assert sum(ideal.on_frame(frame(n, pose=still), n / RATE) is not None for n in range(180)) == 60


@given(st.tuples(*[st.floats()] * 3), st.tuples(*[st.floats()] * 4), st.floats(), st.integers(0, 2**31))
def test_whatever_a_frame_holds_only_poses_go_on(p_n, q_nb, stamp, number):
    forwarder = Forwarder(SETTINGS)
    data = forwarder.on_frame(frame(number, stamp, Pose("b", p_n, q_nb)), 1.0)
    if data is not None:
        m = decode(data)
        assert all(math.isfinite(x) for x in (m.x, m.y, m.z, *m.q))
        assert 0.9 < math.sqrt(sum(x * x for x in m.q)) < 1.1


def test_an_origin_that_is_not_ours_does_not_pass_for_ours():
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


def test_messages_carry_rising_sequence_numbers():
    forwarder = Forwarder(SETTINGS)
    sent = [decode(d).get_seq() for n in range(12) if (d := forwarder.on_frame(frame(n), n / RATE))]
    assert sent == [0, 1, 2, 3]
