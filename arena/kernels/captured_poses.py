"""Conversion of captured poses: from z-up world axes to NED, and from FLU body axes to FRD.

Every client of a motion-capture server converts 180 frames per second, with the poses of many bodies.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.capture_types import Pose

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from arena.kernels.arrays import Floats
    from arena.kernels.capture_types import MeasuredBody, Quad, Triple
    from arena.kernels.natnet_payload import RawBody

_H = math.sqrt(0.5)
_MAX_DISTANCE_M = 1e4
POSE_ROW = 9
"""Numbers of a body in the pose page, see `arena.wire.pose_page`."""
_TRACKED = 1  # bit of a NatNet body's parameters
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much


def ned_pose(
    body: str, east: float, north: float, up: float, x: float, y: float, z: float, w: float
) -> Pose | None:
    """Convert a pose from z-up world axes and FLU body axes to NED and FRD. Returns None for an invalid pose.

    p_n = (y, x, -z), q_nb = q_nw * q_wf * q_fb. Returns None if a value is not finite, the position is
    farther than 10 km, or the quaternion does not have norm 1. q_nw is a rotation by 180 deg about (1, 1, 0),
    q_fb a rotation by 180 deg about the forward axis. The product is written out in the code; a test compares
    it with arena.geometry.

    body: name of the rigid body.  east, north, up: position [m].  x, y, z, w: attitude q_wf [-].
    """
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0.9 < norm < 1.1:  # NaN compares false
        return None
    if not (abs(east) < _MAX_DISTANCE_M and abs(north) < _MAX_DISTANCE_M and abs(up) < _MAX_DISTANCE_M):
        return None
    k = _H / norm
    a, b, c, d = k * (w + z), k * (x + y), k * (x - y), k * (w - z)
    if a < 0.0:
        a, b, c, d = -a, -b, -c, -d
    pose: Pose = _new(Pose, (body, (north, east, -up), (a, b, c, d)))
    return pose


def pose_ned(body: str, position_w: Triple, quat_xyzw_wf: Quad) -> Pose | None:
    """Convert a pose as `ned_pose` does, from a position [m] and an attitude q_wf xyzw [-]."""
    east, north, up = position_w
    x, y, z, w = quat_xyzw_wf
    return ned_pose(body, east, north, up, x, y, z, w)


def measured_poses(
    bodies: Sequence[MeasuredBody], names: Mapping[int, str]
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    """Convert all bodies that the emulated cameras have measured. Return the poses, and the names of the bodies without one.

    names: number of each body -> its name
    """
    poses, untracked = [], []
    for number, position_w, quat_xyzw_wf, _, tracked in bodies:
        name = names[number]
        pose = pose_ned(name, position_w, quat_xyzw_wf) if tracked else None
        if pose is None:
            untracked.append(name)
        else:
            poses.append(pose)
    return tuple(poses), tuple(untracked)


def store_poses(poses: Sequence[Pose], begins: Mapping[str, int], page: Floats) -> None:
    """Store the poses of one frame in the pose page, whose layout is in `arena.wire.pose_page`.

    page: numbers of the page
    begins: name of each body -> index of its first number in the page. Other bodies are left out.
    """
    last = POSE_ROW - 1
    for body, p_n, q_nb in poses:
        if body not in begins:
            continue
        at = begins[body]
        count = page[at] + 1.0
        page[at] = count
        page[at + 1], page[at + 2], page[at + 3] = p_n
        page[at + 4], page[at + 5], page[at + 6], page[at + 7] = q_nb
        page[at + last] = count


def natnet_poses(
    bodies: Sequence[RawBody], names: Mapping[int, str], left_out: Container[str]
) -> tuple[list[Pose], list[str], int]:
    """Convert the poses of the bodies in a NatNet frame.

    bodies: bodies as from `PayloadReader.bodies`.  names: streaming id -> name.  left_out: names of bodies without a pose.
    Return the poses of the tracked bodies, the names of those without a pose, and how many of these have an invalid pose.
    """
    found, untracked, invalid = [], [], 0
    for body in bodies:
        number, east, north, up, x, y, z, w, _, params = body
        name = names[number]
        if name in left_out:
            continue
        pose = ned_pose(name, east, north, up, x, y, z, w) if params & _TRACKED else None
        if pose is None:
            untracked.append(name)
            invalid += params & _TRACKED
        else:
            found.append(pose)
    return found, untracked, invalid
