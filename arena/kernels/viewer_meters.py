"""Rate limits, message rates, longest gaps and flown paths of the messages that the recorder makes for viewers. Pure."""

from __future__ import annotations

import math
from math import dist
from typing import TYPE_CHECKING

from arena.kernels.mavlink_framing import may_contain

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from typing import Any

    Datagram = tuple[str, bool, bytes, float]
    Triple = tuple[float, float, float]

_NAN, _INFINITY = float("nan"), float("inf")
_EARLY_S = 1e-6  # simulation time advances in steps, which are not exact in binary
_SEQUENCES = 256
_MAX_JUMP = 64  # more missing messages are a restart of the autopilot
_PATH_PERIOD_S, _MIN_STEP_M = 0.1, 0.01
_LONGEST_NS = 9e18  # a time beyond it does not fit into 64 bits


def nanoseconds(time_s: float) -> int:
    """Convert a time [s] to a log time [ns], the unsigned integer of the MCAP format. A negative time becomes 0.

    Raises ValueError if the time is not finite, or later than the year 2255.
    """
    exact = 1e9 * time_s
    if not exact < _LONGEST_NS:
        raise ValueError(f"log time: got {time_s} s, expected less than {1e-9 * _LONGEST_NS:g} s")
    if exact <= 0.0:
        return 0
    whole = math.floor(exact)
    rest = exact - whole
    found = int(whole)
    if rest > 0.5 or (rest == 0.5 and found % 2 == 1):  # half to even, as `round`
        found += 1
    return found


class Throttle:
    """Rate limit for the messages of one viewer channel.

    period_s: shortest mean time between two accepted messages [s]; 0: all are accepted.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def due(self, time_s: float) -> bool:
        """Return whether a message at this time [s] may be sent under the rate limit, and count it as sent.

        A clock that steps back does not stop the messages.
        """
        if not self.is_due(time_s):
            return False
        began_again = abs(self._next_s - time_s) > self._period_s
        self._next_s = (time_s if began_again else self._next_s) + self._period_s
        return True

    def is_due(self, time_s: float) -> bool:
        """Return whether `due` would return True at this time [s]."""
        return not _EARLY_S < self._next_s - time_s <= self._period_s


class Period:
    """Clock of messages that are sent periodically.

    period_s: time between two of them [s].
    elapsed_s: time between the last two ends of a period [s]; 0 before the first one.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._began_s, self.elapsed_s = period_s, _NAN, 0.0

    def ended(self, time_s: float) -> bool:
        """Return whether a period ends at this time [s]; the next one then begins. The first call returns True.

        A clock that steps back begins a period.
        """
        elapsed_s = time_s - self._began_s
        if 0.0 <= elapsed_s < self._period_s:
            return False
        first = math.isnan(self._began_s)
        self._began_s = time_s
        self.elapsed_s = 0.0 if first else elapsed_s
        return first or elapsed_s >= self._period_s


class TrafficMeter:
    """Counter of one vehicle's datagrams and lost messages.

    Gaps in the autopilot's MAVLink sequence numbers show lost messages.
    """

    def __init__(self) -> None:
        self._down = self._up = self._down_bytes = self._up_bytes = self._lost = 0
        self._sequence = -1

    def count(self, up: bool, size: int) -> None:
        """Count a MAVLink datagram of the vehicle, and its bytes.

        up: it was sent to the vehicle.  size: number of its bytes.
        """
        if up:
            self._up += 1
            self._up_bytes += size
        else:
            self._down += 1
            self._down_bytes += size

    def sequence(self, first: int, last: int) -> None:
        """Count the lost messages of the autopilot: those missing between its previous datagram and this one.

        first, last: sequence numbers of its first and last message. No message is lost between them.
        """
        if self._sequence >= 0:
            missing = (first - self._sequence - 1) % _SEQUENCES
            self._lost += missing if missing < _MAX_JUMP else 0
        self._sequence = last

    def take(self, period_s: float) -> list[float]:
        """Return the traffic per second since the last call, and reset the counters.

        The values are datagrams from and to the vehicle, bytes from and to the vehicle, and lost messages.

        period_s: time since the last call [s].
        """
        counts = [self._down, self._up, self._down_bytes, self._up_bytes, self._lost]
        self._down = self._up = self._down_bytes = self._up_bytes = self._lost = 0
        return [count / period_s for count in counts]


class DatagramCounter:
    """Counter of one vehicle's datagrams that finds those with the state of the autopilot.

    down, up: number of datagrams from the vehicle and of datagrams to it.
    first_s: time of the first datagram from the vehicle [s], NaN before it.
    """

    def __init__(self, first: int, second: int) -> None:
        """Create the counter. first, second: message ids below 256 to find in datagrams from the vehicle."""
        self._messages = (first, second)
        self.down = self.up = 0
        self.first_s = _NAN

    def count(self, up: bool, data: bytes, time_s: float) -> bool:
        """Count a datagram. Return whether it is from the vehicle and may contain one of the two messages.

        up: it was sent to the vehicle.  time_s: time of reception [s].
        """
        if up:
            self.up += 1
            return False
        if self.down == 0:
            self.first_s = time_s
        self.down += 1
        return may_contain(data, self._messages[0], self._messages[1])


def count_datagrams(
    datagrams: list[Datagram], counters: Mapping[str, DatagramCounter]
) -> list[tuple[str, bytes]]:
    """Count datagrams. Return (vehicle, data) of the datagrams that may contain the state of an autopilot.

    datagrams: (vehicle, up, data, time of reception [s]) of each.  counters: counter of each vehicle, by name.
    """
    found = []
    for vehicle, up, data, time_s in datagrams:
        counter = counters[vehicle]
        if counter.count(up, data, time_s):
            found.append((vehicle, data))
    return found


class GapMeter:
    """Counter of arrivals that also measures the longest time between two arrivals.

    count: arrivals since the last `take`.
    newest_s: time of the last one [s], NaN before it.
    """

    def __init__(self) -> None:
        self.newest_s = _NAN
        self.count, self._gap_s = 0, 0.0

    def add(self, time_s: float) -> None:
        """Count one arrival, such as that of a captured pose, at a time [s]."""
        self._gap_s = max(
            self._gap_s, time_s - self.newest_s
        )  # NaN, before the first arrival, changes nothing
        self.newest_s = time_s
        self.count += 1

    def take(self, period_s: float) -> tuple[float, float]:
        """Return the message rate [Hz] and the longest time between two messages [s] since the last call. Reset both.

        period_s: time since the last call [s].
        """
        found = self.count / period_s, self._gap_s
        self.count, self._gap_s = 0, 0.0
        return found


def count_poses(poses: Iterable[Any], meters: Mapping[str, GapMeter], time_s: float) -> None:
    """Count the captured poses of one frame.

    poses: each begins with the name of its body.  meters: counter of each body that is counted, by name.
    time_s: time of reception [s].
    """
    for pose in poses:
        meter = meters.get(pose[0])
        if meter is not None:
            meter.add(time_s)


class PathPieces:
    """Collector of the positions of a flown path, which viewers receive in pieces.

    It stores at most 10 positions per second, and only while the vehicle moves.

    pieces: pieces taken so far.
    """

    def __init__(self) -> None:
        self.pieces = 0
        self._points: list[Triple] = []
        self._newest_s = -_INFINITY

    def add(self, north: float, east: float, down: float, time_s: float) -> None:
        """Add a position of the vehicle to its flown path [m] [NED].

        time_s: its time [s].
        """
        if 0.0 <= time_s - self._newest_s < _PATH_PERIOD_S:
            return
        p_n = (north, east, down)
        if not self._points or dist(self._points[len(self._points) - 1], p_n) >= _MIN_STEP_M:
            self._points.append(p_n)
            self._newest_s = time_s

    def take(self) -> list[Triple]:
        """Return the positions that were added to the path since the last call [m] [NED].

        The next piece begins at the last position of this piece.
        """
        found = self._points
        if len(found) > 1:
            self.pieces += 1
            self._points = [found[len(found) - 1]]
        return found
