"""Code that all motion-capture clients share, and `open_client`, which opens the client of a vendor.

Only this package and its kernel `captured_poses` convert the axes of a capture system (world z-up, bodies FLU) to NED
and FRD. The package contains nothing that is specific to one vendor.
"""

from arena.mocap.client.diagnosis import ChangeReport, LateFrames
from arena.mocap.client.interface import MocapClient, open_client
from arena.mocap.client.lateness import Lateness, StreamLateness
from arena.mocap.client.pose import CapturedFrame, Echo, Pose

__all__ = [
    "CapturedFrame",
    "ChangeReport",
    "Echo",
    "LateFrames",
    "Lateness",
    "MocapClient",
    "Pose",
    "StreamLateness",
    "open_client",
]
