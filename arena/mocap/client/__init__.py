"""Parts shared by all motion-capture clients, and the function that opens one.

The one place where a capture system's z-up axes and FLU bodies become NED and FRD. Knows no vendor.
"""

from arena.mocap.client.diagnosis import ChangeReport
from arena.mocap.client.interface import MocapClient, open_client
from arena.mocap.client.pose import CapturedFrame, Pose

__all__ = ["CapturedFrame", "ChangeReport", "MocapClient", "Pose", "open_client"]
