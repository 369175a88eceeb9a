"""Reads the log file of one vehicle into arrays.

If the writer of the file was killed, the last line can be incomplete. Such a line is ignored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import NED, RPY
from arena.geometry import Array

PositionSource = Literal["truth", "capture", "estimate"]
COLUMNS_OF: Mapping[PositionSource, str] = {"truth": "truth", "capture": "mocap", "estimate": "ekf"}
MODE, FLAGS = "info.flight_mode", ("info.is_armed", "info.is_landed")
"""Columns that are not numbers: the flight mode, and flags, which are `True` or `False`."""


@dataclass(frozen=True, kw_only=True)
class Flight:
    """The log of one vehicle as arrays, with one element per row of the log (n rows).

    name: name of the vehicle.  t: time since the first row [s] (n,).  t0: time of the first row [s].
    numbers: column name -> values (n,), NaN for empty cells. Flags, such as `info.is_armed`, are 1 or 0.
    mode: flight modes (n,), "" if unknown.  armed, landed: flags (n,), false if unknown.
    """

    name: str
    t: Array
    t0: float
    numbers: Mapping[str, Array]
    mode: Sequence[str]
    armed: NDArray[np.bool_]
    landed: NDArray[np.bool_]

    def group(self, name: str, parts: Sequence[str] = NED) -> Array:
        """Return the columns of a quantity such as `ekf.pos` as one array, with one column per component.

        The array is (n, len(parts)). Columns that the log does not have are NaN. parts: components, such as north, east, down.
        """
        missing = np.full(self.t.size, np.nan)
        return np.stack([self.numbers.get(f"{name}.{part}", missing) for part in parts], axis=1)

    @property
    def simulated(self) -> bool:
        """True for a simulated vehicle: its log contains the true state."""
        return "truth.pos.north" in self.numbers

    @property
    def position_source(self) -> PositionSource:
        """Source of the vehicle's position: the true state, motion capture, or the autopilot's estimate.

        Motion capture is used if there is no ground truth and at least half of the rows while armed have a measured position.
        """
        if self.simulated:
            return "truth"
        seen = np.array(np.isfinite(self.group("mocap.pos")).all(axis=1), bool)
        counted = self.armed if self.armed.any() else np.ones(self.t.size, bool)
        return "capture" if seen[counted].mean() >= 0.5 else "estimate"

    @property
    def pos(self) -> Array:
        """Position [m] [NED] (n, 3) from the best source (`position_source`); NaN if unknown."""
        return self.group(COLUMNS_OF[self.position_source] + ".pos")

    @property
    def euler(self) -> Array:
        """Roll, pitch, yaw [rad] (n, 3) from the best source (`position_source`); NaN if unknown."""
        return self.group(COLUMNS_OF[self.position_source] + ".att_euler", RPY)

    @property
    def armed_known(self) -> NDArray[np.bool_]:
        """Mask (n,): false in rows in which nothing is known about the arming, because no heartbeat was recorded shortly before."""
        flags = self.numbers.get(FLAGS[0], np.full(self.t.size, np.nan))
        return np.asarray(np.isfinite(flags) | self.armed)

    @property
    def offboard(self) -> NDArray[np.bool_]:
        """Mask (n,): true in rows in which the vehicle was armed and in OFFBOARD mode."""
        return np.array([m == "OFFBOARD" for m in self.mode], bool) & self.armed


def read_flight(path: Path) -> Flight | None:
    """Return the log in a CSV file, or None if the file is missing or has no complete row."""
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError:
        return None
    names = lines[0].split(",") if lines else []
    rows = [cells for line in lines[1:] if len(cells := line.split(",")) == len(names)]
    if not rows or "time.seconds" not in names:
        return None
    columns = dict(zip(names, zip(*rows, strict=True), strict=True))
    numbers = {name: _numbers(cells) for name, cells in columns.items() if name not in (MODE, *FLAGS)}
    numbers |= {name: _flags(columns[name]) for name in FLAGS if name in columns}
    stamps, missing = numbers["time.seconds"], np.zeros(len(rows))
    return Flight(
        name=path.stem,
        t=stamps - stamps[0],
        t0=float(stamps[0]),
        numbers=numbers,
        mode=columns.get(MODE, ("",) * len(rows)),
        armed=numbers.get(FLAGS[0], missing) == 1.0,
        landed=numbers.get(FLAGS[1], missing) == 1.0,
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


def _flags(cells: Sequence[str]) -> Array:
    return np.array([np.nan if not c else float(c == "True") for c in cells])
