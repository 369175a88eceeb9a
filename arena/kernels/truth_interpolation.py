"""Interpolation of the true vehicle states that the world publishes in shared memory (the truth page).

`arena.wire.truth_rows` describes the page.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels import rotations

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

_NEARLY_ONE = 0.9999
"""Least product of two attitudes between which the elements are interpolated: 1.6 degrees, where the error is below 1e-7 rad."""
_ATTITUDE = 3
"""Column of the attitude in the numbers of one vehicle."""
_DOUBLE_BYTES = 8


def new_row(width: int) -> Floats:
    """Return a new row of the truth page, filled with zeros.

    This module needs no numpy, so that its readers start fast.
    """
    return memoryview(bytearray(width * _DOUBLE_BYTES)).cast("d")


class TruthRing:
    """Ring of samples in the truth page, with a copy of the two samples around a time.

    page: the whole page.  begin: place of its first row.  width: numbers per row, of which the first is the time [s].
    ring: rows in the page. Sample k is in row k modulo `ring`.
    per_vehicle: numbers of one vehicle in a row
    """

    def __init__(self, page: Floats, begin: int, width: int, ring: int, per_vehicle: int) -> None:
        self._page, self._begin, self._width, self._ring = page, begin, width, ring
        self._per_vehicle = per_vehicle
        self._before, self._after = new_row(width), new_row(width)

    def find(self, time_s: float, count: int) -> bool:
        """Copy the samples before and after a time. Return False if one of them is not in the page.

        The world may overwrite a row while it is copied. The caller must then not use the samples.

        count: number of samples written so far
        """
        held = min(count, self._ring - 1)
        if held < 2 or time_s > self._page[self._row(count - 1)] + 1e-9:
            return False
        # The samples from `count - held` to `count - 2` can be the one before.
        oldest = count - held
        i = sample_before(self._page, self._begin, self._width, self._ring, oldest, count - 2, time_s)
        if i < oldest:
            return False
        before, after = self._row(i), self._row(i + 1)
        self._before[:] = self._page[before : before + self._width]
        self._after[:] = self._page[after : after + self._width]
        return True

    def interpolated(self, time_s: float) -> Floats:
        """Return a new row with the states at a time between the two samples that `find` has copied [s]."""
        out = new_row(self._width)
        interpolate(self._before, self._after, time_s, self._per_vehicle, out)
        return out

    def _row(self, number: int) -> int:
        """Return the place of a sample in the page.

        number: its place among all samples that were written
        """
        return self._begin + number % self._ring * self._width


def sample_before(
    page: Floats, begin: int, width: int, ring: int, oldest: int, newest: int, time_s: float
) -> int:
    """Return the index of the newest sample with a time <= `time_s`; `oldest - 1` if all samples are newer.

    page: the whole page.  begin: place of its first row.  width: numbers per row, of which the first is the time [s].
    ring: rows in the page. Sample k is in row k modulo `ring`.
    oldest, newest: first and last sample to search. Their times increase.
    time_s: [s]
    """
    low, high = oldest, newest + 1
    while low < high:
        middle = (low + high) // 2
        if time_s < page[begin + middle % ring * width]:
            high = middle
        else:
            low = middle + 1
    return low - 1


def interpolate(before: Floats, after: Floats, time_s: float, width: int, out: Floats) -> None:
    """Interpolate the true states of all vehicles between two samples (rows of the truth page).

    Attitudes are interpolated on the sphere, all other numbers linearly.

    before, after: rows: time [s], then `width` numbers per vehicle, with the attitude [-] wxyz from column 3 on (1 + V * width,)
    time_s: time of the result [s]
    out: result, in the same order (1 + V * width,)
    """
    fraction = (time_s - before[0]) / (after[0] - before[0])
    for k in range(len(out)):
        out[k] = before[k] + fraction * (after[k] - before[k])
    for i in range((len(out) - 1) // width):
        at = 1 + i * width + _ATTITUDE
        a = (before[at], before[at + 1], before[at + 2], before[at + 3])
        b = (after[at], after[at + 1], after[at + 2], after[at + 3])
        if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] > _NEARLY_ONE:
            q = rotations.normalized((out[at], out[at + 1], out[at + 2], out[at + 3]))
        else:
            q = rotations.slerp(a, b, fraction)
        out[at], out[at + 1], out[at + 2], out[at + 3] = q
