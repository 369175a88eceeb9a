"""The truth page: the true state of the simulated vehicles, in shared memory.

The page is a ring of samples, so that a reader can interpolate between two samples. The world writes it; any
number of processes read it (motion capture emulator, recorder, referee). Layout, native doubles:

    [0] samples written so far   [1] vehicles V   [2] ring length K   [3] unused
    K rows of: time [s], then per vehicle 24 numbers:
        p_n (3) [m] [NED], q_nb (4) [-] wxyz, v_n (3) [m/s] [NED], omega_b (3) [rad/s] [FRD],
        accel_b (3) specific force [m/s2] [FRD], motors (8) output of each rotor, 0..1 [-], 0 for a missing rotor

The writer fills a row, then increases the sample count. A reader reads the count again after the row. If the
count is K - 1 or more ahead of the row, the row may have been overwritten, and the reader repeats the read.
"""

from __future__ import annotations

import bisect
import math
import mmap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arena.constants import MAX_MOCAP_LATENCY_MS, MAX_ROTORS
from arena.errors import RunError, WireError
from arena.kernels.arrays import view
from arena.kernels.truth_interpolation import interpolate

Array = NDArray[np.float64]

_HEAD = 4
_PER_VEHICLE = 16 + MAX_ROTORS
SPAN_S = 1e-3 * MAX_MOCAP_LATENCY_MS + 0.5
"""Time that a page reaches back [s]. The cameras read a sample one latency after its exposure, and may be late."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """True state of V vehicles at one time.

    time_s: simulation time [s]
    p_n: position of the body origin [m] [NED] (V, 3)
    q_nb: attitude [-] wxyz (V, 4)
    v_n: velocity [m/s] [NED] (V, 3)
    omega_b: body rates [rad/s] [FRD] (V, 3)
    accel_b: specific force [m/s2] [FRD] (V, 3)
    motors: output of each rotor, 0..1 [-] (V, R); in a truth page R is MAX_ROTORS, and missing rotors have 0
    """

    time_s: float
    p_n: Array
    q_nb: Array
    v_n: Array
    omega_b: Array
    accel_b: Array
    motors: Array

    @classmethod
    def from_row(cls, row: Array) -> Truth:
        b = row[1:].reshape(-1, _PER_VEHICLE)
        return cls(
            time_s=float(row[0]),
            p_n=b[:, 0:3],
            q_nb=b[:, 3:7],
            v_n=b[:, 7:10],
            omega_b=b[:, 10:13],
            accel_b=b[:, 13:16],
            motors=b[:, 16:],
        )


class TruthWriter:
    """Writer of the truth page, used by the world. path: file of the page; an existing file is replaced.

    period_s: time between two samples [s]. The page keeps the samples of the last `SPAN_S`.
    """

    def __init__(self, path: str | Path, vehicles: int, *, period_s: float) -> None:
        width = 1 + vehicles * _PER_VEHICLE
        self._ring = math.ceil(SPAN_S / period_s) + 2  # the oldest may be in writing, and one before the span
        part = Path(f"{path}.new")  # a reader finds a complete page or none
        with part.open("w+b") as file:
            file.truncate(8 * (_HEAD + self._ring * width))
            self._all = np.frombuffer(mmap.mmap(file.fileno(), 0), dtype=np.float64)
        self._all[1:3] = vehicles, self._ring
        part.replace(path)
        self._rows = self._all[_HEAD:].reshape(self._ring, width)
        self._count = 0

    def write(self, truth: Truth) -> None:
        """Append the true state of one instant. The oldest state in the page is overwritten."""
        row = self._rows[self._count % self._ring]
        row[0] = truth.time_s
        body = row[1:].reshape(-1, _PER_VEHICLE)
        body[:, 0:3], body[:, 3:7], body[:, 7:10] = truth.p_n, truth.q_nb, truth.v_n
        body[:, 10:13], body[:, 13:16] = truth.omega_b, truth.accel_b
        body[:, 16 : 16 + truth.motors.shape[1]] = truth.motors
        self._count += 1
        self._all[0] = self._count


class TruthReader:
    """Reader of the truth page. Raises RunError if there is no page, WireError if the file is not a truth
    page.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            with Path(path).open("rb") as file:
                self._all = np.frombuffer(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ), dtype=np.float64)
        except (OSError, ValueError) as error:
            raise RunError(f"no truth page at {path}: is the process `world` running?") from error
        vehicles, ring = int(self._all[1]), int(self._all[2])
        width = 1 + vehicles * _PER_VEHICLE
        if self._all.size != _HEAD + ring * width:
            raise WireError(
                f"{path} is not a truth page of this version: the file contains {self._all.size} numbers, but {vehicles} vehicles and "
                f"{ring} samples, as in its header, need {_HEAD + ring * width}"
            )
        self._rows, self._ring = self._all[_HEAD:].reshape(ring, width), ring
        self._last: tuple[float, Truth | None] = (math.nan, None)

    def newest(self) -> Truth | None:
        """Return the newest true state; None if the world has not written one yet."""
        while count := int(self._all[0]):
            row = self._rows[(count - 1) % self._ring].copy()
            if int(self._all[0]) - count < self._ring - 1:
                return Truth.from_row(row)
        return None

    def at(self, time_s: float) -> Truth | None:
        """Return the state at `time_s` [s], interpolated between the samples before and after; None if one of
        them is not in the page.

        A second call with the same time returns the same object: the recorder samples all vehicles at the same time.
        """
        if self._last[0] == time_s:
            return self._last[1]
        count = int(self._all[0])
        held = min(count, self._ring - 1)
        found = self._around(time_s, count, held)
        # Samples that were overwritten during the search are wrong: search again.
        if int(self._all[0]) - count >= 1 + self._ring - held:
            return self.at(time_s) if held >= 2 else None
        if found is None:
            return None
        self._last = time_s, _between(*found, time_s)
        return self._last[1]

    def _around(self, time_s: float, count: int, held: int) -> tuple[Array, Array] | None:
        """Return the samples before and after `time_s`; None if one of them is not in the page."""
        rows, ring = self._rows, self._ring
        if held < 2 or time_s > rows[(count - 1) % ring, 0] + 1e-9:
            return None
        # The samples from `count - held` to `count - 2` can be the one before.
        first = count - held
        after = bisect.bisect_right(range(first, count - 1), time_s, key=lambda i: float(rows[i % ring, 0]))
        if after == 0:
            return None
        i = first + after - 1
        return rows[i % ring].copy(), rows[(i + 1) % ring].copy()


def _between(before: Array, after: Array, time_s: float) -> Truth:
    mixed = np.empty_like(before)
    interpolate(view(before), view(after), time_s, _PER_VEHICLE, view(mixed))
    return Truth.from_row(mixed)
