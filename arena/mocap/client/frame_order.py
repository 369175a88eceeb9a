"""Detector of repeated and reordered frames, and of restarts of the server, by frame numbers."""

from arena.kernels.frame_order import FrameOrder

__all__ = ["FrameOrder"]
