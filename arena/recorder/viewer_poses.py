"""Poses for Foxglove, converted from NED and FRD to the frames of its 3D view. Pure.

The root frame is `arena`: z up, x east, y north, origin at the centre of the floor. Each vehicle has a body frame with x forward,
y left, z up: `<vehicle>` (estimate), `<vehicle>/truth` and `<vehicle>/mocap`.
"""

from __future__ import annotations

from collections.abc import Sequence

from foxglove.messages import Duration, Point3, Quaternion, Timestamp, Vector3

from arena.kernels.viewer_messages import arena_attitude, arena_position
from arena.kernels.viewer_meters import nanoseconds

ROOT = "arena"

Triple = tuple[float, float, float]


def timestamp(time_s: float) -> Timestamp:
    """Convert a time [s] to the Timestamp type of foxglove-sdk."""
    return Timestamp(*divmod(nanoseconds(time_s), 1_000_000_000))


def duration(time_s: float) -> Duration:
    """Convert a duration [s] to the Duration type of foxglove-sdk."""
    return Duration(*divmod(round(time_s * 1e9), 1_000_000_000))


def point(p_n: Sequence[float]) -> Point3:
    """Convert a position from NED to a Foxglove point in the frame `arena`.

    p_n: [m] [NED] (3,).
    """
    north, east, down = p_n
    x, y, z = arena_position((north, east, down))
    return Point3(x=x, y=y, z=z)


def vector(p_n: Sequence[float]) -> Vector3:
    """Convert a position from NED to a Foxglove vector in the frame `arena`.

    p_n: [m] [NED] (3,).
    """
    north, east, down = p_n
    x, y, z = arena_position((north, east, down))
    return Vector3(x=x, y=y, z=z)


def quaternion(q_nb: Sequence[float]) -> Quaternion:
    """Convert an attitude quaternion to a Foxglove quaternion in the frame `arena`.

    q_nb: [-] wxyz (4,).
    """
    a, b, c, d = q_nb
    w, x, y, z = arena_attitude((a, b, c, d))
    return Quaternion(x=x, y=y, z=z, w=w)
