"""Short histories of received values, from which the logger reads the values at the instant of a row. No clock is
read: times are arguments.

A row of the log belongs to one instant. Measurements are interpolated for that instant. Commands and states change in
steps, so their last value is used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from arena.kernels.rotations import slerp

T = TypeVar("T")
Sample = tuple[float, ...]
Interpolate = Callable[[Sample, Sample, float, float], Sample]

MAX_GAP_S = 0.5
"""Longest time between two samples for interpolation [s]. In longer gaps the cells of the log are empty."""
_HISTORY = 256  # samples: more than 1 s of motion capture at 180 Hz
_SAME_CLOCK_S = 0.05
_MAX_OFFSET_JUMP_S = 1.0
_MAX_DRIFT = 5e-5  # drift of the sender's clock relative to the clock of this computer [s/s]


class SenderClock:
    """Converts time stamps of a sender's clock to local time. The smallest difference so far between
    reception and time stamp is used as the offset of the clocks.

    An offset below 50 ms counts as zero, because simulated senders use the same simulation time.
    If a time stamp does not advance, the time of reception is used instead.
    """

    def __init__(self) -> None:
        self._least: float | None = None
        self._received = 0.0
        self._stamp: float | None = None

    def local(self, stamp: float, received: float) -> float:
        """Convert a time stamp to local time [s].

        stamp: time stamp, by the clock of the sender [s].  received: local time of reception [s].
        """
        stands_still, self._stamp = stamp == self._stamp, stamp
        if stands_still:
            return received
        delay = received - stamp
        relaxed = (
            self._least if self._least is None else self._least + _MAX_DRIFT * (received - self._received)
        )
        # A sender that restarted counts its time from zero again.
        restarted = relaxed is not None and abs(delay - relaxed) > _MAX_OFFSET_JUMP_S
        self._least = delay if relaxed is None or restarted else min(delay, relaxed)
        self._received = received
        return stamp + (0.0 if abs(self._least) < _SAME_CLOCK_S else self._least)


class Series:
    """History of the last samples of one measured quantity, such as position. Values between two samples are
    interpolated.

    interpolate: function (sample before, sample after, fraction 0..1, time between the samples [s]) -> value. Linear by
        default.
    """

    def __init__(self, interpolate: Interpolate | None = None) -> None:
        self._samples: deque[tuple[float, Sample]] = deque(maxlen=_HISTORY)
        self._interpolate = interpolate or _linear
        self._clock = SenderClock()

    def receive(self, stamp: float, received: float, value: Sample) -> None:
        """Append a sample with a time stamp of its sender. stamp: time by the sender's clock [s].  received: local time [s]."""
        self.add(self._clock.local(stamp, received), value)

    def add(self, time_s: float, value: Sample) -> None:
        """Append a sample if it is newer than the last one. time_s: local time of the sample [s]."""
        if not self._samples or time_s > self._samples[-1][0]:
            self._samples.append((time_s, value))

    def waits_for(self, time_s: float) -> bool:
        """Return whether the value at `time_s` can be interpolated only after the next sample, which is still expected.

        True if the last sample is older than `time_s`, but by at most MAX_GAP_S.
        """
        return bool(self._samples) and 0.0 < time_s - self._samples[-1][0] <= MAX_GAP_S

    def at(self, time_s: float) -> Sample | None:
        """Return the value at local time `time_s` [s], interpolated between the samples before and after that time.

        Return None if one of the two is missing or they are more than MAX_GAP_S apart.
        """
        after: tuple[float, Sample] | None = None
        for sample in reversed(self._samples):
            if sample[0] <= time_s:
                return _between(sample, after, time_s, self._interpolate)
            after = sample
        return None


def _between(
    before: tuple[float, Sample], after: tuple[float, Sample] | None, time_s: float, interpolate: Interpolate
) -> Sample | None:
    if before[0] == time_s:
        return before[1]
    if after is None or after[0] - before[0] > MAX_GAP_S:
        return None
    span = after[0] - before[0]
    return interpolate(before[1], after[1], (time_s - before[0]) / span, span)


class Held(Generic[T]):
    """History of the last values of a quantity that changes in steps, such as the flight mode. Each value is
    valid until the next one.

    max_age_s: age above which a value is no longer returned [s].
    """

    def __init__(self, max_age_s: float) -> None:
        self._values: deque[tuple[float, T]] = deque(maxlen=_HISTORY)
        self._max_age_s = max_age_s
        self._clock = SenderClock()

    def receive(self, stamp: float, received: float, value: T) -> None:
        """Append a value with a time stamp of its sender. stamp: time by the sender's clock [s].  received: local time [s]."""
        if not self._is_newest(value):
            self.add(self._clock.local(stamp, received), value)

    def add(self, time_s: float, value: T) -> None:
        """Append a value that is valid from local time `time_s` [s] on. Do nothing if the last value is the same object."""
        if not self._is_newest(value):
            self._values.append((time_s, value))

    def _is_newest(self, value: T) -> bool:
        return bool(self._values) and self._values[-1][1] is value

    def at(self, time_s: float) -> T | None:
        """Return the value that was valid at local time `time_s` [s]; None if there was none or it was too old."""
        for received, value in reversed(self._values):
            if received <= time_s:
                return value if time_s - received <= self._max_age_s else None
        return None


def _linear(before: Sample, after: Sample, fraction: float, _: float) -> Sample:
    return tuple([a + fraction * (b - a) for a, b in zip(before, after, strict=True)])


def position_velocity(before: Sample, after: Sample, u: float, span: float) -> Sample:
    """Interpolate a position by a cubic Hermite spline and a velocity linearly. Return both (6,).

    before, after: position [m] and velocity [m/s] of the two samples (6,).
    u: fraction 0..1 of the time between the samples.  span: time between the samples [s].
    """
    # Cubic Hermite basis: https://en.wikipedia.org/wiki/Cubic_Hermite_spline
    h00, h10 = (1 + 2 * u) * (1 - u) ** 2, u * (1 - u) ** 2 * span
    h01, h11 = u * u * (3 - 2 * u), u * u * (u - 1) * span
    px, py, pz, vx, vy, vz = before
    qx, qy, qz, wx, wy, wz = after
    return (
        h00 * px + h10 * vx + h01 * qx + h11 * wx,
        h00 * py + h10 * vy + h01 * qy + h11 * wy,
        h00 * pz + h10 * vz + h01 * qz + h11 * wz,
        vx + u * (wx - vx),
        vy + u * (wy - vy),
        vz + u * (wz - vz),
    )


def leading_quaternion(before: Sample, after: Sample, fraction: float, span: float) -> Sample:
    """Interpolate samples that begin with a quaternion: the quaternion by slerp, the values after it
    linearly.

    before, after: quaternion wxyz and n other values (4 + n,).  fraction: 0..1.
    """
    return (*slerp(before[:4], after[:4], fraction), *_linear(before[4:], after[4:], fraction, span))  # type: ignore[arg-type]
