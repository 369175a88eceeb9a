"""Tests of trajectories: derivatives fit, ends are at rest, limits hold, wrong input is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.errors import InputError
from arena.trajectories import (
    Circle,
    Limits,
    Lissajous,
    MinimumSnap,
    Moved,
    Sampled,
    SetpointList,
    TimeOptimal,
    read_csv,
    segment_times,
)

WAYPOINTS = np.array([[0.0, 0, -1], [1.5, 0.5, -1.4], [1.0, 2.0, -1.2], [-0.5, 1.0, -1]])
TIMES = segment_times(WAYPOINTS, 1.0)
SMOOTH = {
    "lissajous": Lissajous(
        [0.1, -0.2, -1.2], [1.2, 0.8, 0.2], [1, 2, 3], phase=[0.3, 0, 1.0], lap_s=6.0, laps=2
    ),
    "circle": Circle([0, 0, -1], 1.0, bearing=0.7, lap_s=5.0, laps=-1.5, nose="tangent"),
    "short circle": Circle([0, 0, -1], 1.0, lap_s=5.0, laps=0.25, ramp_s=4.0, nose="centre"),
    "minimum snap": MinimumSnap(WAYPOINTS, TIMES, yaw=[0, 1, 2, 3]),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_velocity_and_acceleration_are_the_derivatives_of_the_position(name):
    trajectory, h = SMOOTH[name], 1e-4
    for t in np.linspace(0.1, trajectory.duration_s - 0.1, 60):
        before, at, after = (trajectory.at(t + k * h) for k in (-1, 0, 1))
        np.testing.assert_allclose((after.pos - before.pos) / (2 * h), at.vel, atol=1e-5)
        np.testing.assert_allclose((after.vel - before.vel) / (2 * h), at.acc, atol=1e-4)
        turned = math.remainder(after.yaw - before.yaw, 2 * math.pi)
        assert turned / (2 * h) == pytest.approx(at.yaw_rate, abs=1e-5)


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("t", [-1.0, 0.0, 1e9])
def test_a_smooth_trajectory_rests_at_both_ends(name, t):
    at = SMOOTH[name].at(t)
    assert np.abs(at.vel).max() < 1e-9 and np.isfinite(at.pos).all()


@pytest.mark.parametrize("name", SMOOTH)
def test_velocity_has_no_steps(name):
    trajectory = SMOOTH[name]
    times = np.arange(-0.05, trajectory.duration_s + 0.05, 1e-3)
    speeds = np.array([trajectory.at(t).vel for t in times])
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.02


def test_a_lissajous_figure_of_whole_laps_ends_where_it_began():
    trajectory = Lissajous([1, 2, -1], [1, 0.5, 0], [1, 2, 0], lap_s=4.0, laps=3)
    np.testing.assert_allclose(trajectory.at(trajectory.duration_s).pos, [1, 2, -1], atol=1e-9)
    assert trajectory.duration_s == pytest.approx(12.0 + 2.0)


def test_a_circle_keeps_its_radius_and_turns_clockwise_seen_from_above():
    trajectory = Circle([0, 0, -1], 2.0, bearing=0.0, lap_s=8.0, laps=1)
    for t in np.linspace(0, trajectory.duration_s, 20):
        assert np.linalg.norm(trajectory.at(t).pos - [2, 0, -1]) == pytest.approx(2.0)
    # the centre is north of the start: clockwise means first to the west
    assert trajectory.at(2.0).pos[1] < -0.1


def test_minimum_snap_passes_every_waypoint_at_its_time():
    trajectory = SMOOTH["minimum snap"]
    for t, point in zip([0.0, *np.cumsum(TIMES)], WAYPOINTS, strict=True):
        np.testing.assert_allclose(trajectory.at(t).pos, point, atol=1e-9)


def test_no_other_smooth_curve_through_the_waypoints_has_less_snap():
    """A bump that keeps waypoints and ends costs snap, whatever its sign: the first variation is zero."""
    trajectory = MinimumSnap(WAYPOINTS, TIMES)
    n = 4001
    t = np.linspace(0, trajectory.duration_s, n)
    path = np.array([trajectory.at(x).pos[0] for x in t])
    knots = np.concatenate([[0.0], np.cumsum(TIMES)])
    bump = np.prod([(t - k) / trajectory.duration_s for k in knots], axis=0)
    bump *= (t * (trajectory.duration_s - t)) ** 4
    bump *= 0.05 / np.abs(bump).max()

    def snap(x):
        for _ in range(4):
            x = np.gradient(x, t)
        return np.trapezoid(x[8:-8] ** 2, t[8:-8])

    assert snap(path) < min(snap(path + bump), snap(path - bump))


def test_setpoints_are_held_for_their_times():
    trajectory = SetpointList([([0, 0, -1], 0.0, 2.0), ([1, 0, -1], 1.5, 3.0)])
    assert trajectory.duration_s == 5.0
    assert trajectory.at(1.99).pos[0] == 0.0 and trajectory.at(2.0).pos[0] == 1.0
    assert trajectory.at(99.0).yaw == 1.5 and not trajectory.at(2.5).vel.any()


def test_time_optimal_moves_keep_their_limits_and_stop_at_the_waypoints():
    pytest.importorskip("ruckig")
    limits = Limits(horizontal_m_s=1.5, vertical_m_s=0.8, acceleration_m_s2=2.0, jerk_m_s3=6.0)
    trajectory = TimeOptimal(WAYPOINTS, limits)
    found = [trajectory.at(t) for t in np.linspace(0, trajectory.duration_s, 2000)]
    speed, acc = np.array([r.vel for r in found]), np.array([r.acc for r in found])
    assert (np.abs(speed).max(axis=0) <= np.array([1.5, 1.5, 0.8]) + 1e-9).all()
    assert np.abs(acc).max() <= 2.0 + 1e-9 and np.abs(speed).max() > 0.9 * 0.8
    np.testing.assert_allclose(trajectory.at(trajectory.duration_s).pos, WAYPOINTS[-1], atol=1e-9)
    slowest = [
        min(np.linalg.norm(r.vel) for r in found if np.linalg.norm(r.pos - point) < 0.02)
        for point in WAYPOINTS
    ]
    assert max(slowest) < 0.3


def test_a_moved_trajectory_keeps_its_velocity():
    moved = Moved(trajectory=SMOOTH["circle"], offset=np.array([1.0, -2.0, 0.5]))
    at, original = moved.at(1.3), SMOOTH["circle"].at(1.3)
    np.testing.assert_allclose(at.pos - original.pos, [1, -2, 0.5])
    assert (
        (at.vel == original.vel).all()
        and at.yaw == original.yaw
        and moved.duration_s == SMOOTH["circle"].duration_s
    )


@given(st.floats(-0.5, 3.5), st.lists(st.floats(-5, 5), min_size=4, max_size=4))
def test_samples_of_a_straight_line_give_the_line(t, heights):
    line = Sampled([0, 1, 2, 3], [[k, 2 * k, -1] for k in range(4)])
    at = min(max(t, 0), 3)
    np.testing.assert_allclose(line.at(t).pos, [at, 2 * at, -1], atol=1e-9)
    Sampled([0, 1, 2, 3], [[0, 0, h] for h in heights]).at(t)


def test_yaw_of_samples_takes_the_short_way():
    turned = Sampled([0, 1], [[0, 0, 0], [0, 0, 0]], yaw=[3.0, -3.0])
    assert turned.at(0.5).yaw == pytest.approx(math.pi) and turned.at(0.5).yaw_rate == pytest.approx(
        2 * math.pi - 6
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Lissajous([0, 0], [1, 1, 1], [1, 1, 1], lap_s=1), "three finite numbers"),
        (lambda: Lissajous([0, 0, 0], [1, 1, 1], [1, 1, 1], lap_s=0), "lap_s: got 0"),
        (lambda: Circle([0, 0, 0], 1, lap_s=1, nose="east"), "fixed, tangent or centre"),
        (lambda: MinimumSnap([[0, 0, 0]], []), r"\(1, 3\)"),
        (lambda: MinimumSnap([[0, 0, 0], [1, 0, 0]], [0.0]), "above 0"),
        (lambda: SetpointList([]), "at least one"),
        (lambda: SetpointList([([0, 0, 0], 0, -1)]), "above 0"),
        (lambda: SetpointList([([0, 0, -1], 0, 1), ([np.nan, 0, -1], 0, 1)]), "setpoint 2.*finite"),
        (lambda: SetpointList([([0, 0, -1], np.inf, 1)]), "setpoint 1.*finite"),
        (lambda: Sampled([0, 0], [[0, 0, 0]] * 2), "row 2"),
        (lambda: Sampled([0, 1], [[0, 0, math.nan]] * 2), "finite"),
        (lambda: TimeOptimal([[0, 0, 0]]), r"\(1, 3\)"),
    ],
)
def test_wrong_input_is_refused_with_its_value(make, message):
    with pytest.raises(InputError, match=message):
        make()


# -- CSV files ---------------------------------------------------------------------------------------------------------


def test_a_csv_file_is_read_with_velocity_and_yaw(tmp_path):
    (tmp_path / "a.csv").write_text("t,north,east,down,vx,vy,vz,yaw\n0,0,0,-1,0,0,0,0\n2,1,0,-1,0,0,0,1\n")
    found = read_csv(tmp_path / "a.csv")
    assert found.duration_s == 2.0 and found.at(1.0).pos[0] == pytest.approx(0.5)
    assert found.at(1.0).yaw == pytest.approx(0.5) and found.at(0.0).vel[0] == 0.0


def test_the_references_of_a_log_are_a_trajectory(tmp_path):
    (tmp_path / "log.csv").write_text(
        "time.seconds,ekf.pos.north,pos_ref.north,pos_ref.east,pos_ref.down,pos_ref.yaw\n5,0,,,,\n6,0,0,0,-1,\n7,0,1,0,-1,0.5\n"
    )
    found = read_csv(tmp_path / "log.csv")
    assert found.duration_s == 1.0 and found.at(1.0).pos.tolist() == [1, 0, -1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"a.csv:1: got the columns \(none\)"),
        ("t,a,b\n", "expected t, north"),
        ("t,north,east,down\n0,0,0,x\n", "a.csv:2: .*expected a number"),
        ("t,north,east,down\n0,0,0\n", "a.csv:2: got 3 cells"),
        ("t,north,east,down\n0,0,0,0\n", "got 1 rows"),
        ("t,north,east,down\n1,0,0,0\n0,0,0,0\n", "not later than that of the row before"),
    ],
)
def test_a_wrong_csv_file_is_refused_with_its_line(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_csv(tmp_path / "a.csv")
