"""Writes the log of a vehicle as a CSV file. The module `arena.flight_log.columns` lists the columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from arena.flight_log.columns import columns
from arena.flight_log.flight import FLAGS, MODE, Flight
from arena.geometry import Array

TIME = "time.seconds"


def write_csv(path: Path, flight: Flight) -> None:
    """Write the log of a vehicle to a CSV file, and replace an existing file.

    Numbers have seven digits. Cells of unknown values are empty.
    """
    partial = path.with_suffix(".partial")
    with partial.open("w") as file:
        file.writelines(csv_lines(flight))
    partial.replace(path)


def header(simulated: bool) -> str:
    """Return the first line of a CSV log: the names of the columns, separated by commas.

    simulated: the log has columns of the true state.
    """
    return ",".join(columns(simulated)) + "\n"


def csv_lines(flight: Flight) -> Iterator[str]:
    """Yield the lines of a CSV log, the header first."""
    yield header(flight.simulated)
    missing = np.full(flight.t.size, np.nan)
    texts: list[str] = []
    values: list[list[float] | list[str]] = []
    for name in columns(flight.simulated):
        if name == MODE:
            texts.append("%s")
            values.append(list(flight.mode))
        elif name in FLAGS:
            texts.append("%s")
            values.append(_flags(flight.numbers.get(name, missing)))
        else:
            column = flight.numbers.get(name, missing)
            known = np.isfinite(column)
            if known.all():
                texts.append("%.4f" if name == TIME else "%.7g")
                values.append(column.tolist())
            elif known.any():
                texts.append("%.7g")
                values.append(np.where(known, column, np.nan).tolist())
            else:
                texts.append("")
    line = ",".join(texts) + "\n"
    for row in zip(*values, strict=True):
        text = line % row
        yield text.replace("nan", "") if "nan" in text else text


def _flags(column: Array) -> list[str]:
    return ["" if np.isnan(x) else str(x == 1.0) for x in column.tolist()]
