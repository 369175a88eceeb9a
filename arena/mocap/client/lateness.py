"""Lateness of captured frames, also for receivers that do not check frame numbers. Pure."""

from __future__ import annotations

import math

from arena.kernels.lateness import Lateness
from arena.mocap.client.frame_order import FrameOrder
from arena.mocap.client.pose import CapturedFrame

__all__ = ["Lateness", "StreamLateness"]


class StreamLateness:
    """Measurement of how late frames arrive, which also detects repeated frames and a restart of the server.

    Use this class in receivers that do not check frame numbers.
    """

    def __init__(self, stale_s: float) -> None:
        self._order, self._lateness = FrameOrder(), Lateness(stale_s)
        self._stamp_s = math.nan

    def measure(self, frame: CapturedFrame, now: float) -> float:
        """Return how late a received frame is [s].

        Return infinity if the frame is repeated or its time stamp cannot be right. Return 0 if the server repeats one time
        stamp, because this server has no clock.

        now: time of arrival [s]
        """
        place = self._order.place(frame.number)
        if place == "repeated":
            return math.inf
        if place == "restarted":
            self._lateness.reset()
        same, self._stamp_s = frame.time_s == self._stamp_s, frame.time_s
        return 0.0 if same else self._lateness.measure_frame(frame, now, flying=False)
