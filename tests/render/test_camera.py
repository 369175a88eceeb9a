"""Projection of points and attitudes, the camera that sees everything, and clipping in front of the camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.errors import InputError
from arena.geometry import matrix_from_quat, quat_from_euler
from arena.render.camera import FIELD_OF_VIEW_DEG, NEAR_M, axes_of, clip, fit, look_at
from arena.render.tracks import track
from arena.render.views import View, cameras, flown_volume, parse_view

from .synthetic import circle_flight

SIZE = (1280, 720)


def from_the_south():
    return look_at((-10.0, 0.0, -1.0), (0.0, 0.0, -1.0), SIZE)


def test_target_is_in_the_middle_of_the_picture():
    assert from_the_south().project((0.0, 0.0, -1.0)) == pytest.approx((640.0, 360.0))


def test_east_is_right_and_up_is_up_for_a_camera_in_the_south():
    camera = from_the_south()
    scale = 360.0 / np.tan(np.radians(FIELD_OF_VIEW_DEG / 2)) / 10.0  # pixels per metre at 10 m
    assert camera.project((0.0, 1.0, -1.0)) == pytest.approx((640.0 + scale, 360.0))
    assert camera.project((0.0, 0.0, -2.0)) == pytest.approx((640.0, 360.0 - scale))
    assert camera.pixels_per_metre((0.0, 3.0, 0.0)) == pytest.approx(scale)


def test_size_is_inversely_proportional_to_the_distance():
    camera = from_the_south()
    near, far = (camera.project((n, 1.0, -1.0))[0] - 640.0 for n in (-5.0, 0.0))
    assert near == pytest.approx(2.0 * far)


def test_top_view_has_north_up_and_east_right():
    camera = fit(np.array([(-1.0, -1.0, 0.0), (1.0, 1.0, 0.0)]), 180.0, 90.0, SIZE)
    middle = camera.project((0.0, 0.0, 0.0))
    north, east = camera.project((1.0, 0.0, 0.0)) - middle, camera.project((0.0, 1.0, 0.0)) - middle
    assert north[1] < -50 and abs(north[0]) < 1
    assert east[0] > 50 and abs(east[1]) < 1


def test_attitude_of_a_vehicle_is_drawn_as_it_is():
    """Roll 10, pitch -20, yaw 35 degrees, seen from above and from the south; expected signs by hand."""
    r_nb = matrix_from_quat(quat_from_euler(np.radians([10.0, -20.0, 35.0])))
    nose, right = r_nb @ (1.0, 0.0, 0.0), r_nb @ (0.0, 1.0, 0.0)
    c, s = np.cos, np.sin
    roll, pitch, yaw = np.radians([10.0, -20.0, 35.0])
    assert nose == pytest.approx((c(yaw) * c(pitch), s(yaw) * c(pitch), -s(pitch)))  # textbook, first column
    above = look_at((0.0, 0.0, -20.0), (0.0, 0.0, 0.0), SIZE)
    seen = above.project(0.1 * nose) - (640, 360)
    # Yaw 35 degrees: the nose points clockwise from up, seen from above.
    assert np.degrees(np.arctan2(seen[0], -seen[1])) == pytest.approx(35.0, abs=0.5)
    south = from_the_south()
    middle = south.project((0.0, 0.0, -1.0))
    tip = south.project(np.array([0.0, 0.0, -1.0]) + 0.1 * nose) - middle
    side = south.project(np.array([0.0, 0.0, -1.0]) + 0.1 * right) - middle
    # Pitch -20 degrees: the nose is below the horizon, 0.342 of its length.
    scale = south.pixels_per_metre((0.0, 0.0, -1.0)) * 0.1
    assert tip[1] == pytest.approx(scale * s(np.radians(20.0)), rel=0.02)
    # Roll 10 degrees: the right side is lower.
    assert side[1] == pytest.approx(scale * s(roll) * c(pitch), rel=0.02)
    assert side[0] > 0


@given(
    azimuth=st.floats(0, 360),
    elevation=st.floats(0, 90),
    corner=st.tuples(st.floats(0.5, 30), st.floats(0.5, 30), st.floats(0.5, 12)),
    wide=st.booleans(),
)
def test_fitted_camera_sees_all_points_and_touches_a_border(azimuth, elevation, corner, wide):
    points = np.array([(n, e, -d) for n in (0, corner[0]) for e in (0, corner[1]) for d in (0, corner[2])])
    size = (1280, 720) if wide else (400, 700)
    camera = fit(points, azimuth, elevation, size, margin=0.05)
    assert (camera.depth(points) > NEAR_M).all()
    share = camera.project(points) / size
    assert share.min() >= 0.05 - 1e-6 and share.max() <= 0.95 + 1e-6
    assert (
        share.min(axis=0) == pytest.approx(1.0 - share.max(axis=0), abs=1e-6)
        or np.isclose([share.min(), 1 - share.max()], 0.05, atol=1e-6).any()
    )


@given(azimuth=st.floats(-720, 720), elevation=st.floats(-5, 90))
def test_axes_are_a_rotation_and_the_horizon_is_level(azimuth, elevation):
    axes = axes_of(azimuth, elevation)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 2] == 0.0


def test_polygon_behind_the_camera_is_cut_at_the_near_plane():
    camera = from_the_south()
    floor = np.array([(-20.0, -1.0, 0.0), (-20.0, 1.0, 0.0), (5.0, 1.0, 0.0), (5.0, -1.0, 0.0)])
    cut = clip(camera, floor, closed=True)
    assert len(cut) == 4 and camera.depth(cut).min() == pytest.approx(NEAR_M)
    assert clip(camera, floor - (20.0, 0.0, 0.0), closed=True).shape == (0, 3)


@pytest.mark.parametrize(
    ("text", "view"),
    [
        ("south", View(azimuth_deg=180.0, elevation_deg=16.0)),
        ("200,15.5", View(azimuth_deg=200.0, elevation_deg=15.5)),
        ("follow:uav2", View(follow="uav2")),
    ],
)
def test_text_of_a_view_is_read(text, view):
    assert parse_view(text) == view


@pytest.mark.parametrize("text", ["", "left", "200", "10,95", "follow:", "nan,3"])
def test_unknown_view_is_refused_with_the_known_ones(text):
    with pytest.raises(InputError, match=r"--camera.*expected"):
        parse_view(text)


def test_following_camera_keeps_the_vehicle_near_the_middle():
    tracks, times = [track(circle_flight(), 100.0)], np.arange(0.0, 12.0, 0.5)
    for camera, t in zip(cameras(View(follow="uav1"), tracks, times, 1.0, SIZE), times, strict=True):
        at = camera.project((np.cos(0.5 * t), np.sin(0.5 * t), -1.0))
        assert np.abs(at - (640, 360)).max() < 160


def test_following_an_unknown_vehicle_names_the_known_ones():
    with pytest.raises(InputError, match="expected one of uav1"):
        cameras(View(follow="uav9"), [track(circle_flight(), 100.0)], np.zeros(1), 1.0, SIZE)


def test_orbit_turns_and_sees_the_flown_volume_from_everywhere():
    tracks, times = [track(circle_flight(seconds=40.0), 100.0)], np.arange(0.0, 36.0, 3.0)
    around = cameras(View(orbit=True, elevation_deg=20.0), tracks, times, 1.0, SIZE)
    volume = flown_volume(tracks, 0.0, 36.0)
    for camera in around:
        pixels = camera.project(volume)
        assert pixels.min() >= 0 and (pixels <= SIZE).all()
    headings = [np.arctan2(c.axes[2, 1], c.axes[2, 0]) for c in around]
    assert np.degrees(np.diff(np.unwrap(headings))) == pytest.approx(30.0)
