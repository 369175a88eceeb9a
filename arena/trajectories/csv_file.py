"""Reader of trajectories in CSV files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.trajectories.trajectory import Sampled

_TIME, _POS = ("t", "time", "time_s", "time.seconds"), (("north", "east", "down"), ("x", "y", "z"))
_LOG = "pos_ref"


def read_csv(path: str | Path) -> Sampled:
    """Read a trajectory from a CSV file.

    The first line names the columns: `t` (or `time`, `time_s`) [s]; `north`, `east`, `down` (or `x`, `y`, `z`) [m] [NED];
    and if present `vel_north`, `vel_east`, `vel_down` (or `vx`, `vy`, `vz`) [m/s] and `yaw` [rad].
    The log of a vehicle is read, too: its columns `time.seconds` and `pos_ref.north` to `pos_ref.yaw`. Rows without a position
    are left out.
    Raises InputError, which names the file, the line and what is expected.
    """
    path = Path(path)
    try:
        with path.open(newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot read the trajectory: {error}") from error
    names = [name.strip() for name in rows[0]] if rows else []
    time = next((name for name in _TIME if name in names), None)
    groups = [*_POS, tuple(f"{_LOG}.{part}" for part in _POS[0])]
    pos = next((group for group in groups if all(name in names for name in group)), None)
    if time is None or pos is None:
        raise InputError(
            f"{path}:1: got the columns {', '.join(names) or '(none)'}, expected t, north, east and down (optional: vel_north, "
            "vel_east, vel_down, yaw), or those of a log (time.seconds, pos_ref.north, ...)"
        )
    at = {name: k for k, name in enumerate(names)}
    found = [
        _numbers(path, line, row, [at[name] for name in (time, *pos)])
        for line, row in enumerate(rows[1:], start=2)
        if row
    ]
    kept = [
        (row, values)
        for row, values in zip([r for r in rows[1:] if r], found, strict=True)
        if np.isfinite(values).all()
    ]
    if len(kept) < 2:
        raise InputError(f"{path}: got {len(kept)} rows with time and position, expected at least 2")
    values = np.array([each for _, each in kept])
    vel = next(
        (g for g in (("vel_north", "vel_east", "vel_down"), ("vx", "vy", "vz")) if all(n in at for n in g)),
        None,
    )
    yaw = next((name for name in ("yaw", f"{_LOG}.yaw") if name in at), None)
    return Sampled(
        values[:, 0],
        values[:, 1:],
        None if vel is None else np.array([_numbers(path, 0, row, [at[n] for n in vel]) for row, _ in kept]),
        None if yaw is None else np.nan_to_num([_numbers(path, 0, row, [at[yaw]])[0] for row, _ in kept]),
    )


def _numbers(path: Path, line: int, row: list[str], columns: list[int]) -> list[float]:
    """Return the numbers in the given columns of one CSV row; NaN for an empty cell.

    Raises InputError for a text that is not a number.
    """
    if len(row) <= max(columns):
        raise InputError(f"{path}:{line}: got {len(row)} cells, expected at least {max(columns) + 1}")
    try:
        return [float(row[k]) if row[k].strip() else np.nan for k in columns]
    except ValueError as error:
        raise InputError(f"{path}:{line}: {error}, expected a number") from error
