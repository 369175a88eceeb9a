"""Receivers of motion capture, shared by forwarders, user programs and loggers.

The one place where a capture system's z-up axes and FLU bodies become NED and FRD.
"""

from arena.mocap.client.diagnosis import Complaint
from arena.mocap.client.natnet import NatNetCapture, open_capture
from arena.mocap.client.pose import CapturedFrame, Pose

__all__ = ["CapturedFrame", "Complaint", "NatNetCapture", "Pose", "open_capture"]
