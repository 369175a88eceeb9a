"""Conversions between coordinate frames: NED and z-up world, FRD and FLU, local and global positions.

Pure.

The package docstring defines the frames. A global position is projected on a plane that touches a sphere at
the origin. In a room this equals PX4's azimuthal projection (v1.16, src/lib/geo) within some micrometres.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry.quaternion import Array, quat_multiply
from arena.portable_math import cos, sin

_H = np.sqrt(0.5)
# w: x east, y north, z up. n from w swaps the horizontal axes and negates z: half a turn about (1, 1, 0).
_Q_NW_WXYZ = np.array([0.0, _H, _H, 0.0])
# f: forward, left, up. b from f is half a turn about the forward axis.
_Q_BF_WXYZ = np.array([0.0, 1.0, 0.0, 0.0])
EARTH_M = 6_371_000.0
"""Radius of PX4's sphere [m]."""


def ned_from_world(v_w: ArrayLike) -> Array:
    """Convert a vector from z-up world axes to NED: (x, y, z) -> (y, x, -z).

    v_w: any vector (..., 3)
    """
    v_w = np.asarray(v_w, float)
    return np.stack([v_w[..., 1], v_w[..., 0], -v_w[..., 2]], axis=-1)


def world_from_ned(v_n: ArrayLike) -> Array:
    """Convert a vector from NED to z-up world axes: (x, y, z) -> (y, x, -z).

    v_n: any vector (..., 3)
    """
    return ned_from_world(v_n)


def frd_from_flu(v_f: ArrayLike) -> Array:
    """Convert a vector from FLU to FRD. The same function converts from FRD to FLU.

    v_f: any vector (..., 3)
    """
    return np.asarray(v_f, float) * (1.0, -1.0, -1.0)


def q_nb_from_q_wf(q_wf: ArrayLike) -> Array:
    """Convert an attitude from FLU in z-up world axes to FRD in NED; wxyz (..., 4).

    Motion capture and pybullet use FLU in z-up world.
    """
    return quat_multiply(quat_multiply(_Q_NW_WXYZ, q_wf), _Q_BF_WXYZ * (1, -1, -1, -1))


def q_wf_from_q_nb(q_nb: ArrayLike) -> Array:
    """Convert an attitude from FRD in NED to FLU in z-up world axes; wxyz (..., 4)."""
    return quat_multiply(quat_multiply(_Q_NW_WXYZ * (1, -1, -1, -1), q_nb), _Q_BF_WXYZ)


def wxyz_from_xyzw(quat_xyzw: ArrayLike) -> Array:
    """Convert a scalar-last quaternion (pybullet, NatNet, VRPN) to scalar-first order (..., 4)."""
    return np.roll(np.asarray(quat_xyzw, float), 1, axis=-1)


def xyzw_from_wxyz(quat_wxyz: ArrayLike) -> Array:
    """Convert a scalar-first quaternion to scalar-last order (..., 4)."""
    return np.roll(np.asarray(quat_wxyz, float), -1, axis=-1)


def turn_horizontal(north: Any, east: Any, angle: Any) -> tuple[Any, Any]:
    """Rotate a horizontal vector clockwise (seen from above). Return its north and east components.

    angle: [rad]; with the heading of a local frame, the result is in true north and east
    """
    c, s = cos(angle), sin(angle)
    return c * north - s * east, s * north + c * east


def globe_from_local(
    lat0_deg: Any, lon0_deg: Any, north: Any, east: Any, heading: Any = 0.0
) -> tuple[Any, Any]:
    """Convert a local position to latitude and longitude [deg].

    The longitude is not wrapped to +-180 deg.

    lat0_deg, lon0_deg: origin of the local frame [deg]
    north, east: position from the origin [m]
    heading: direction of the frame's north, clockwise from true north [rad]
    """
    north, east = turn_horizontal(north, east, heading)
    return lat0_deg + np.degrees(north / EARTH_M), lon0_deg + np.degrees(
        east / (EARTH_M * cos(np.radians(lat0_deg)))
    )


def local_from_globe(
    lat0_deg: Any, lon0_deg: Any, lat_deg: Any, lon_deg: Any, heading: Any = 0.0
) -> tuple[Any, Any]:
    """Convert a latitude and longitude to a local position north, east [m].

    East is measured along the shorter way round the Earth.

    lat0_deg, lon0_deg: origin of the local frame [deg]
    lat_deg, lon_deg: global position [deg]
    heading: direction of the frame's north, clockwise from true north [rad]
    """
    east_deg = (lon_deg - lon0_deg + 180.0) % 360.0 - 180.0
    north = np.radians(lat_deg - lat0_deg) * EARTH_M
    east = np.radians(east_deg) * cos(np.radians(lat0_deg)) * EARTH_M
    return turn_horizontal(north, east, -heading)
