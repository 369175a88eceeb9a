"""Resampling of measured quantities to the times of a log's rows, with numpy.

Every function gets the samples of one quantity, m of them, in the order in which they were received, and the times of n rows.
Measurements are interpolated. Setpoints and states change in steps, so their last value is used. A row without a value gets
NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.geometry import Array, quat_slerp

MAX_GAP_S = 0.5
"""Longest time between two samples for interpolation [s]. In longer gaps the cells of the log are empty."""
_SAME_CLOCK_S = 0.05
_MAX_OFFSET_JUMP_S = 1.0
_MAX_DRIFT = 5e-5  # drift of the sender's clock relative to the clock of this computer [s/s]
_BLOCK = 4096

Indices = NDArray[np.intp]


def sender_times(stamps: Array, received: Array) -> Array:
    """Convert time stamps of a sender's clock to times on the clock of the log [s] (m,).

    The smallest difference so far between reception and time stamp is used as the offset of the clocks. It may grow by the
    largest drift of two clocks. An offset from -1 s to 50 ms counts as zero, because simulated senders use the same simulation
    time. (The recorder may stamp a datagram too early if the simulation has stood still.)
    If a time stamp does not advance, the time of reception is used instead. After a jump of the difference by more than 1 s,
    the sender has restarted, and the smallest difference begins again.

    stamps: time stamps, by the clock of the sender [s] (m,).  received: times of reception, by the clock of the log [s] (m,).
    """
    times = received.astype(float)
    advances = np.ones(stamps.size, bool)
    advances[1:] = stamps[1:] != stamps[:-1]
    stamps, arrived = stamps[advances], times[advances]
    offset = _smallest_delays(arrived - stamps, arrived)
    same = (offset > -_MAX_OFFSET_JUMP_S) & (offset < _SAME_CLOCK_S)
    times[advances] = stamps + np.where(same, 0.0, offset)
    return times


def _smallest_delays(delay: Array, received: Array) -> Array:
    """Return the smallest delay so far at each message [s] (m,).

    The smallest delay grows with time by the largest drift of two clocks. After a jump of more than 1 s, it begins again.

    delay: time of reception minus time stamp [s] (m,). received: times of reception [s] (m,).
    """
    # without drift the smallest delay is a running minimum
    level = delay - _MAX_DRIFT * received
    least = np.empty(delay.size)
    first, minimum = 0, np.inf
    while first < delay.size:
        block = level[first : first + _BLOCK]
        before = np.minimum.accumulate(np.concatenate([[minimum], block]))[:-1]
        jumped = np.isfinite(before) & (np.abs(block - before) > _MAX_OFFSET_JUMP_S)
        end = int(np.argmax(jumped)) if jumped.any() else block.size
        least[first : first + end] = np.minimum(before[:end], block[:end])
        minimum = np.inf if end < block.size else float(least[first + end - 1])
        if end < block.size:  # the message after the jump begins a new minimum
            least[first + end] = minimum = float(block[end])
            end += 1
        first += end
    return least + _MAX_DRIFT * received


def advancing(times: Array) -> NDArray[np.bool_]:
    """Return a mask (m,): true for each sample that is newer than all samples before it.

    times: times of the samples [s] (m,).
    """
    newest = np.maximum.accumulate(times)
    return np.concatenate([np.ones(min(times.size, 1), bool), times[1:] > newest[:-1]])


class Bracket:
    """Indices of the samples before and after each row of a log, for interpolation.

    times: times of the samples, increasing [s] (m,).  at: times of the rows [s] (n,).
    max_gap_s: longest time between two samples for interpolation [s].

    before, after: indices of the samples (n,).  fraction: 0..1 (n,).  span: time between both samples [s] (n,).
    valid: false in rows that are outside the samples or in a longer gap (n,).
    """

    def __init__(self, times: Array, at: Array, max_gap_s: float = MAX_GAP_S) -> None:
        last = max(times.size - 1, 0)
        found = np.searchsorted(times, at, side="right") - 1
        self.before: Indices = np.clip(found, 0, last)
        exact = np.zeros(at.size, bool)
        if times.size:
            exact = (found >= 0) & (times[self.before] == at)
        self.after: Indices = np.where(exact, self.before, np.minimum(self.before + 1, last))
        self.span: Array = times[self.after] - times[self.before] if times.size else np.zeros(at.size)
        inside = (found >= 0) & (found < last) & (self.span <= max_gap_s)
        self.valid: NDArray[np.bool_] = exact | inside
        since = at - times[self.before] if times.size else np.zeros(at.size)
        self.fraction: Array = np.where(
            self.valid & ~exact, since / np.where(self.span > 0, self.span, 1.0), 0.0
        )

    def masked(self, values: Array) -> Array:
        """Return values (n, k) with NaN in the rows that cannot be interpolated."""
        return np.where(self.valid[:, None], values, np.nan)


def linear(times: Array, values: Array, at: Array) -> Array:
    """Interpolate values (m, k) linearly at the times of the rows. Return (n, k).

    times: increasing [s] (m,). values: (m, k). at: times of the rows [s] (n,).
    """
    if not times.size:
        return np.full((at.size, values.shape[1]), np.nan)
    rows = Bracket(times, at)
    a, b = values[rows.before], values[rows.after]
    return rows.masked(a + rows.fraction[:, None] * (b - a))


def position_velocity(times: Array, values: Array, at: Array) -> Array:
    """Interpolate positions by cubic Hermite splines, and velocities linearly. Return both (n, 6).

    times: increasing [s] (m,).  values: position [m] and velocity [m/s] (m, 6).  at: [s] (n,).
    """
    if not times.size:
        return np.full((at.size, 6), np.nan)
    rows = Bracket(times, at)
    u, span = rows.fraction[:, None], rows.span[:, None]
    a, b = values[rows.before], values[rows.after]
    # Cubic Hermite basis: https://en.wikipedia.org/wiki/Cubic_Hermite_spline
    h00, h10 = (1 + 2 * u) * (1 - u) ** 2, u * (1 - u) ** 2 * span
    h01, h11 = u * u * (3 - 2 * u), u * u * (u - 1) * span
    pos = h00 * a[:, :3] + h10 * a[:, 3:] + h01 * b[:, :3] + h11 * b[:, 3:]
    return rows.masked(np.concatenate([pos, a[:, 3:] + u * (b[:, 3:] - a[:, 3:])], axis=1))


def attitude(times: Array, values: Array, at: Array) -> Array:
    """Interpolate quaternions by slerp, and the columns after the quaternion linearly. Return (n, 4 + k).

    times: increasing [s] (m,).  values: quaternion wxyz and k other values (m, 4 + k).  at: [s] (n,).
    """
    if not times.size:
        return np.full((at.size, values.shape[1]), np.nan)
    rows = Bracket(times, at)
    u = rows.fraction
    a, b = values[rows.before], values[rows.after]
    turned = quat_slerp(a[:, :4], b[:, :4], u)
    return rows.masked(np.concatenate([turned, a[:, 4:] + u[:, None] * (b[:, 4:] - a[:, 4:])], axis=1))


def held(times: Array, at: Array, max_age_s: float) -> tuple[Indices, NDArray[np.bool_]]:
    """Find, for each row of a log, the last received sample that is not newer than the row.

    Return its index (n,) and a mask (n,), which is false if there is no such value or it is older than `max_age_s`.
    times: [s] (m,), in the order of reception; they need not increase.  at: [s] (n,).  max_age_s: [s].
    """
    if not times.size:
        return np.zeros(at.size, np.intp), np.zeros(at.size, bool)
    earliest = np.minimum.accumulate(times[::-1])[::-1]  # of this value and all later ones
    found = np.searchsorted(earliest, at, side="right") - 1
    index = np.maximum(found, 0)
    return index, (found >= 0) & (at - times[index] <= max_age_s)


def held_values(times: Array, values: Array, at: Array, max_age_s: float) -> Array:
    """Return the last received value for each row of a log (n, k); NaN if there is none or it is too old.

    values: (m, k). The function `held` explains the other arguments.
    """
    if not times.size:
        return np.full((at.size, values.shape[1]), np.nan)
    index, valid = held(times, at, max_age_s)
    return np.where(valid[:, None], values[index], np.nan)
