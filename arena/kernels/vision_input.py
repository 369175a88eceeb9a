"""External vision: checks received poses, and prepares and fuses the newest pose of each vehicle. Pure.

The EKF2_EV_* parameters select what is fused. A pose that PX4 would not fuse is refused.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.arrays import flags, floats, new_flags, new_integers

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.vision_fusion import VisionFusion

_ACCEPTED, _REFUSED, _REPEATED = 0, 1, 2  # columns of `counts`
_MAX_DISTANCE_M = 1e4
_LEAST_NORM, _MOST_NORM = 0.9, 1.1  # of a quaternion that is an attitude
_INFINITE, _NAN = float("inf"), float("nan")
_Q, _VAR_P, _VAR_YAW = 3, 7, 10  # columns of a pose


class VisionInput:
    """Poses of V vehicles from external vision, from their arrival to their fusion.

    A pose is a row: position [m] [NED], attitude wxyz (NaN if not given), variances of the position [m2] and of the heading
    [rad2] (0 if the sender gives none).

    fusion: fuses the poses
    at_rest: input: True for a vehicle that stands on the ground with idle motors (V,)
    flying: input: True for a vehicle in flight (V,)
    failed: input: True if external vision has failed; the pose then waits until the end of the failure (V,)
    ignores_variances: input: True if the variances in the messages are ignored, EKF2_EV_NOISE_MD (V,)
    offset_b: input: position of the measured point, EKF2_EV_POS [m] [FRD] (V, 3)
    align_after_s: input: duration of rejections after which a vehicle at rest is aligned again [s] (V,)
    pose: newest accepted pose of each vehicle (V, 11)
    waiting: True if this pose has not been fused yet (V,)
    prepared: pose as it is fused (V, 11)
    counts: number of poses that were accepted, refused and repeated (V, 3)
    """

    def __init__(self, fusion: VisionFusion, at_rest: NDArray[np.bool_]) -> None:
        v = len(at_rest)
        self.fusion, self.at_rest, self.flying = fusion, flags(at_rest), new_flags(v)
        self.failed, self.waiting, self.ignores_variances = new_flags(v), new_flags(v), new_flags(v)
        self.offset_b, self.align_after_s = floats(v, 3), floats(v, fill=_INFINITE)
        self.pose, self.prepared = floats(v, 11, fill=_NAN), floats(v, 11)
        self.counts = new_integers(v, 3)

    def read_flights_from(self, flying: NDArray[np.bool_]) -> None:
        """Store the array from which `receive` reads which vehicles are in flight (V,)."""
        self.flying = flags(flying)

    # -- arrival ---------------------------------------------------------------------------------------------

    def receive(
        self,
        i: int,
        p_n: rotations.Vector,
        q_nb: rotations.Quaternion,
        var_p: rotations.Vector,
        var_yaw: float,
    ) -> None:
        """Store a pose of vehicle i for the next fusion, or count why it is not stored.

        In flight a pose identical to the last one is dropped. Two measurements are never identical, so the source must be
        frozen.

        p_n: position [m] [NED]
        q_nb: attitude wxyz; one that is not a unit quaternion counts as not given
        var_p, var_yaw: variances of position [m2] and heading [rad2]; not positive or not finite if not given
        """
        north, east, down = p_n
        if not (abs(north) < _MAX_DISTANCE_M and abs(east) < _MAX_DISTANCE_M and abs(down) < _MAX_DISTANCE_M):
            self.refuse(i)  # too far, or NaN
            return
        w, x, y, z = q_nb
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if _LEAST_NORM < norm < _MOST_NORM:
            w, x, y, z = w / norm, x / norm, y / norm, z / norm
        else:
            w = x = y = z = _NAN
        if self.flying[i] and self._is_last(i, p_n, (w, x, y, z)):
            self.counts[i, _REPEATED] += 1
            return
        pose = self.pose
        pose[i, 0], pose[i, 1], pose[i, 2] = north, east, down
        pose[i, _Q], pose[i, _Q + 1], pose[i, _Q + 2], pose[i, _Q + 3] = w, x, y, z
        pose[i, _VAR_P], pose[i, _VAR_P + 1] = _variance(var_p[0]), _variance(var_p[1])
        pose[i, _VAR_P + 2], pose[i, _VAR_YAW] = _variance(var_p[2]), _variance(var_yaw)
        self.waiting[i] = True
        self.counts[i, _ACCEPTED] += 1

    def refuse(self, i: int) -> None:
        """Count a pose of vehicle i that PX4 would not fuse."""
        self.counts[i, _REFUSED] += 1

    def _is_last(self, i: int, p: rotations.Vector, q: rotations.Quaternion) -> bool:
        """Return whether position and attitude are those of the newest accepted pose of vehicle i."""
        pose = self.pose
        if pose[i, 0] != p[0] or pose[i, 1] != p[1] or pose[i, 2] != p[2]:
            return False
        if math.isnan(q[0]):
            return math.isnan(pose[i, _Q])
        same_w, same_x = pose[i, _Q] == q[0], pose[i, _Q + 1] == q[1]
        return same_w and same_x and pose[i, _Q + 2] == q[2] and pose[i, _Q + 3] == q[3]

    # -- fusion ----------------------------------------------------------------------------------------------

    def waiting_rows(self) -> list[int]:
        """Return the vehicles whose newest pose `fuse` will use."""
        found = []
        for i in range(len(self.waiting)):
            if self.waiting[i] and not self.failed[i]:
                found.append(i)
        return found

    def fuse(self, now: float) -> list[int]:
        """Fuse all waiting poses. Return the vehicles that must instead be aligned with their pose in `prepared`.

        now: time since boot [s]
        """
        unaligned = []
        for i in range(len(self.waiting)):
            if self.waiting[i] and not self.failed[i]:
                self.waiting[i] = False
                if self.fusion.control[i] != 0:
                    self._prepare(i)
                    if self._must_align(i, now):
                        unaligned.append(i)
                    else:
                        self.fusion.fuse(i, self.prepared, i, now)
        return unaligned

    def _prepare(self, i: int) -> None:
        """Set `prepared` to the pose of the body origin, which is not the measured point."""
        pose, prepared, offset, q_nb = self.pose, self.prepared, self.offset_b, self.fusion.state.q_nb
        for k in range(11):
            prepared[i, k] = pose[i, k]
        if self.ignores_variances[i]:
            for k in range(_VAR_P, 11):
                prepared[i, k] = 0.0
        if offset[i, 0] == 0.0 and offset[i, 1] == 0.0 and offset[i, 2] == 0.0:
            return
        if math.isnan(pose[i, _Q]):
            q = (q_nb[i, 0], q_nb[i, 1], q_nb[i, 2], q_nb[i, 3])
        else:
            q = (pose[i, _Q], pose[i, _Q + 1], pose[i, _Q + 2], pose[i, _Q + 3])
        x, y, z = rotations.rotated(q, (offset[i, 0], offset[i, 1], offset[i, 2]))
        prepared[i, 0] -= x
        prepared[i, 1] -= y
        prepared[i, 2] -= z

    def _must_align(self, i: int, now: float) -> bool:
        """Return whether vehicle i is not aligned yet, or rests and has rejected all poses for EKF2_NOAID_TOUT."""
        if not self.fusion.state.aligned[i]:
            return True
        if not self.at_rest[i] or math.isnan(self.pose[i, _Q]):
            return False
        return now - self.fusion.rejected_since[i] >= self.align_after_s[i]


def _variance(given: float) -> float:
    """Return a variance from a message; 0 if the message gives none."""
    return given if 0.0 < given < _INFINITE else 0.0
