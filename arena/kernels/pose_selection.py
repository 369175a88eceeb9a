"""Selection of the captured poses that a pose forwarder sends to its autopilot.

Every forwarder checks 180 frames per second, and forwards a third of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.frame_order import FrameOrder
from arena.kernels.lateness import Lateness

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Sequence

    from arena.kernels.capture_types import CapturedFrame, Pose

_MAX_DISTANCE_M = 1e4


class PoseSelection:
    """Selection of the poses of one rigid body to forward: new, tracked, not frozen and not late, at the forwarder's rate.

    every: number of frames of which one is forwarded
    noisy: True if measured poses have noise. Without noise a body at rest repeats its pose exactly, so a repeated pose is
        then not frozen.
    counts: counter of the dropped poses, by reason
    flying: set by the owner: True while the vehicle is armed
    lateness: delay of the frames compared with the fastest frames
    late_s: delay of the last frame [s]
    resets: number of restarts of the motion capture, modulo 256
    """

    def __init__(self, body: str, every: int, stale_s: float, noisy: bool, counts: Counter[str]) -> None:
        self._body, self._every, self._stale_s, self._noisy = body, every, stale_s, noisy
        self.counts = counts
        self.flying = False
        self._order, self.lateness = FrameOrder(), Lateness(stale_s)
        self.late_s = 0.0
        self.resets = 0
        self._place = 0  # of the body's pose in the last frame
        self._sent_slot, self._slot = False, 0
        self._last: Pose | None = None

    def newest(self, frames: Sequence[CapturedFrame], now: float) -> Pose | None:
        """Return the newest pose to forward in several frames, or None if no pose must be forwarded.

        Older poses are dropped and counted as `superseded`: the autopilot uses the arrival time as the time of a pose.
        frames: oldest first. now: time of arrival [s]
        """
        newest: Pose | None = None
        for frame in frames:
            pose = self.take(frame, now)
            if pose is not None:
                if newest is not None:
                    self.counts["superseded"] += 1
                newest = pose
        return newest

    def take(self, frame: CapturedFrame, now: float) -> Pose | None:
        """Return the body's pose in a frame, or None if the pose must not be forwarded.

        Dropped poses are counted by reason.

        now: time of arrival [s]
        """
        place = self._order.place(frame.number)
        if place == "repeated":
            self.counts["repeated frame"] += 1
            return None
        if place == "restarted":
            self._restart()
        self.late_s = self.lateness.measure_frame(frame, now, self.flying)
        pose = self._own_pose(frame.poses)
        reason = self._drop_reason(frame, pose)
        if reason:
            self.counts[reason] += 1
            return None
        # Each group of `_every` frame numbers sends one pose. If its first frame is lost, its second frame is used.
        slot = frame.number // self._every
        if self._sent_slot and slot == self._slot:
            return None
        self._sent_slot, self._slot = True, slot
        return pose

    def _own_pose(self, poses: Sequence[Pose]) -> Pose | None:
        """Return the body's pose in a frame; None if the frame contains no pose of the body.

        The index of the last frame is tried first, because in almost all frames the pose has the same index.
        """
        if self._place < len(poses) and poses[self._place].body == self._body:
            return poses[self._place]
        for place in range(len(poses)):
            if poses[place].body == self._body:
                self._place = place
                return poses[place]
        return None

    def _drop_reason(self, frame: CapturedFrame, pose: Pose | None) -> str:
        """Return why the pose in a frame must be dropped; "" if the pose may be forwarded."""
        if pose is None:
            return "untracked" if self._body in frame.untracked else "body not in frame"
        last, self._last = self._last, pose
        if not is_pose(pose):
            return "no pose"
        if self._noisy and last is not None and pose.p_n == last.p_n and pose.q_nb == last.q_nb:
            return "frozen"
        return "stale" if self.late_s > self._stale_s else ""

    def _restart(self) -> None:
        """Reset the stored pose and clock offset of the motion capture, after a restart of its server.

        The last pose and the measured offset of the clocks are discarded. The next ODOMETRY messages report
        the restart to the autopilot by a new reset counter.
        """
        self.counts["capture restarts"] += 1
        self.lateness.reset()
        self._sent_slot, self._last = False, None
        self.resets = (self.resets + 1) % 256


def newest_poses(
    selections: list[PoseSelection], frames: Sequence[CapturedFrame], now: float
) -> list[tuple[int, Pose]]:
    """Return (index of the selection, pose) of each pose to forward, as from `PoseSelection.newest`."""
    found = []
    for k in range(len(selections)):
        selection = selections[k]
        pose = selection.newest(frames, now)
        if pose is not None:
            found.append((k, pose))
    return found


def is_pose(pose: Pose) -> bool:
    """Return whether a pose is possible: all values are finite, the position is near, the quaternion has norm 1."""
    x, y, z = pose.p_n
    a, b, c, d = pose.q_nb
    return (
        0.9 < math.sqrt(a * a + b * b + c * c + d * d) < 1.1  # NaN compares false
        and abs(x) < _MAX_DISTANCE_M
        and abs(y) < _MAX_DISTANCE_M
        and abs(z) < _MAX_DISTANCE_M
    )
