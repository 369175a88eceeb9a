"""The motion-capture emulator: frames as the cameras would see them, sent by a vendor's server. Knows no vendor."""

from arena.mocap.emulator.interface import MeasuredBody, MeasuredFrame, MocapServer, open_server

__all__ = ["MeasuredBody", "MeasuredFrame", "MocapServer", "open_server"]
