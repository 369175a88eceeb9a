"""Receivers of motion capture, shared by forwarders, user programs and loggers.

The one place where a capture system's z-up axes and FLU bodies become NED and FRD.
"""

from arena.capture.natnet import NatNetCapture, open_capture
from arena.capture.pose import CapturedFrame, Pose
from arena.capture.trouble import Complaint

__all__ = ["CapturedFrame", "Complaint", "NatNetCapture", "Pose", "open_capture"]
