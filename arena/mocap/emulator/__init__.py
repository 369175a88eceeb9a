"""Motion capture emulator: simulates the cameras and sends their frames in a vendor's protocol.

The vendor's own package provides the server; this package contains nothing that is specific to one vendor.
"""

from arena.mocap.emulator.interface import MeasuredBody, MeasuredFrame, MocapServer, open_server

__all__ = ["MeasuredBody", "MeasuredFrame", "MocapServer", "open_server"]
