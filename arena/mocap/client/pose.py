"""Poses as motion capture gives them, in the arena's frames. Plain floats: this runs 180 times a second in many processes."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]

_H = sqrt(0.5)
_FAR_M = 1e4


@dataclass(frozen=True, slots=True)
class Pose:
    """body: its name; p_n: position of the body origin [m] [NED]; q_nb: attitude [-] wxyz."""

    body: str
    p_n: Triple
    q_nb: Quad


@dataclass(frozen=True, slots=True)
class CapturedFrame:
    """number: frame number; time_s: the server's own time stamp [s]; poses: tracked bodies; untracked: names of the others."""

    number: int
    time_s: float
    poses: tuple[Pose, ...]
    untracked: tuple[str, ...]


def pose_ned(body: str, position_w: Triple, quat_xyzw_wf: Quad) -> Pose | None:
    """Z-up axes to NED: p_n = (y, x, -z), q_nb = q_nw * q_wf * q_fb. None for what is no pose: not finite, far off, no rotation.

    q_nw is half a turn about (1, 1, 0) and q_fb half a turn about forward, so the product comes out by hand; the tests hold it
    against arena.geometry.
    """
    x, y, z, w = quat_xyzw_wf
    norm = sqrt(x * x + y * y + z * z + w * w)
    if not (isfinite(norm) and 0.9 < norm < 1.1 and all(abs(x) < _FAR_M for x in position_w)):
        return None
    k = _H / norm
    q = (k * (w + z), k * (x + y), k * (x - y), k * (w - z))
    if q[0] < 0:
        q = (-q[0], -q[1], -q[2], -q[3])
    return Pose(body, (position_w[1], position_w[0], -position_w[2]), q)
