"""Velocity, lean and age from captured poses."""

from __future__ import annotations

import numpy as np
import pytest

from arena.constants import GRAVITY_M_S2
from arena.copilot.tracks import Tracks
from arena.geometry import quat_from_euler, quat_rotate

from .scene import LEVEL, tilted


def feed(
    tracks: Tracks, v: tuple[float, float, float], count: int = 9, start: float = 0.0, noise: float = 0.0
) -> float:
    rng = np.random.default_rng(1)
    for k in range(count):
        t = start + k / 180.0
        p = np.array(v) * t + noise * rng.standard_normal(3)
        tracks.on_pose("a", tuple(p.tolist()), LEVEL, t, t)
    return start + (count - 1) / 180.0


def test_velocity_is_the_slope_of_nine_poses() -> None:
    tracks = Tracks(["a", "b"])
    feed(tracks, (1.0, -2.0, 0.5))
    v, known = tracks.velocities()
    assert known.tolist() == [True, False]
    assert v[0] == pytest.approx([1.0, -2.0, 0.5], abs=1e-6) and not v[1].any()


def test_noise_of_0_3_mm_gives_a_few_cm_per_s() -> None:
    tracks = Tracks(["a"])
    feed(tracks, (0.0, 0.0, 0.0), count=200, noise=3e-4)
    assert np.abs(tracks.velocities()[0]).max() < 0.04


def test_jump_and_gap_restart_the_track() -> None:
    for then in ((5.0, 0.0, 0.0), (0.01, 0.0, 0.0)):
        tracks = Tracks(["a"])
        end = feed(tracks, (0.0, 0.0, 0.0), noise=1e-6)
        later = end + (1 / 180 if then[0] > 1 else 1.0)
        tracks.on_pose("a", then, LEVEL, later, later)
        v, known = tracks.velocities()
        assert not known[0] and not v.any() and tracks.restarted == 1


def test_repeated_pose_is_ignored() -> None:
    tracks = Tracks(["a"])
    tracks.on_pose("a", (1.0, 2.0, 3.0), LEVEL, 1.0, 1.0)
    tracks.on_pose("a", (1.0, 2.0, 3.0), LEVEL, 1.1, 1.1)
    assert tracks.seen_at[0] == 1.0 and tracks.repeated == 1


def test_unknown_bodies_are_ignored() -> None:
    tracks = Tracks(["a"])
    tracks.on_pose("stranger", (1.0, 2.0, 3.0), LEVEL, 1.0, 1.0)
    assert np.isinf(tracks.seen_at[0]) and np.isnan(tracks.positions(1.0)).all()


def test_tilt_gives_the_direction_of_the_acceleration() -> None:
    q_nb = quat_from_euler(np.radians([10.0, -20.0, 35.0]))
    tracks = Tracks(["a"])
    tracks.on_pose("a", (0.0, 0.0, 0.0), tuple(q_nb.tolist()), 0.0, 0.0)
    tilt, lean = tracks.tilt_and_acceleration()
    thrust_n = quat_rotate(q_nb, np.array([0.0, 0.0, -1.0]))
    assert tilt[0] == pytest.approx(np.arccos(-thrust_n[2]))
    assert lean[0, :2] == pytest.approx(GRAVITY_M_S2 * thrust_n[:2] / -thrust_n[2])


def test_nose_up_attitude_has_its_tilt() -> None:
    tracks = Tracks(["a"])
    tracks.on_pose("a", (0.0, 0.0, 0.0), tilted(70.0), 0.0, 0.0)
    assert np.degrees(tracks.tilt_and_acceleration()[0][0]) == pytest.approx(70.0)


def test_estimate_is_compared_with_the_track_of_half_a_second() -> None:
    tracks = Tracks(["a"])
    for k in range(50):
        t = 0.02 * k
        tracks.on_pose("a", (3.0 * t, 0.0, 0.0), LEVEL, t, t)
        tracks.positions(t)
    late, wrong = np.array([[3.0 * 0.78, 0.0, 0.0]]), np.array([[2.0, 0.7, 0.0]])
    assert tracks.distance_to_track(late)[0] == pytest.approx(0.0, abs=1e-6)
    assert tracks.distance_to_track(wrong)[0] == pytest.approx(0.7, abs=0.02)
    assert np.isnan(Tracks(["a"]).distance_to_track(late)[0])
    left = np.array([[3.0 * 0.4, 0.0, 0.0]])  # 0.58 s ago; the track begins at 3 * 0.48 m
    assert tracks.distance_to_track(left)[0] == pytest.approx(3.0 * 0.08)
