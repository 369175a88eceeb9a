"""Converts recorded motion capture frames for a replay. Pure.

One form is what the vendor's server sends, the other is what the recorder receives.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from arena.mocap.client import CapturedFrame
from arena.mocap.client.pose import Echo, Pose
from arena.mocap.emulator.interface import MeasuredBody, MeasuredFrame
from arena.wire.flight_record import RecordedBody, RecordedFrame

_H = math.sqrt(0.5)
_LOST = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)


class FrameConverter:
    """Converter from recorded motion capture frames to the frames that the replay's server sends.

    numbers: name of a rigid body -> its number in the stream of the server.
    """

    def __init__(self, numbers: Mapping[str, int]) -> None:
        self._numbers = numbers
        self._last: int | None = None
        self._offset = 0

    def measured(self, frame: RecordedFrame, shift_s: float, *, jumped: bool = False) -> MeasuredFrame:
        """Return a recorded frame for the replay's motion capture server, with its number and exposure time.

        After a jump in the record the numbers continue to increase, because receivers drop older frames.
        shift_s: clock minus time of the record [s].  jumped: the replay has jumped since the last frame.
        """
        if jumped and self._last is not None:
            self._offset = self._last + 1 - frame.number
        number = frame.number + self._offset
        if self._last is not None and number <= self._last:
            number = self._last + 1
        self._last = number
        bodies = tuple(self._measured(body) for body in frame.bodies if body.name in self._numbers)
        return MeasuredFrame(number=number, exposed_s=frame.exposed_s + shift_s, bodies=bodies)

    def _measured(self, body: RecordedBody) -> MeasuredBody:
        """Return one recorded pose in the axes of the motion capture system.

        This is the inverse of `arena.mocap.client.pose.pose_ned`, written with plain floats for speed.
        """
        position_w, quat = _LOST
        if body.tracked:
            (north, east, down), (w, x, y, z) = body.p_n, body.q_nb
            position_w = (east, north, -down)
            quat = (_H * (x + y), _H * (x - y), _H * (w - z), _H * (w + z))
        return MeasuredBody(self._numbers[body.name], position_w, quat, 0.0, body.tracked)


def sent_s(frame: RecordedFrame, shift_s: float) -> float:
    """Return the time at which the motion capture server sent a frame [s], or its exposure time if unknown.

    The time is by the clock of the server.
    """
    return (frame.exposed_s if math.isnan(frame.sent_s) else frame.sent_s) + shift_s


def captured(frame: RecordedFrame, shift_s: float) -> CapturedFrame:
    """Return a recorded frame in the form in which a recorder receives frames during a flight.

    shift_s: clock minus time of the record [s].
    """
    sent = None if math.isnan(frame.sent_s) else frame.sent_s + shift_s
    return CapturedFrame(
        number=frame.number,
        time_s=frame.exposed_s + shift_s,
        poses=tuple(Pose(b.name, b.p_n, b.q_nb) for b in frame.bodies if b.tracked),
        untracked=tuple(b.name for b in frame.bodies if not b.tracked),
        sent_s=sent,
        echo=None
        if sent is None
        else Echo(sent=frame.time_s + shift_s, received=frame.time_s + shift_s, answered_s=sent),
    )
