"""Planned path of a vehicle as MAVLink messages TRAJECTORY_REPRESENTATION_WAYPOINTS. Pure.

A program sends them to the recorder, never to a vehicle. A path is a sequence of messages with the same time_usec; each contains at
most 5 points. A sequence with another time_usec replaces the path. A message without points removes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.mavlink_layout import decoder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

PATH_MESSAGE = mavlink.MAVLINK_MSG_ID_TRAJECTORY_REPRESENTATION_WAYPOINTS
MAX_POINTS = 200
"""Most points of a path. Of a longer path, evenly spaced points are sent."""
_PER_MESSAGE = 5
_NO_COMMAND = 65535
_LOW, _MIDDLE, _HIGH = PATH_MESSAGE & 255, PATH_MESSAGE >> 8 & 255, PATH_MESSAGE >> 16
_UNUSED = [math.nan] * _PER_MESSAGE


def path_messages(points_n: Array, time_us: int) -> list[mavlink.MAVLink_message]:
    """Return the MAVLink messages that contain a planned path.

    points_n: [m] [NED] (k, 3).
    time_us: identifies the path, normally the time [us].
    """
    if len(points_n) > MAX_POINTS:
        import numpy as np  # only programs need it, and the recorder starts faster without it

        points_n = points_n[np.linspace(0, len(points_n) - 1, MAX_POINTS).round().astype(int)]
    return [
        _message(points_n[k : k + _PER_MESSAGE], time_us)
        for k in range(0, max(len(points_n), 1), _PER_MESSAGE)
    ]


def may_contain_path(data: bytes) -> bool:
    """Return whether the first message of a datagram belongs to a planned path. The message is not decoded."""
    return len(data) > 9 and data[7] == _LOW and data[8] == _MIDDLE and data[9] == _HIGH and data[0] == 0xFD


class PathAssembler:
    """Assembler of the planned path of one vehicle, from the messages of its program.

    points: [m] [NED] (k, 3), as tuples.  changes: count of changes of the path.
    """

    def __init__(self, system_id: int) -> None:
        self._system = system_id
        self._time_us: int | None = None
        self.points: list[tuple[float, float, float]] = []
        self.changes = 0

    def on_datagram(self, data: bytes) -> bool:
        """Add the path messages of a datagram. Return whether the path has changed."""
        before = self.changes
        for frame in parse_frames(data).frames:
            if (frame.msgid, frame.compid, frame.sysid) == (
                PATH_MESSAGE,
                PROGRAM_COMPONENT,
                self._system,
            ):
                self._add(decoder(PATH_MESSAGE)(data, frame))
        return self.changes != before

    def _add(self, m: Any) -> None:
        if m.time_usec != self._time_us:
            self._time_us, self.points = m.time_usec, []
        count = min(int(m.valid_points), _PER_MESSAGE, MAX_POINTS - len(self.points))
        for point in list(zip(_five(m, "pos_x"), _five(m, "pos_y"), _five(m, "pos_z"), strict=True))[:count]:
            if all(map(math.isfinite, point)):
                self.points.append(point)
        self.changes += 1


def _five(m: Any, field: str) -> Sequence[float]:
    return [float(x) for x in getattr(m, field)]


def _message(points_n: Array, time_us: int) -> mavlink.MAVLink_message:
    rows = [*points_n.tolist(), *[[math.nan] * 3] * (_PER_MESSAGE - len(points_n))]
    return mavlink.MAVLink_trajectory_representation_waypoints_message(
        time_us,
        len(points_n),
        *map(list, zip(*rows, strict=True)),
        *[_UNUSED] * 8,
        [_NO_COMMAND] * _PER_MESSAGE,
    )
