"""Reads a CSV file for `arena fly`: a trajectory with a column of times, or a list of setpoints.

Pure, except for reading the file.
"""

from __future__ import annotations

import csv
from pathlib import Path

from arena.errors import InputError
from arena.trajectories import SetpointList, Trajectory, read_csv

_HOLD = ("hold", "hold_s", "seconds")
_POS = (("north", "east", "down"), ("x", "y", "z"))


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory, or a list of setpoints, from a CSV file.

    A file with a column of times (`t`) is a trajectory, see `arena.trajectories.read_csv`. A file with a column `hold_s` is a list of
    setpoints: north, east, down [m] [NED], hold_s [s], and if present yaw [rad]. Raises InputError.
    """
    try:
        with path.open(newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot read the trajectory: {error}") from error
    names = [name.strip() for name in rows[0]] if rows else []
    hold = next((name for name in _HOLD if name in names), None)
    pos = next((group for group in _POS if all(name in names for name in group)), None)
    if hold is None or pos is None:
        return read_csv(path)
    columns = [*pos, hold]
    setpoints = []
    for line, row in enumerate(rows[1:], start=2):
        try:
            n, e, d, hold_s = (float(row[names.index(name)]) for name in columns)
            yaw = float(row[names.index("yaw")]) if "yaw" in names else 0.0
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}:{line}: {error}, expected numbers in {', '.join(columns)}") from error
        setpoints.append(((n, e, d), yaw, hold_s))
    return SetpointList(setpoints)
