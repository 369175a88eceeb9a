"""Layout of the truth page (shared memory with the vehicles' true states), and a reader of plain numbers.

`arena.wire.truth_page` writes the page, and reads it as arrays.

The page is a ring of samples in shared memory, so that a reader can interpolate between two samples. The world writes it; any
number of processes read it (motion capture emulator, recorder, referee). Layout, native doubles:

    [0] samples written so far   [1] vehicles V   [2] ring length K   [3] unused
    K rows of: time [s], then per vehicle 24 numbers:
        p_n (3) [m] [NED], q_nb (4) [-] wxyz, v_n (3) [m/s] [NED], omega_b (3) [rad/s] [FRD],
        accel_b (3) specific force [m/s2] [FRD], motors (8) output of each rotor, 0..1 [-], 0 for a missing rotor

The writer fills a row, then increases the sample count. A reader reads the count again after the row. If the
count is K - 1 or more ahead of the row, the row may have been overwritten, and the reader repeats the read.

This module needs no numpy, whose import costs more CPU time than the recorder needs for five seconds of a flight.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from arena.constants import MAX_ROTORS
from arena.errors import RunError, WireError
from arena.kernels.truth_interpolation import TruthRing

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats

HEAD = 4
"""Numbers before the first row."""
PER_VEHICLE = 16 + MAX_ROTORS
"""Numbers of a vehicle in a row."""


class Numbers(Protocol):
    """Interface of a vector of one vehicle, such as its position: row of a numpy array, or memoryview."""

    def tolist(self) -> Sequence[float]: ...

    def __getitem__(self, index: int, /) -> float: ...


class PerVehicle(Protocol):
    """Interface of the vectors of all vehicles, such as their positions: numpy array, or list of memoryviews."""

    def __getitem__(self, index: int, /) -> Numbers: ...


class TrueStates(Protocol):
    """True states of V vehicles at one time, as arrays (`arena.wire.truth_page.Truth`) or as `ViewedStates`.

    time_s: simulation time [s]
    p_n: position of the body origin [m] [NED] (V, 3)
    q_nb: attitude [-] wxyz (V, 4)
    v_n: velocity [m/s] [NED] (V, 3)
    omega_b: body rates [rad/s] [FRD] (V, 3)
    """

    @property
    def time_s(self) -> float: ...
    @property
    def p_n(self) -> PerVehicle: ...
    @property
    def q_nb(self) -> PerVehicle: ...
    @property
    def v_n(self) -> PerVehicle: ...
    @property
    def omega_b(self) -> PerVehicle: ...


def as_lists(vectors: PerVehicle) -> list[Any]:
    """Return the vectors of all vehicles, such as their positions, as lists of floats."""
    if isinstance(vectors, list):
        return [vector.tolist() for vector in vectors]
    found: list[Any] = vectors.tolist()  # type: ignore[attr-defined]
    return found


class ViewedStates:
    """True states of V vehicles in one row of the truth page, as lists of memoryviews. Attributes as in `TrueStates`."""

    def __init__(self, row: Floats) -> None:
        self.time_s = row[0]
        begins = range(1, len(row), PER_VEHICLE)
        self.p_n = [row[k : k + 3] for k in begins]
        self.q_nb = [row[k + 3 : k + 7] for k in begins]
        self.v_n = [row[k + 7 : k + 10] for k in begins]
        self.omega_b = [row[k + 10 : k + 13] for k in begins]


class TruthRows:
    """Reader of the rows of the truth page. A row contains the true states of all vehicles at one time.

    Raises RunError if there is no page, and WireError if the file is not a truth page.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            with Path(path).open("rb") as file:
                page = memoryview(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ))
            self._all = page.cast("d")
            vehicles, ring = int(self._all[1]), int(self._all[2])
        except (OSError, ValueError, TypeError, IndexError) as error:
            raise RunError(
                f"{path}: no shared memory with the true states of the vehicles (truth page): is the process `world` running?"
            ) from error
        self._width = 1 + vehicles * PER_VEHICLE
        self._ring = ring
        if len(self._all) != HEAD + ring * self._width:
            raise WireError(
                f"{path} is not a truth page of this version: the file contains {len(self._all)} numbers, but {vehicles} vehicles and "
                f"{ring} samples, as in its header, need {HEAD + ring * self._width}"
            )
        self._samples = TruthRing(self._all, HEAD, self._width, ring, PER_VEHICLE)

    def newest(self) -> Floats | None:
        """Return a copy of the newest row of the truth page, or None if the world has not written a row yet."""
        while count := int(self._all[0]):
            row = self._copy(count - 1)
            if int(self._all[0]) - count < self._ring - 1:
                return row
        return None

    def at(self, time_s: float) -> Floats | None:
        """Return the row of the truth page at `time_s` [s], interpolated, or None if the time is not in the page."""
        count = int(self._all[0])
        found = self._samples.find(time_s, count)
        # Rows that were overwritten during the search are wrong: search again.
        held = min(count, self._ring - 1)
        if int(self._all[0]) - count >= 1 + self._ring - held:
            return self.at(time_s) if held >= 2 else None
        return self._samples.interpolated(time_s) if found else None

    def _copy(self, number: int) -> Floats:
        begin = HEAD + number % self._ring * self._width
        return memoryview(bytearray(self._all[begin : begin + self._width])).cast("d")


class StateReader:
    """Reader of the truth page that returns plain numbers instead of arrays. Raises the errors of `TruthRows`."""

    def __init__(self, path: str | Path) -> None:
        self._rows = TruthRows(path)

    def newest(self) -> ViewedStates | None:
        """Return the newest true states, or None if the world has not written a state yet."""
        row = self._rows.newest()
        return None if row is None else ViewedStates(row)

    def at(self, time_s: float) -> ViewedStates | None:
        """Return the true states at `time_s` [s], interpolated, or None if the time is not in the page."""
        row = self._rows.at(time_s)
        return None if row is None else ViewedStates(row)
