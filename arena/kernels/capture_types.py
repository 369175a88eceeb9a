"""Types of captured frames and poses, which the kernels read and create.

Other packages import them from `arena.mocap.client` and `arena.mocap.emulator`.
"""

from __future__ import annotations

from typing import NamedTuple

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


class MeasuredBody(NamedTuple):
    """Pose of a rigid body as the cameras measure it.

    number: the body's number in the stream. position_w: [m] [z-up capture axes].
    quat_xyzw_wf: rotation from the body's FLU axes to the capture axes [-].
    mean_error_m: mean error of the markers [m]. tracked: False while the cameras do not see the body.
    """

    number: int
    position_w: Triple
    quat_xyzw_wf: Quad
    mean_error_m: float
    tracked: bool
