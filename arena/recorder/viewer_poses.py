"""Poses for Foxglove, converted from NED and FRD to the frames of its 3D view. Pure.

The root frame is `arena`: z up, x east, y north, origin at the centre of the floor. Each vehicle has a body frame with x forward,
y left, z up: `<vehicle>` (estimate), `<vehicle>/truth` and `<vehicle>/mocap`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from foxglove.messages import (
    Duration,
    FrameTransform,
    Point3,
    Pose,
    PoseInFrame,
    Quaternion,
    Timestamp,
    Vector3,
)

ROOT = "arena"
_H = math.sqrt(0.5)

Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]


def nanoseconds(time_s: float) -> int:
    """Convert a time [s] to nanoseconds, as `log_time` of a message."""
    return max(0, round(time_s * 1e9))


def timestamp(time_s: float) -> Timestamp:
    """Convert a time [s] to the Timestamp type of foxglove-sdk."""
    return Timestamp(*divmod(nanoseconds(time_s), 1_000_000_000))


def duration(time_s: float) -> Duration:
    """Convert a duration [s] to the Duration type of foxglove-sdk."""
    return Duration(*divmod(round(time_s * 1e9), 1_000_000_000))


def arena_position(p_n: Sequence[float]) -> Triple:
    """Convert a position from NED to the frame `arena`: (n, e, d) -> (e, n, -d).

    p_n: [m] [NED] (3,).
    """
    north, east, down = p_n
    return east, north, -down


def arena_attitude(q_nb: Sequence[float]) -> Quad:
    """Convert an attitude quaternion from FRD in NED to FLU in the frame `arena`.  wxyz (4,).

    It is `arena.geometry.q_wf_from_q_nb` written out for one vehicle in plain floats; a test compares both.
    """
    a, b, c, d = q_nb
    return _H * (a + d), _H * (b + c), _H * (b - c), _H * (a - d)


def point(p_n: Sequence[float]) -> Point3:
    """Convert a position from NED to a Foxglove point in the frame `arena`.

    p_n: [m] [NED] (3,).
    """
    x, y, z = arena_position(p_n)
    return Point3(x=x, y=y, z=z)


def vector(p_n: Sequence[float]) -> Vector3:
    """Convert a position from NED to a Foxglove vector in the frame `arena`.

    p_n: [m] [NED] (3,).
    """
    x, y, z = arena_position(p_n)
    return Vector3(x=x, y=y, z=z)


def quaternion(q_nb: Sequence[float]) -> Quaternion:
    """Convert an attitude quaternion to a Foxglove quaternion in the frame `arena`.

    q_nb: [-] wxyz (4,).
    """
    w, x, y, z = arena_attitude(q_nb)
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_in_arena(p_n: Sequence[float], q_nb: Sequence[float], time_s: float) -> PoseInFrame:
    """Return the Foxglove message of a pose in the frame `arena`.

    p_n: position of the body origin [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).  time_s: log time [s].
    """
    pose = Pose(position=vector(p_n), orientation=quaternion(q_nb))
    return PoseInFrame(timestamp=timestamp(time_s), frame_id=ROOT, pose=pose)


def pose_and_transform(
    frame: str, p_n: Sequence[float], q_nb: Sequence[float], log_time: int
) -> tuple[PoseInFrame, FrameTransform] | None:
    """Return a pose and the transform from the frame `arena` to the body frame, or None for non-finite numbers.

    frame: name of the body frame.  p_n, q_nb: as in `pose_in_arena`.  log_time: log time [ns].
    This is `pose_in_arena` written out, because it runs 75 times a second for each vehicle.
    """
    north, east, down = p_n
    a, b, c, d = q_nb
    if not math.isfinite(north + east + down + a + b + c + d):
        return None
    at = Timestamp(log_time // 1_000_000_000, log_time % 1_000_000_000)
    position = Vector3(x=east, y=north, z=-down)
    turned = Quaternion(x=_H * (b + c), y=_H * (b - c), z=_H * (a - d), w=_H * (a + d))
    pose = PoseInFrame(timestamp=at, frame_id=ROOT, pose=Pose(position=position, orientation=turned))
    transform = FrameTransform(
        timestamp=at, parent_frame_id=ROOT, child_frame_id=frame, translation=position, rotation=turned
    )
    return pose, transform
