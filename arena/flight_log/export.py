"""Converts the logs of a run, or a log file, to a different file format."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from arena.errors import InputError
from arena.flight_log.csv_file import write_csv
from arena.flight_log.flight import Flight
from arena.flight_log.open import read_flights
from arena.flight_log.parquet_file import write_parquet
from arena.flight_log.recording import MCAP_MAGIC, Recording
from arena.flight_log.ros2_bag import write_bag, write_mcap
from arena.flight_log.tlog_file import write_tlogs
from arena.wire.flight_record import FILE_NAME


@dataclass(frozen=True, kw_only=True)
class Format:
    """A file format for exported logs, with the function that writes the files.

    meaning: what is written, for the help text.
    suffix: end of the names of the files.  each: one file per vehicle; else all vehicles are in one file or folder.
    write: function (source, path or folder, names of the vehicles or () for all) -> written paths.
    """

    meaning: str
    suffix: str
    each: bool
    write: Callable[[Path, Path, Sequence[str]], list[Path]]


def export(source: Path, kind: str, output: Path | None = None, vehicles: Sequence[str] = ()) -> list[Path]:
    """Convert a log to a different file format. Return the paths of the written files.

    For a ROS 2 bag, the path is that of its folder.

    source: as in `read_flights`.  kind: key of FORMATS.
    output: folder of the files, or path of the one file; None: in the run folder, or beside the file.
    vehicles: names of the vehicles to export; empty for all.
    Files that exist are replaced. Raises InputError if the source cannot be exported in this format.
    """
    form = FORMATS[kind]
    target = _target(source, kind, form) if output is None else output
    (target if form.each else target.parent).mkdir(parents=True, exist_ok=True)
    return form.write(source, target, vehicles)


def _target(source: Path, kind: str, form: Format) -> Path:
    """Return the default output path: a folder for formats with one file per vehicle, else a file."""
    base = source if source.is_dir() else source.parent
    if form.each:
        return base / kind if source.is_dir() else base
    return base / f"{'ros2' if source.is_dir() else source.stem}{form.suffix}"


def _chosen(source: Path, vehicles: Sequence[str]) -> list[Flight]:
    flights = read_flights(source)
    _check_names(source, vehicles, [flight.name for flight in flights])
    return [flight for flight in flights if not vehicles or flight.name in vehicles]


def _check_names(source: Path, vehicles: Sequence[str], names: Sequence[str]) -> None:
    if unknown := [name for name in vehicles if name not in names]:
        raise InputError(
            f"{source}: has no vehicle {', '.join(unknown)}; its vehicles are: {', '.join(names)}"
        )


def _each(
    write: Callable[[Path, Flight], None], suffix: str
) -> Callable[[Path, Path, Sequence[str]], list[Path]]:
    """Return a function that writes the log of each vehicle to a separate file, for `Format.write`.

    write: function that writes the log of one vehicle. suffix: end of the file names.
    """

    def write_all(source: Path, folder: Path, vehicles: Sequence[str]) -> list[Path]:
        written = []
        for flight in _chosen(source, vehicles):
            path = folder / f"{flight.name}{suffix}"
            if path.resolve() == source.resolve():
                raise InputError(
                    f"{path}: the export would overwrite the log that is exported; choose another folder with -o"
                )
            write(path, flight)
            written.append(path)
        return written

    return write_all


def _all(
    write: Callable[[Path, Sequence[Flight]], int],
) -> Callable[[Path, Path, Sequence[str]], list[Path]]:
    """Return a function that writes the logs of all vehicles to one file or folder, for `Format.write`.

    write: function that writes the logs of several vehicles.
    """

    def write_all(source: Path, path: Path, vehicles: Sequence[str]) -> list[Path]:
        if path.resolve() == source.resolve() or path.name == FILE_NAME:
            raise InputError(
                f"{path}: the export would overwrite the record of a flight; choose another path with -o"
            )
        write(path, _chosen(source, vehicles))
        return [path]

    return write_all


def _tlogs(source: Path, folder: Path, vehicles: Sequence[str]) -> list[Path]:
    record = source / FILE_NAME if source.is_dir() else source
    if not _is_mcap(record):
        raise InputError(
            f"{source}: cannot be exported as tlog, because this log contains no MAVLink messages. "
            f"Expected a {FILE_NAME}, or a run folder that contains one"
        )
    recording = Recording(record)
    names = [vehicle.name for vehicle in recording.vehicles]
    _check_names(source, vehicles, names)
    return list(write_tlogs(folder, recording, vehicles or names))


def _is_mcap(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except OSError:
        return False


FORMATS: Mapping[str, Format] = {
    "csv": Format(
        meaning="one table per vehicle, as the report of a run writes it",
        suffix=".csv",
        each=True,
        write=_each(write_csv, ".csv"),
    ),
    "parquet": Format(
        meaning="the same table in a compressed file that pandas, polars and DuckDB read fast",
        suffix=".parquet",
        each=True,
        write=_each(write_parquet, ".parquet"),
    ),
    "ros2": Format(
        meaning="a ROS 2 bag with standard messages, ENU and FLU",
        suffix="",
        each=False,
        write=_all(write_bag),
    ),
    "mcap": Format(
        meaning="one file with the same ROS 2 messages, for Foxglove and PlotJuggler",
        suffix=".mcap",
        each=False,
        write=_all(write_mcap),
    ),
    "tlog": Format(
        meaning="the MAVLink messages of each vehicle, for QGroundControl, Mission Planner and MAVExplorer",
        suffix=".tlog",
        each=True,
        write=_tlogs,
    ),
}
"""Name of the format -> how it is written."""
