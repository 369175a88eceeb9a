"""Pinhole camera that projects points in the room [m] [NED] to pixels. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry import Array

NEAR_M = 0.1
"""Points nearer to the camera than this distance along its axis are not drawn."""
FIELD_OF_VIEW_DEG = 34.0
"""Vertical field of view. A small angle makes sizes in front and at the back of the room comparable."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Pinhole camera at the position `eye` that looks in the direction `forward`.

    eye: position [m] [NED] (3,).  axes: right, down, forward of the picture as unit vectors [NED] (3, 3).
    width, height: size of the picture [px].
    """

    eye: Array
    axes: Array
    width: int
    height: int

    @property
    def focal_px(self) -> float:
        """Focal length of the camera [px]."""
        return float(0.5 * self.height / np.tan(np.radians(0.5 * FIELD_OF_VIEW_DEG)))

    def depth(self, points_n: ArrayLike) -> Array:
        """Return the distance of points along the camera's axis [m] (...); negative behind the camera.

        points_n: points [m] [NED] (..., 3).
        """
        return np.asarray((np.asarray(points_n, float) - self.eye) @ self.axes[2])

    def project(self, points_n: ArrayLike) -> Array:
        """Project points [NED] to pixels: x to the right, y down, origin at the top left corner of the picture (..., 2).

        points_n: points [m] [NED] (..., 3). The result of points with a depth of NEAR_M or less has no meaning.
        """
        seen = (np.asarray(points_n, float) - self.eye) @ self.axes.T
        depth = np.maximum(seen[..., 2:], NEAR_M)
        return np.asarray(self.focal_px * seen[..., :2] / depth + (0.5 * self.width, 0.5 * self.height))

    def pixels_per_metre(self, point_n: ArrayLike) -> float:
        """Return the scale at a given point, in pixels per metre across the direction of view [px/m].

        point_n: [m] [NED] (3,).
        """
        return float(self.focal_px / np.maximum(self.depth(point_n), NEAR_M))


def axes_of(azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the axes of a camera (right, down, forward) as unit vectors [NED] (3, 3).

    azimuth_deg: direction from the room to the camera, clockwise from north: 180 is a camera in the south.
    elevation_deg: height of the camera above the horizon, seen from the room: 90 looks straight down.
    """
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    forward = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.stack([right, np.cross(forward, right), forward])


def fit(
    points_n: Array, azimuth_deg: float, elevation_deg: float, size: tuple[int, int], *, margin: float = 0.06
) -> Camera:
    """Return the nearest camera with a given direction of view that shows all given points.

    points_n: points that must be visible [m] [NED] (n, 3).  size: width and height of the picture [px].
    margin: free border, as a share of the width and of the height.

    A point (x, z), right of and along the axis, is in the picture of a camera at (cx, cz) with the slope s of its border
    if |x - cx| <= s (z - cz). Both borders touch a point where cx - s cz = max(x - s z) and cx + s cz = min(x + s z).
    """
    axes = axes_of(azimuth_deg, elevation_deg)
    seen = points_n @ axes.T
    slopes = _slopes(size, margin)
    most = (seen[:, :2] - slopes * seen[:, 2:]).max(axis=0)
    least = (seen[:, :2] + slopes * seen[:, 2:]).min(axis=0)
    across = 0.5 * (most + least)
    along = float(min((0.5 * (least - most) / slopes).min(), seen[:, 2].min() - 2.0 * NEAR_M))
    return Camera(eye=np.array([*across, along]) @ axes, axes=axes, width=size[0], height=size[1])


def distance_to_see(
    points_n: Array, centre_n: Array, axes: Array, size: tuple[int, int], *, margin: float = 0.06
) -> float:
    """Return the smallest distance [m] from `centre_n` at which a camera shows all given points.

    points_n: [m] [NED] (n, 3).  centre_n: [m] [NED] (3,).  axes: right, down, forward of the camera (3, 3).
    size: width and height of the picture [px].  margin: free border, as a share of the width and of the height.
    """
    seen = (points_n - centre_n) @ axes.T
    return float((np.abs(seen[:, :2]) / _slopes(size, margin) - seen[:, 2:]).max())


def _slopes(size: tuple[int, int], margin: float) -> Array:
    """Return half the width and half the height that a camera sees at a distance of 1 m, without the free border [m] (2,)."""
    slope = np.tan(np.radians(0.5 * FIELD_OF_VIEW_DEG)) * (1.0 - 2.0 * margin)
    return np.array([slope * size[0] / size[1], slope])


def look_at(eye: ArrayLike, target: ArrayLike, size: tuple[int, int]) -> Camera:
    """Return a camera at one point that looks at a second point.

    eye, target: [m] [NED] (3,).
    size: width, height [px].

    If it looks straight down, north is up in the picture.
    """
    eye, way = np.asarray(eye, float), np.asarray(eye, float) - np.asarray(target, float)
    azimuth = np.degrees(np.arctan2(way[1], way[0])) if np.hypot(way[0], way[1]) > 1e-9 else 180.0
    elevation = np.degrees(np.arctan2(-way[2], np.hypot(way[0], way[1])))
    return Camera(eye=eye, axes=axes_of(azimuth, elevation), width=size[0], height=size[1])


def clip(camera: Camera, points_n: Array, *, closed: bool) -> Array:
    """Return the part of a polygon or polyline that is in front of the camera [m] [NED] (k, 3).

    points_n: corners [m] [NED] (n, 3).  closed: whether the last corner is connected with the first.
    A polyline that leaves and enters the front again gets a straight connection.
    """
    depth = camera.depth(points_n) - NEAR_M
    if (depth > 0.0).all():
        return points_n
    kept = []
    count = len(points_n)
    for i in range(count):
        if depth[i] > 0.0:
            kept.append(points_n[i])
        j = (i + 1) % count
        if (closed or j) and depth[i] * depth[j] < 0.0:
            share = depth[i] / (depth[i] - depth[j])
            kept.append(points_n[i] + share * (points_n[j] - points_n[i]))
    return np.array(kept).reshape(-1, 3)
