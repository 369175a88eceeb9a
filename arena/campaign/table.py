"""The results of a campaign as a Parquet table with one row per flight, and as plots."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arena.campaign.measures import MEASURES
from arena.campaign.store import Listing, Record

PARQUET = "results.parquet"
WITHOUT_PYARROW = (
    f"{PARQUET} is not written, because pyarrow is not installed (an older file is kept): run `pip install 'flying-arena[campaign]'`, then "
    "`arena campaign show` writes it"
)


def has_pyarrow() -> bool:
    """Return whether pyarrow is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def columns(listing: Listing, records: Sequence[Record]) -> dict[str, list[Any]]:
    """Return the table of results as column -> values, with one value per flight.

    A setting with values other than numbers becomes text.

    Columns: number, id, seed, the settings, passed, reasons, the measures, wall_s and run.
    """
    found: dict[str, list[Any]] = {
        "number": [r.number for r in records],
        "id": [r.id for r in records],
        "seed": [r.seed for r in records],
    }
    for name in listing.settings:
        found[name] = _alike([r.settings.get(name) for r in records])
    found["passed"] = [r.passed for r in records]
    found["reasons"] = ["\n".join(r.reasons) for r in records]
    for measure in MEASURES:
        found[measure.name] = [_float(r.measures.get(measure.name)) for r in records]
    return found | {"wall_s": [r.wall_s for r in records], "run": [r.run for r in records]}


def _alike(values: Sequence[Any]) -> list[Any]:
    """Convert the values of a column to one type: all bool, all int, all float, or all text."""
    kinds = {type(v) for v in values}
    if len(kinds) <= 1 and kinds <= {bool, int, float, str}:
        return list(values)
    if kinds == {int, float}:
        return [float(v) for v in values]
    return [v if isinstance(v, str) else json.dumps(v) for v in values]


def _float(value: float | None) -> float | None:
    return None if value is None else float(value)


def write_parquet(listing: Listing, records: Sequence[Record], path: Path) -> None:
    """Write the table of results to a Parquet file.

    The schema has the unit and the meaning of each measure as field metadata.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {m.name: (pa.float64(), {"unit": m.unit, "meaning": m.meaning}) for m in MEASURES}
    arrays, fields = [], []
    for name, values in columns(listing, records).items():
        kind, about = types.get(name, (None, None))
        arrays.append(pa.array(values, type=kind))
        fields.append(pa.field(name, arrays[-1].type, metadata=about))
    new = path.with_name(f"{path.name}.{os.getpid()}.new")  # `arena campaign show` may write at the same time
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), new)
    new.replace(path)


def write_plots(listing: Listing, records: Sequence[Record], folder: Path) -> list[Path]:
    """Write one plot for each measure that has data. Return the paths of the plots."""
    from arena.report import campaign_plots

    settings: Mapping[str, list[Any]] = {
        name: _alike([r.settings.get(name) for r in records]) for name in listing.settings
    }
    made = []
    for measure in MEASURES:
        values = np.array([_number(r.measures.get(measure.name)) for r in records])
        if np.isfinite(values).any():
            unit = "" if measure.unit == "1" else f" [{measure.unit}]"
            label = measure.name.removesuffix("_" + measure.unit.replace("/", "_")) + unit
            path = folder / f"{measure.name}.png"
            title = f"{listing.name}: {measure.meaning}"
            passed = [r.passed for r in records]
            made.append(campaign_plots.draw(title, label, values, passed, settings, path))
    return made


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def write_all(listing: Listing, records: Sequence[Record], folder: Path) -> list[Path]:
    """Write table and plots into the folder of a campaign.

    Older plots and an older table are removed if they are not written again. Without pyarrow the table is neither written nor removed.

    Return the paths of all files that were written.
    """
    flown, made = [r for r in records if not r.lost], list[Path]()
    if flown:
        with contextlib.suppress(ImportError):
            write_parquet(listing, flown, folder / PARQUET)
            made.append(folder / PARQUET)
        made += write_plots(listing, flown, folder / "plots")
    table = {folder / PARQUET} if has_pyarrow() else set()
    for old in {*table, *(folder / "plots" / f"{m.name}.png" for m in MEASURES)} - {*made}:
        old.unlink(missing_ok=True)
    return made
