"""A log file -> arrays. A log that ends in the middle of a line, because its writer was killed, is read up to
there.
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
    """One vehicle's log. t: since its first row [s] (n,); numbers: by column, nan where the cell was empty,
    each (n,).
    """

    name: str
    t: Array
    t0: float
    numbers: Mapping[str, Array]
    mode: Sequence[str]
    armed: NDArray[np.bool_]
    landed: NDArray[np.bool_]

    def group(self, name: str, parts: Sequence[str] = NED) -> Array:
        """`name`'s columns side by side (n, len(parts)); nan where the log has no such column."""
        missing = np.full(self.t.size, np.nan)
        return np.stack([self.numbers.get(f"{name}.{part}", missing) for part in parts], axis=1)

    @property
    def simulated(self) -> bool:
        return "truth.pos.north" in self.numbers

    @property
    def judge(self) -> Judge:
        """Whose word on where it was is taken: the truth's where there is one, else the cameras' where they
        saw at least half of the flight, for they do not depend on the autopilot, else the autopilot's own.
        """
        if self.simulated:
            return "truth"
        seen = np.array(np.isfinite(self.group("mocap.pos")).all(axis=1), bool)
        counted = self.armed if self.armed.any() else np.ones(self.t.size, bool)
        return "capture" if seen[counted].mean() >= 0.5 else "estimate"

    @property
    def pos(self) -> Array:
        """Where it was [m] [NED] (n, 3), by `judge`; nan in rows where that one said nothing."""
        return self.group(COLUMNS_OF[self.judge] + ".pos")

    @property
    def euler(self) -> Array:
        """Its attitude [rad] (n, 3), likewise."""
        return self.group(COLUMNS_OF[self.judge] + ".att_euler", RPY)

    @property
    def offboard(self) -> NDArray[np.bool_]:
        """Rows in which a program flew it (n,)."""
        return np.array([m == "OFFBOARD" for m in self.mode], bool) & self.armed


def read_flight(path: Path) -> Flight | None:
    """None when the file is not there or holds no whole row."""
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
