"""Poses, modes and times of a film, from logs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from arena.geometry import euler_from_quat
from arena.render.script import _state, picture_times
from arena.render.tracks import at, flown_span, track

from .synthetic import START_S, circle_flight


def test_pose_between_two_rows_is_interpolated():
    times = np.array([3.01, 4.4999, 7.777])
    now = at(track(circle_flight(), START_S), times)
    expected = np.stack([np.cos(0.5 * times), np.sin(0.5 * times), np.full(3, -1.0)], axis=1)
    assert now.p_n == pytest.approx(expected, abs=2e-4)
    assert euler_from_quat(now.q_nb) == pytest.approx(
        np.stack([np.full(3, 0.1), np.full(3, -0.2), np.mod(0.5 * times + np.pi, 2 * np.pi) - np.pi], axis=1),
        abs=2e-4,
    )


def test_quaternion_that_changes_its_sign_turns_the_short_way():
    flight = circle_flight()
    flipped = {
        name: np.where(np.arange(flight.t.size) % 2, -values, values) if ".att_q." in name else values
        for name, values in flight.numbers.items()
    }
    times = np.array([3.01, 5.55])
    plain = at(track(flight, START_S), times)
    other = at(track(dataclasses.replace(flight, numbers=flipped), START_S), times)
    assert np.abs((plain.q_nb * other.q_nb).sum(axis=1)) == pytest.approx(1.0)


def test_mode_and_armed_flag_are_those_of_the_last_row():
    now = at(track(circle_flight(), START_S), np.array([0.0, 1.99, 2.01, 10.1]))
    assert list(now.mode) == ["AUTO.LOITER", "AUTO.LOITER", "OFFBOARD", "AUTO.LOITER"]
    assert now.armed.tolist() == [False, False, True, False]


def test_state_without_heartbeats_is_unknown_and_not_disarmed():
    flight = circle_flight()
    silent = np.where(flight.t < 1.0, np.nan, flight.numbers["info.is_armed"])
    late = dataclasses.replace(flight, numbers={**flight.numbers, "info.is_armed": silent})
    now = at(track(late, START_S), np.array([0.5, 1.5, 5.0]))
    assert [_state(now, k) for k in range(3)] == ["state unknown", "disarmed", "OFFBOARD"]


def test_reference_is_shown_only_while_armed():
    now = at(track(circle_flight(), START_S), np.array([1.0, 5.0]))
    assert np.isnan(now.ref_n[0]).all() and now.ref_n[1] == pytest.approx(now.p_n[1] + 0.5, abs=0.02)


def test_gap_in_the_log_is_marked():
    flight = circle_flight()
    hole = (flight.t > 4.0) & (flight.t < 6.0)
    numbers = {k: np.where(hole, np.nan, v) if ".pos." in k else v for k, v in flight.numbers.items()}
    now = at(track(dataclasses.replace(flight, numbers=numbers), START_S), np.array([3.0, 5.0, 7.0]))
    assert now.known.tolist() == [True, False, True]


def test_vehicle_stands_still_outside_its_log():
    moved = track(circle_flight(), START_S)
    now = at(moved, np.array([-5.0, 500.0]))
    assert now.p_n == pytest.approx(np.stack([moved.p_n[0], moved.p_n[-1]])) and now.known.all()


def test_log_of_one_row_is_a_vehicle_that_stands():
    flight = circle_flight(seconds=0.0)
    assert at(track(flight, START_S), np.array([-1.0, 0.0, 9.0])).p_n == pytest.approx(
        np.tile([1, 0, -1], (3, 1))
    )


def test_log_without_position_has_no_track():
    flight = circle_flight()
    nothing = {k: np.full(flight.t.size, np.nan) for k in flight.numbers}
    assert track(dataclasses.replace(flight, numbers=nothing), START_S) is None


def test_film_lasts_from_before_the_arming_to_after_the_disarming():
    tracks = [track(circle_flight(), START_S), track(circle_flight("uav2", seconds=9.0), START_S)]
    assert flown_span(tracks) == pytest.approx((1.0, 11.5), abs=0.05)


def test_film_of_an_unarmed_vehicle_is_the_whole_log():
    flight = circle_flight()
    idle = dataclasses.replace(flight, armed=np.zeros(flight.t.size, bool))
    assert flown_span([track(idle, START_S)]) == pytest.approx((0.0, 12.0))


@pytest.mark.parametrize(
    ("fps", "speed", "count", "step"), [(10.0, 1.0, 41, 0.1), (25.0, 2.0, 51, 0.08), (10.0, 8.0, 6, 0.8)]
)
def test_pictures_follow_at_equal_times(fps, speed, count, step):
    times = picture_times(1.0, 5.0, fps, speed)
    assert len(times) == count and times[0] == 1.0 and times[-1] <= 5.0 + 1e-9
    assert np.diff(times) == pytest.approx(step)
