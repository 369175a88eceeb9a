"""Conversion of captured poses: from z-up world axes to NED, and from FLU body axes to FRD.

Many processes receive 180 frames per second, with the poses of all vehicles.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from arena.kernels.natnet_payload import RawBody

    Triple = tuple[float, float, float]
    Quad = tuple[float, float, float, float]

P = TypeVar("P", bound="tuple[object, ...]")
_H = math.sqrt(0.5)
_MAX_DISTANCE_M = 1e4
_TRACKED = 1  # bit of a body's parameters
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much


def ned_pose(
    east: float, north: float, up: float, x: float, y: float, z: float, w: float
) -> tuple[Triple, Quad] | None:
    """Convert a pose from z-up world axes and FLU body axes to NED and FRD. Returns None for an invalid pose.

    east, north, up: position [m].  x, y, z, w: attitude q_wf [-].
    Return (p_n [m], q_nb wxyz [-]). `arena.mocap.client.pose` explains the formula and the limits.
    """
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0.9 < norm < 1.1:  # NaN compares false
        return None
    if not (abs(east) < _MAX_DISTANCE_M and abs(north) < _MAX_DISTANCE_M and abs(up) < _MAX_DISTANCE_M):
        return None
    k = _H / norm
    qw, qx, qy, qz = k * (w + z), k * (x + y), k * (x - y), k * (w - z)
    if qw < 0:
        qw, qx, qy, qz = -qw, -qx, -qy, -qz
    return (north, east, -up), (qw, qx, qy, qz)


def ned_poses(
    bodies: Sequence[RawBody], names: Mapping[int, str], left_out: Container[str], pose: type[P]
) -> tuple[list[P], list[str], int]:
    """Convert the poses of the bodies in a NatNet frame.

    bodies: bodies as from `PayloadReader.bodies`.  names: streaming id -> name.  left_out: names of bodies without a pose.
    pose: type of the poses, a named tuple (name, p_n, q_nb).
    Return the poses of the tracked bodies, the names of those without a pose, and how many of these have an invalid pose.
    """
    found, untracked, invalid = [], [], 0
    for body in bodies:
        number, east, north, up, x, y, z, w, _, params = body
        name = names[number]
        if name in left_out:
            continue
        converted = ned_pose(east, north, up, x, y, z, w) if params & _TRACKED else None
        if converted is None:
            untracked.append(name)
            invalid += params & _TRACKED
        else:
            found.append(_new(pose, (name, converted[0], converted[1])))
    return found, untracked, invalid
