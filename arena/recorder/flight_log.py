"""A log file read into arrays. A log that ends in the middle of a line, because its writer was killed, is
read up to that line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arena.geometry import Array
from arena.recorder.columns import NED, RPY

Judge = Literal["truth", "capture", "estimate"]
COLUMNS_OF: Mapping[Judge, str] = {"truth": "truth", "capture": "mocap", "estimate": "ekf"}
_WORDS = ("info.flight_mode", "info.is_armed", "info.is_landed")


@dataclass(frozen=True, kw_only=True)
class Flight:
    """The log of one vehicle.

    t: time since the first row [s] (n,). t0: time of the first row [s].
    numbers: column name -> values, NaN for empty cells, each (n,).
    """

    name: str
    t: Array
    t0: float
    numbers: Mapping[str, Array]
    mode: Sequence[str]
    armed: NDArray[np.bool_]
    landed: NDArray[np.bool_]

    def group(self, name: str, parts: Sequence[str] = NED) -> Array:
        """Return the columns of a group side by side (n, len(parts)); NaN if the log has no such column."""
        missing = np.full(self.t.size, np.nan)
        return np.stack([self.numbers.get(f"{name}.{part}", missing) for part in parts], axis=1)

    @property
    def simulated(self) -> bool:
        """True if the log has the truth."""
        return "truth.pos.north" in self.numbers

    @property
    def judge(self) -> Judge:
        """The source of the actual position: the truth, else motion capture if it saw at least half of the
        flight, else the estimate.
        """
        if self.simulated:
            return "truth"
        seen = np.array(np.isfinite(self.group("mocap.pos")).all(axis=1), bool)
        counted = self.armed if self.armed.any() else np.ones(self.t.size, bool)
        return "capture" if seen[counted].mean() >= 0.5 else "estimate"

    @property
    def pos(self) -> Array:
        """Actual position by `judge` [m] [NED] (n, 3); NaN in rows without it."""
        return self.group(COLUMNS_OF[self.judge] + ".pos")

    @property
    def euler(self) -> Array:
        """Actual roll, pitch, yaw by `judge` [rad] (n, 3); NaN in rows without them."""
        return self.group(COLUMNS_OF[self.judge] + ".att_euler", RPY)

    @property
    def offboard(self) -> NDArray[np.bool_]:
        """True in rows in which a program controlled the vehicle (n,)."""
        return np.array([m == "OFFBOARD" for m in self.mode], bool) & self.armed


def read_flight(path: Path) -> Flight | None:
    """Read a log; None if the file does not exist or has no complete row."""
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError:
        return None
    names = lines[0].split(",") if lines else []
    rows = [cells for line in lines[1:] if len(cells := line.split(",")) == len(names)]
    if not rows or "time.seconds" not in names:
        return None
    columns = dict(zip(names, zip(*rows, strict=True), strict=True))
    numbers = {name: _numbers(cells) for name, cells in columns.items() if name not in _WORDS}
    stamps = numbers["time.seconds"]
    return Flight(
        name=path.stem,
        t=stamps - stamps[0],
        t0=float(stamps[0]),
        numbers=numbers,
        mode=columns.get(_WORDS[0], ("",) * len(rows)),
        armed=_truths(columns.get(_WORDS[1], ()), len(rows)),
        landed=_truths(columns.get(_WORDS[2], ()), len(rows)),
    )


def _numbers(cells: Sequence[str]) -> Array:
    try:
        return np.array([float(c) if c else np.nan for c in cells])
    except ValueError:
        return np.array([_number(c) for c in cells])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _truths(cells: Sequence[str], size: int) -> NDArray[np.bool_]:
    return np.array([c == "True" for c in cells], bool) if cells else np.zeros(size, bool)
