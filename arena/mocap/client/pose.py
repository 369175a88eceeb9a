"""Conversion of captured poses: from z-up world axes to NED, and from FLU body axes to FRD.

The formula is in the kernel `captured_pose`, because many processes run it 180 times a second.
"""

from __future__ import annotations

from typing import NamedTuple

from arena.kernels.captured_pose import ned_pose

Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]


class Pose(NamedTuple):
    """Position and attitude of a rigid body, in NED and FRD axes.

    body: name of the rigid body. p_n: position of its origin [m] [NED]. q_nb: attitude [-] wxyz.
    """

    body: str
    p_n: Triple
    q_nb: Quad


class Echo(NamedTuple):
    """Comparison of the motion-capture server's clock with the receiver's clock, by a request and its reply.

    The receiver sends a request, and the server replies with its time.

    sent, received: times of the request and of the answer, by the receiver's clock [s].
    answered_s: time at which the server received the request, by its own clock [s].
    """

    sent: float
    received: float
    answered_s: float


class CapturedFrame(NamedTuple):
    """Poses of all requested bodies at one exposure of the cameras.

    number: frame number. time_s: time of the exposure, by the server's clock [s].
    poses: poses of the tracked bodies, at most one of each name. untracked: names of the bodies without a pose.
    If several bodies of the server have the id or the name of a requested body, the client gives no pose of this name.
    sent_s: time at which the server sent the frame, by its clock [s]; None if unknown.
    echo: the last comparison of the clocks; None if the server answers no echo requests.
    arrived_s: time at which the kernel received the frame, monotonic [s]; None if the client uses no stamps.
    """

    number: int
    time_s: float
    poses: tuple[Pose, ...]
    untracked: tuple[str, ...]
    sent_s: float | None = None
    echo: Echo | None = None
    arrived_s: float | None = None


def pose_ned(body: str, position_w: Triple, quat_xyzw_wf: Quad) -> Pose | None:
    """Convert a pose from z-up world axes and FLU body axes to NED and FRD. Returns None for an invalid pose.

    p_n = (y, x, -z), q_nb = q_nw * q_wf * q_fb. Returns None if a value is not finite, the position is
    farther than 10 km, or the quaternion does not have norm 1. q_nw is a rotation by 180 deg about (1, 1, 0),
    q_fb a rotation by 180 deg about the forward axis. The product is written out in the code; a test compares
    it with arena.geometry.
    """
    found = ned_pose(*position_w, *quat_xyzw_wf)
    return None if found is None else Pose(body, *found)
