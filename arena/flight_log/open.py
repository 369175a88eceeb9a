"""Opens the log of a flight in any file format that arena can read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.flight_log.columns import NED, RPY, WXYZ
from arena.flight_log.conversion import flights_of
from arena.flight_log.flight import Flight, read_flight
from arena.flight_log.recording import MCAP_MAGIC, Recording
from arena.flight_log.run_folder import flights_of_run, has_record
from arena.geometry import euler_from_quat
from arena.wire.flight_record import FILE_NAME
from arena.wire.ulog import MAGIC as ULOG_MAGIC

_EXPECTED = (
    "a run folder of arena, a flight.mcap of arena, a CSV file with the column time.seconds (of arena or of the ISR"
    " Flying Arena), or a PX4 log (.ulg)"
)


def read_flights(path: Path | str) -> list[Flight]:
    """Return the logs in a run folder or log file, one `Flight` per vehicle, in the order of their names.

    path: run folder, record of a flight (`flight.mcap`), CSV file of arena or of the thesis from which arena was developed, or
        PX4 log (ULog, `.ulg`). The flights of a run folder are computed from its record; an older run folder has only CSV files.
    Raises InputError if the path does not exist, is not such a log, or contains no complete row.
    """
    path = Path(path)
    if path.is_dir():
        return _of_folder(path)
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}, expected {_EXPECTED}") from error
    if path.suffix == ".ulg" or head.startswith(ULOG_MAGIC):
        from arena.flight_log.px4_ulog import (
            read_ulog_flight,
        )  # imported only here: pyulog is needed only here

        return [read_ulog_flight(path)]
    if head.startswith(MCAP_MAGIC):
        return _not_empty(flights_of(Recording(path)), path)
    if not head:
        raise InputError(f"{path}: got an empty file, expected {_EXPECTED}")
    if b"\0" in head:
        raise InputError(f"{path}: got a file that begins with {head.hex(' ').upper()}, expected {_EXPECTED}")
    return [_of_csv(path)]


def _of_folder(folder: Path) -> list[Flight]:
    if has_record(folder):
        return _not_empty(flights_of_run(folder), folder / FILE_NAME)
    files = sorted(folder.glob("csv/*.csv")) or sorted(folder.glob("*.csv"))
    if not files:
        contents = ", ".join(sorted(p.name for p in folder.iterdir())) or "nothing"
        raise InputError(f"{folder}: got a folder that contains {contents}, expected {_EXPECTED}")
    flights = [flight for file in files if (flight := _read_csv(file)) is not None]
    if not flights:
        raise InputError(
            f"{folder}: no log in {files[0].parent} contains a complete row: did the vehicles send messages?"
        )
    return flights


def _not_empty(flights: Iterable[Flight], record: Path) -> list[Flight]:
    found = list(flights)
    if not found:
        raise InputError(
            f"{record}: the record contains no message of a vehicle: did the vehicles send messages?"
        )
    return found


def _of_csv(path: Path) -> Flight:
    flight = _read_csv(path)
    if flight is None:
        with path.open(errors="replace") as file:
            first = file.readline(200).strip()
        raise InputError(
            f"{path}: got a text file that begins with {first[:60]!r} and has no complete row of the column time.seconds,"
            f" expected {_EXPECTED}"
        )
    return flight


def _read_csv(path: Path) -> Flight | None:
    flight = read_flight(path)
    return None if flight is None else _mended(flight)


def _mended(flight: Flight) -> Flight:
    """Correct a log of the ISR Flying Arena thesis, in which two groups of columns have wrong values.

    The logger of the thesis (from which arena was developed) filled two groups of columns with the values of
    other groups. Its `imu.mag` repeats `imu.ang_vel`, so it is removed. Its `mocap.att_euler` repeats
    `ekf.att_euler`, so it is computed from `mocap.att_q`.
    """
    numbers = dict(flight.numbers)
    if _same(flight, "imu.mag", NED, "imu.ang_vel", RPY):
        for part in NED:
            numbers.pop(f"imu.mag.{part}")
    if _same(flight, "mocap.att_euler", RPY, "ekf.att_euler", RPY):
        angles = euler_from_quat(flight.group("mocap.att_q", WXYZ))
        numbers.update({f"mocap.att_euler.{part}": angles[:, k] for k, part in enumerate(RPY)})
    return replace(flight, numbers=numbers)


def _same(flight: Flight, name: str, parts: Sequence[str], other: str, other_parts: Sequence[str]) -> bool:
    if f"{name}.{parts[0]}" not in flight.numbers:
        return False
    values, repeated = flight.group(name, parts), flight.group(other, other_parts)
    return bool(np.isfinite(values).any() and np.array_equal(values, repeated, equal_nan=True))
