"""`arena log`: list, describe, export, plot and compare logs of flights, and fetch logs from vehicles.

The commands take a run folder or a file: `flight.mcap`, a CSV log of arena or of the thesis, a PX4 log (ULog).
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._log_fetch import fetch
from arena.cli.runs import run_folders
from arena.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from arena.flight_log.flight import Flight

Source = Annotated[Path, typer.Argument(metavar="RUN", help="run folder, or a log file: .mcap, .csv or .ulg")]
Vehicles = Annotated[
    list[str] | None,
    typer.Option("--vehicle", "-v", metavar="NAME", help="only this vehicle; can be repeated"),
]


class Kind(StrEnum):
    """File formats that `arena log export` can write."""

    CSV = "csv"
    PARQUET = "parquet"
    ROS2 = "ros2"
    MCAP = "mcap"
    TLOG = "tlog"


class Align(StrEnum):
    """Moments of a flight, such as the take-off, by which `arena log compare` aligns two flights in time."""

    STEP = "step"
    OFFBOARD = "offboard"
    TAKEOFF = "takeoff"


def register(app: typer.Typer) -> None:
    """Add the commands of `arena log` to the typer app."""
    group = typer.Typer(
        no_args_is_help=True,
        help="List, describe, export, plot and compare the logs of flights, and fetch logs from vehicles.",
    )
    group.command("ls")(list_logs)
    for command in (info, export, plot, compare, fetch):
        group.command()(command)
    app.add_typer(group, name="log")


def list_logs(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN",
            help="run folder; default: the newest run folder of the arena in the current folder",
        ),
    ] = None,
) -> None:
    """List the logs in a run folder, with their sizes, lengths and numbers of messages."""
    from arena.cli._log_output import logs_table, show

    folder = _newest() if run is None else run
    if not folder.is_dir():
        raise InputError(f"{folder}: not a folder, expected a run folder. `arena runs` lists the run folders")
    print(folder)
    show(logs_table(folder))


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="flight.mcap, .ulg or .csv; or a run folder")],
) -> None:
    """Show the content of a log file: topics, messages, rates, gaps, and whether the file is complete."""
    from arena.cli._log_output import show_info
    from arena.flight_log.log_info import log_info
    from arena.wire.flight_record import FILE_NAME

    show_info(log_info(file / FILE_NAME if file.is_dir() else file))


def export(
    run: Source,
    to: Annotated[
        Kind,
        typer.Option("--to", help="format: csv, parquet, ros2 (bag), mcap (ROS 2 messages), tlog (MAVLink)"),
    ] = Kind.CSV,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="PATH",
            help="where to write: the folder of the files (csv, parquet, tlog), the folder of the bag (ros2), or the file (mcap)",
        ),
    ] = None,
    vehicle: Vehicles = None,
) -> None:
    """Write the logs of a run, or one log file, in a different format.

    Also works for a run that was killed before it wrote its CSV files.
    """
    from arena.flight_log.export import export as write

    for path in write(run, to.value, output, vehicle or ()):
        print(path)


def plot(
    run: Source,
    columns: Annotated[
        list[str],
        typer.Argument(
            metavar="COLUMN...",
            help="columns (ekf.pos.down) or quantities (ekf.pos), one panel each; a+b: both in one panel",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="picture (.png, .svg, .pdf) or page (.html)"),
    ] = Path("plot.png"),
    vehicle: Vehicles = None,
) -> None:
    """Plot columns of a log over time, as a picture or as a page that can be zoomed."""
    from arena.report.column_plot import panels, write_plot

    flights = _flights(run, vehicle or ())
    write_plot(output, panels(flights, columns), run.resolve().name)
    print(output)


def compare(
    first: Annotated[Path, typer.Argument(metavar="RUN1", help="run folder or log file")],
    second: Annotated[Path, typer.Argument(metavar="RUN2", help="run folder or log file")],
    align: Annotated[
        Align | None,
        typer.Option(
            "--align",
            help="align both flights in time at this event: step (first setpoint more than 0.1 m from the position where OFFBOARD "
            "began), offboard (OFFBOARD begins) or takeoff. Default: the first of these events that both logs contain",
        ),
    ] = None,
    vehicle: Vehicles = None,
) -> None:
    """Compare two flights, such as a simulated and a real one: differences, tracking errors, errors of the estimate.

    Positions are measured from the position at the common moment. `arena report RUN1 RUN2` draws the comparison.
    """
    from arena.cli._log_output import show_comparison
    from arena.report.flight_pair import pairs

    flights = [_flights(path, vehicle or ()) for path in (first, second)]
    names = _title(first), _title(second)
    for pair in pairs(flights[0], flights[1], names, None if align is None else align.value):
        show_comparison(pair)


def _title(path: Path) -> str:
    """Return a title for a log: the name of the run folder, or the name of the file without its suffix."""
    return path.resolve().name if path.is_dir() else path.stem


def _flights(path: Path, vehicles: Sequence[str]) -> list[Flight]:
    """Return the flights in a log, one per vehicle.

    vehicles: names of the wanted vehicles; empty for all. Raises InputError for an unknown name.
    """
    from arena.flight_log.open import read_flights

    flights = read_flights(path)
    names = [flight.name for flight in flights]
    if unknown := [name for name in vehicles if name not in names]:
        raise InputError(f"{path}: has no vehicle {', '.join(unknown)}; its vehicles are: {', '.join(names)}")
    return [flight for flight in flights if not vehicles or flight.name in vehicles]


def _newest() -> Path:
    runs = run_folders(Path())
    if not runs:
        raise InputError(f"no run folders in {Path().resolve()}: give the path of a run folder")
    return runs[-1]
