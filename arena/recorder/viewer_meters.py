"""Message rates, longest gaps and flown paths, which are sent periodically to viewers. Pure."""

from __future__ import annotations

import math

from arena.recorder.viewer_poses import Triple
from arena.wire.mavlink_frame import Frame

_V2, _SEQUENCE_V2, _SEQUENCE_V1, _SEQUENCES = 0xFD, 4, 2, 256
_MAX_JUMP = 64  # more missing messages are a restart of the autopilot
_PATH_PERIOD_S, _MIN_STEP_M = 0.1, 0.01


class TrafficMeter:
    """Counter of one vehicle's datagrams and lost messages.

    Gaps in the autopilot's MAVLink sequence numbers show lost messages.
    """

    def __init__(self) -> None:
        self._counts = [0, 0, 0, 0, 0]
        self._sequence: int | None = None

    def count(self, up: bool, data: bytes) -> None:
        """Count a MAVLink datagram of the vehicle, and its bytes.

        up: it was sent to the vehicle.
        """
        self._counts[up] += 1
        self._counts[2 + up] += len(data)

    def sequence(self, first: int, last: int) -> None:
        """Count the lost messages of the autopilot: those missing between its previous datagram and this one.

        first, last: sequence numbers of its first and last message. No message is lost between them.
        """
        if self._sequence is not None:
            missing = (first - self._sequence - 1) % _SEQUENCES
            self._counts[4] += missing if missing < _MAX_JUMP else 0
        self._sequence = last

    def take(self, period_s: float) -> list[float]:
        """Return the traffic per second since the last call, and reset the counters.

        The values are datagrams from and to the vehicle, bytes from and to the vehicle, and lost messages.

        period_s: time since the last call [s].
        """
        found = [count / period_s for count in self._counts]
        self._counts = [0, 0, 0, 0, 0]
        return found


def sequence_of(data: bytes, frame: Frame) -> int:
    """Return the MAVLink sequence number of a frame."""
    return data[frame.start + (_SEQUENCE_V2 if data[frame.start] == _V2 else _SEQUENCE_V1)]


class GapMeter:
    """Counter of arrivals that also measures the longest time between two arrivals.

    newest_s: time of the last one [s], None before it.
    """

    def __init__(self) -> None:
        self.newest_s: float | None = None
        self._count, self._gap_s = 0, 0.0

    def add(self, time_s: float) -> None:
        """Count one arrival, such as that of a captured pose, at a time [s]."""
        if self.newest_s is not None and time_s - self.newest_s > self._gap_s:
            self._gap_s = time_s - self.newest_s
        self.newest_s = time_s
        self._count += 1

    def take(self, period_s: float) -> tuple[float, float]:
        """Return the message rate [Hz] and the longest time between two messages [s] since the last call. Reset both.

        period_s: time since the last call [s].
        """
        found = self._count / period_s, self._gap_s
        self._count, self._gap_s = 0, 0.0
        return found


class PathPieces:
    """Collector of the positions of a flown path, which viewers receive in pieces.

    It stores at most 10 positions per second, and only while the vehicle moves.

    pieces: pieces taken so far.
    """

    def __init__(self) -> None:
        self.pieces = 0
        self._points: list[Triple] = []
        self._newest_s = -math.inf

    def add(self, p_n: Triple, time_s: float) -> None:
        """Add a position of the vehicle to its flown path.

        p_n: [m] [NED] (3,).
        time_s: its time [s].
        """
        if 0.0 <= time_s - self._newest_s < _PATH_PERIOD_S:
            return
        if not self._points or math.dist(self._points[-1], p_n) >= _MIN_STEP_M:
            self._points.append(p_n)
            self._newest_s = time_s

    def take(self) -> list[Triple]:
        """Return the positions that were added to the path since the last call [m] [NED].

        The next piece begins at the last position of this piece.
        """
        found = self._points
        if len(found) > 1:
            self.pieces += 1
            self._points = found[-1:]
        return found
