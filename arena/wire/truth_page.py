"""The truth page: true states of the simulated vehicles in shared memory, as numpy arrays.

The world writes it.

`arena.wire.truth_rows` describes the layout of the page.
"""

from __future__ import annotations

import math
import mmap
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arena.constants import MAX_MOCAP_LATENCY_MS
from arena.kernels.arrays import array, view
from arena.kernels.truth_samples import TruthSamples
from arena.wire.truth_rows import HEAD, PER_VEHICLE, TruthRows

Array = NDArray[np.float64]

SPAN_S = 1e-3 * MAX_MOCAP_LATENCY_MS + 0.5
"""Time that a page reaches back [s]. The cameras read a sample one latency after its exposure, and may be late."""


class Truth(NamedTuple):
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
        b = row[1:].reshape(-1, PER_VEHICLE)
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
    """Writer of the truth page, with which the world publishes the true states of the vehicles.

    path: file of the page; an existing file is replaced.
    period_s: time between two samples [s]. The page keeps the samples of the last `SPAN_S`.
    """

    def __init__(self, path: str | Path, vehicles: int, *, period_s: float) -> None:
        self._width = width = 1 + vehicles * PER_VEHICLE
        self._ring = math.ceil(SPAN_S / period_s) + 2  # the oldest may be in writing, and one before the span
        part = Path(f"{path}.new")  # a reader finds a complete page or none
        with part.open("w+b") as file:
            file.truncate(8 * (HEAD + self._ring * width))
            self._all = np.frombuffer(mmap.mmap(file.fileno(), 0), dtype=np.float64)
        self._all[1:3] = vehicles, self._ring
        part.replace(path)
        self._count = 0
        self._samples: TruthSamples | None = None

    def write(self, truth: Truth) -> None:
        """Append the true state of one instant. The oldest state in the page is overwritten."""
        self.follow(truth)
        self.append(truth.time_s)

    def follow(self, truth: Truth) -> None:
        """Store the arrays whose values `append` writes."""
        arrays = [view(np.asarray(values, np.float64)) for values in truth[1:]]
        self._samples = TruthSamples(view(self._all), PER_VEHICLE, truth.motors.shape[1], *arrays)

    def append(self, time_s: float) -> None:
        """Append the present values of the arrays that were passed to `follow`, as the true state at `time_s` [s]."""
        assert self._samples is not None
        self._samples.write(HEAD + self._count % self._ring * self._width, time_s)
        self._count += 1
        self._all[0] = self._count


class TruthReader:
    """Reader of the truth page, the shared memory with the true states of the simulated vehicles.

    Raises RunError if there is no page, WireError if the file is not a truth page.
    """

    def __init__(self, path: str | Path) -> None:
        self._rows = TruthRows(path)
        self._last: tuple[float, Truth | None] = (math.nan, None)

    def newest(self) -> Truth | None:
        """Return the newest true state, or None if the world has not written a state yet."""
        row = self._rows.newest()
        return None if row is None else Truth.from_row(array(row))

    def at(self, time_s: float) -> Truth | None:
        """Return the true state at `time_s` [s], interpolated, or None if the time is not in the page.

        The state is interpolated between the samples before and after.

        A second call with the same time returns the same object, for readers that ask for each vehicle.
        """
        if self._last[0] == time_s:
            return self._last[1]
        row = self._rows.at(time_s)
        if row is None:
            return None
        self._last = time_s, Truth.from_row(array(row))
        return self._last[1]
