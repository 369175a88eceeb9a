"""Logs in a run folder: computed from its `flight.mcap`, and written as CSV files and telemetry logs (.tlog)."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from arena.flight_log.conversion import ROW_HZ, flights_of
from arena.flight_log.csv_file import write_csv
from arena.flight_log.flight import Flight
from arena.flight_log.recording import Recording
from arena.flight_log.tlog_file import write_tlogs
from arena.wire.flight_record import FILE_NAME

CSV_FOLDER, TLOG_FOLDER, ULOG_FOLDER = "csv", "tlog", "ulog"


def has_record(run: Path) -> bool:
    """Return whether a run folder contains the record of a flight."""
    return (run / FILE_NAME).is_file()


def flights_of_run(run: Path) -> Iterator[Flight]:
    """Yield the log of each vehicle of a run, computed from its flight.mcap.

    Raises InputError if the record cannot be read.
    """
    recording = Recording(run / FILE_NAME)
    ulogs = {vehicle.name: ulogs_of(run, vehicle.name) for vehicle in recording.vehicles}
    yield from flights_of(recording, row_rate(run), ulogs)


def write_csv_files(run: Path) -> list[Path]:
    """Write `csv/<vehicle>.csv` for each vehicle of a run. Return the paths.

    Raises InputError if the record cannot be read, OSError if a file cannot be written.
    """
    (run / CSV_FOLDER).mkdir(exist_ok=True)
    written = []
    for flight in flights_of_run(run):
        path = run / CSV_FOLDER / f"{flight.name}.csv"
        write_csv(path, flight)
        written.append(path)
    return written


def write_tlog_files(run: Path) -> list[Path]:
    """Write `tlog/<vehicle>.tlog` for each vehicle of a run. Return the paths.

    Raises InputError if the record cannot be read, OSError if a file cannot be written.
    """
    recording = Recording(run / FILE_NAME)
    (run / TLOG_FOLDER).mkdir(exist_ok=True)
    return list(write_tlogs(run / TLOG_FOLDER, recording, [vehicle.name for vehicle in recording.vehicles]))


def ulogs_of(run: Path, vehicle: str) -> list[Path]:
    """Return the paths of a vehicle's ULogs (logs that PX4 itself has written), in the order of time."""
    name = re.compile(re.escape(vehicle) + r"(_\d+)?\.ulg")
    own = [path for path in (run / ULOG_FOLDER).glob(f"{vehicle}*.ulg") if name.fullmatch(path.name)]
    return sorted(own, key=lambda path: (len(path.name), path.name)) or sorted(
        (run / "px4" / vehicle / "log").glob("**/*.ulg")
    )


def link_px4_ulogs(run: Path, vehicle: str) -> list[Path]:
    """Make hard links in the folder `ulog` to the logs of a vehicle's PX4 SITL. Return the new paths.

    The paths are in the order of time. The names are `<vehicle>.ulg`, `<vehicle>_2.ulg`, ... Where the file
    system has no hard links, the logs are copied. A log that has its name already keeps it. Raises OSError if
    the folder cannot be written.
    """
    found = []
    for number, log in enumerate(sorted((run / "px4" / vehicle / "log").glob("**/*.ulg")), start=1):
        name = run / ULOG_FOLDER / (f"{vehicle}.ulg" if number == 1 else f"{vehicle}_{number}.ulg")
        if not name.exists():
            name.parent.mkdir(exist_ok=True)
            try:
                name.hardlink_to(log)
            except OSError:
                shutil.copy2(log, name)
        found.append(name)
    return found


def row_rate(run: Path) -> float:
    """Return how many rows per second the logs of a run have [Hz]: `log.rate_hz` of the YAML, or 30 if unknown."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        slices = json.loads((run / "plan.json").read_text())["slices"]
        return float(slices["recorder.json"]["rate_hz"])
    return ROW_HZ
