"""Compare a finished run with the figures of the thesis, and print them as a table.

    python examples/thesis/expectations.py FOLDER FLIGHT RUN

FOLDER: folder of an experiment, such as `formation`.  FLIGHT: key under `flights` in its expect.yaml.  RUN: run folder.
README.md describes expect.yaml. The exit code is 1 if a figure is outside its limits.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import NED, RPY
from arena.flight_log.flight import Flight
from arena.flight_log.open import read_flights
from arena.schema.loader import load_yaml

HERE = Path(__file__).parent
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the table: one figure of one vehicle, with its limits. README.md describes the fields."""

    vehicle: str
    figure: str
    from_s: float = -math.inf
    to_s: float = math.inf
    thesis: float | None = None
    at_most: float = math.inf
    at_least: float = -math.inf
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """One flight of an experiment.

    arena: path of its YAML.  settings: values of `--set`.  rows: rows of the table.
    """

    name: str
    arena: Path
    settings: Mapping[str, Any] = field(default_factory=dict)
    rows: tuple[Row, ...]

    @property
    def overrides(self) -> tuple[str, ...]:
        """Values of `--set`, as KEY=VALUE."""
        return tuple(f"{key}={json.dumps(value)}" for key, value in self.settings.items())


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A row with the figure of our flight; NaN if the log does not contain it."""

    row: Row
    ours: float

    @property
    def passed(self) -> bool:
        return self.row.at_least <= self.ours <= self.row.at_most


def read_expected(folder: Path) -> tuple[str, str, tuple[Expected, ...]]:
    """Return the title, the tests of the thesis, and the flights of an experiment, from its expect.yaml."""
    found = load_yaml(folder / "expect.yaml").data
    flights = tuple(
        Expected(
            name=name,
            arena=folder / flight["arena"],
            settings=flight.get("set", {}),
            rows=tuple(_row(raw) for raw in flight["rows"]),
        )
        for name, flight in found["flights"].items()
    )
    return str(found["title"]), str(found["tests"]), flights


def measure(expected: Expected, run: Path) -> list[Measured]:
    """Return the figures of a finished run. run: its folder."""
    flights = {flight.name: flight for flight in read_flights(run)}
    return [Measured(row=row, ours=_figure(row, flights.get(row.vehicle), run)) for row in expected.rows]


def table(found: Sequence[Measured]) -> str:
    """Return the figures as text, one line each: vehicle, figure, thesis, ours, limits, and whether ours is inside."""
    lines = [f"{'vehicle':9}{'figure':28}{'thesis':>9}{'ours':>9}  limits"]
    for one in found:
        r = one.row
        thesis = "-" if r.thesis is None else f"{r.thesis:.3f}"
        limits = [f"at least {r.at_least:g}"] * (r.at_least > -math.inf) + [f"at most {r.at_most:g}"] * (
            r.at_most < math.inf
        )
        verdict = "ok" if one.passed else "FAILED"
        lines.append(f"{r.vehicle:9}{r.figure:28}{thesis:>9}{one.ours:9.3f}  {', '.join(limits)}: {verdict}")
    return "\n".join(lines)


def _row(raw: Mapping[str, Any]) -> Row:
    row = Row(**raw)
    if row.at_most == math.inf and row.at_least == -math.inf:
        raise ValueError(f"the row {dict(raw)} has no limit: write at_most or at_least")
    if row.figure not in FIGURES and not row.figure.startswith(_SAID):
        raise ValueError(f"figure: got {row.figure!r}, expected {_SAID}NAME or one of {', '.join(FIGURES)}")
    return row


def _figure(row: Row, flight: Flight | None, run: Path) -> float:
    if row.figure.startswith(_SAID):
        return _said(row.figure.removeprefix(_SAID), _program_log(run, row.vehicle))
    if flight is None or not flight.offboard.any():
        return math.nan
    since = flight.t - flight.t[flight.offboard.argmax()]
    window = flight.offboard & (since >= row.from_s) & (since <= row.to_s)
    return FIGURES[row.figure](flight, window) if window.any() else math.nan


def _program_log(run: Path, name: str) -> Path:
    """Return the log of the program of a vehicle, or of a group of vehicles."""
    of_vehicle = run / "logs" / f"program.{name}.log"
    return of_vehicle if of_vehicle.exists() else run / "logs" / f"group.{name}.log"


def _said(name: str, log: Path) -> float:
    """Return the number in the last line `NAME: NUMBER` of a log file; NaN without such a line."""
    try:
        found = re.findall(rf"^{re.escape(name)}: (\S+)", log.read_text(errors="replace"), re.MULTILINE)
        return float(found[-1])
    except (OSError, IndexError, ValueError):
        return math.nan


def _error(flight: Flight, window: Mask) -> NDArray[np.float64]:
    return (flight.group("ekf.pos") - flight.group("pos_ref"))[window]


def _tracking(flight: Flight, window: Mask) -> float:
    return float(np.sqrt(np.nanmean(np.sum(_error(flight, window) ** 2, axis=1))))


def _axis(index: int) -> Callable[[Flight, Mask], float]:
    return lambda flight, window: float(np.sqrt(np.nanmean(_error(flight, window)[:, index] ** 2)))


def _end_error(flight: Flight, window: Mask) -> float:
    return float(np.linalg.norm(_error(flight, window)[-1]))


def _tilt(flight: Flight, window: Mask) -> float:
    roll, pitch, _ = flight.group("ekf.att_euler", RPY)[window].T
    return math.degrees(float(np.nanmax(np.arccos(np.cos(roll) * np.cos(pitch)))))


_SAID = "said "
FIGURES: Mapping[str, Callable[[Flight, Mask], float]] = {
    "tracking": _tracking,
    **{f"tracking.{axis}": _axis(index) for index, axis in enumerate(NED)},
    "end_error": _end_error,
    "tilt": _tilt,
}
"""Name of a figure -> function of the log of a vehicle and the rows of the window (n,)."""


def main(folder: str, name: str, run: str) -> int:
    """Print the table of one run. Return the exit code."""
    title, tests, flights = read_expected(HERE / folder)
    found = measure(next(each for each in flights if each.name == name), Path(run))
    print(f"{title} (tests {tests}), {name}\n{table(found)}")
    return 0 if all(one.passed for one in found) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
