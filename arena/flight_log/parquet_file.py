"""Writes the log of a vehicle as a Parquet file, with the same columns as the CSV file. Needs pyarrow."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arena.errors import NotInstalledError
from arena.flight_log.columns import columns
from arena.flight_log.flight import FLAGS, MODE, Flight

WITHOUT_PYARROW = (
    "Parquet files need the package pyarrow, which is not installed: pip install 'flying-arena[logs]'"
)


def write_parquet(path: Path, flight: Flight) -> None:
    """Write the log of a vehicle to a Parquet file.

    Unknown values are null. The metadata of the file contain the name of the vehicle.

    Raises NotInstalledError if pyarrow is missing.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise NotInstalledError(WITHOUT_PYARROW) from error

    found = {}
    for name in columns(flight.simulated):
        if name == MODE:
            found[name] = pa.array([mode or None for mode in flight.mode], pa.string())
            continue
        values = flight.numbers.get(name)
        values = np.full(flight.t.size, np.nan) if values is None else values
        unknown = np.isnan(values)
        if name in FLAGS:
            found[name] = pa.array(np.asarray(values == 1.0), pa.bool_(), mask=unknown)
        else:
            found[name] = pa.array(values, pa.float64(), mask=unknown)
    table = pa.table(found).replace_schema_metadata({"vehicle": flight.name})
    parquet.write_table(table, path)
