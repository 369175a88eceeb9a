"""Converts frames of the motion capture emulator to the form that its clients use. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from arena.kernels.captured_poses import measured_poses
from arena.mocap.client import CapturedFrame, Echo
from arena.mocap.emulator.interface import MeasuredFrame

_COMPARE_CLOCKS_S = 0.2  # as a client does


class FrameConverter:
    """Converter of motion capture frames: from poses as the emulator measures them to named poses in NED.

    bodies: rigid bodies of the emulator's configuration, each with `number` and `name`.
    """

    def __init__(self, bodies: Sequence[Mapping[str, Any]]) -> None:
        self._names = {int(b["number"]): str(b["name"]) for b in bodies}
        self._echo = Echo(sent=-inf, received=-inf, answered_s=-inf)

    def convert(self, frame: MeasuredFrame, now: float) -> CapturedFrame:
        """Convert a frame of the emulator in the same way as a motion-capture client.

        Server and client have the same clock and no network between them, so all times in `echo` are equal. Like a client, the
        converter compares the clocks five times a second.

        now: simulation time of sending [s].
        """
        if not 0.0 <= now - self._echo.sent < _COMPARE_CLOCKS_S:  # negative after a jump of a replay
            self._echo = Echo(sent=now, received=now, answered_s=now)
        poses, untracked = measured_poses(frame.bodies, self._names)
        return CapturedFrame(frame.number, frame.exposed_s, poses, untracked, now, self._echo)
