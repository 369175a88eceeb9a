"""Types of captured frames in NED and FRD axes, and the conversion of captured poses to these axes."""

from arena.kernels.capture_types import CapturedFrame, Echo, Pose
from arena.kernels.captured_poses import pose_ned

__all__ = ["CapturedFrame", "Echo", "Pose", "pose_ned"]
