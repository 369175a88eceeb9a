"""`arena report RUN [RUN2]`: write the report page of one run, or a page that compares two flights."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from arena.cli.runs import last_run
from arena.errors import InputError

COMPARISON_FILE = "comparison.html"


def register(app: typer.Typer) -> None:
    """Add the command `arena report` to the typer app."""

    @app.command()
    def report(
        run: Annotated[
            str,
            typer.Argument(
                metavar="RUN",
                help="run folder, as `arena runs` lists them, or the folder of an arena for its last run",
            ),
        ],
        other: Annotated[
            str,
            typer.Argument(
                metavar="[RUN2]",
                show_default=False,
                help="second flight, to compare with the first. Each can be a run folder or a log (CSV, ULog, flight.mcap). PATH:VEHICLE "
                "selects one vehicle of a run",
            ),
        ] = "",
        output: Annotated[
            Path | None,
            typer.Option(
                "--output",
                "-o",
                metavar="FILE",
                help=f"path of the page; default: report.html in RUN, or {COMPARISON_FILE} in this folder",
            ),
        ] = None,
        align: Annotated[
            str,
            typer.Option(
                "--align",
                metavar="MOMENT",
                help="align both flights in time at this event: step (first setpoint more than 0.1 m from the position where OFFBOARD "
                "began), offboard (OFFBOARD begins) or takeoff. Default: the first of these events that both logs contain",
            ),
        ] = "",
    ) -> None:
        """Write report.html with interactive figures of a run, or a page that compares two flights."""
        if other:
            print(_compare(run, other, output or Path(COMPARISON_FILE), align))
            return
        print(_report(last_run(Path(run)), output))


def _report(run: Path, output: Path | None) -> Path:
    from arena.report.run_data import read_run
    from arena.report.run_report import PAGE, write_page
    from arena.report.run_report import report as write_report

    if not (run / "plan.json").is_file() and not (run / "csv").is_dir():
        raise InputError(f"{run}: not a run folder. `arena runs` lists run folders")
    if output is not None:
        return write_page(read_run(run), output)
    write_report(run, _show if sys.stderr.isatty() else lambda _: None)
    return run / PAGE


def _show(step: str) -> None:
    """Print on stderr what `arena report` does now, such as drawing a figure. stdout gets only the path of the page."""
    print(f"{step} ...", file=sys.stderr, flush=True)


def _compare(run: str, other: str, output: Path, align: str) -> Path:
    from arena.report.comparison_page import comparison_page, read_source
    from arena.report.flight_pair import MOMENTS

    if align and align not in MOMENTS:
        raise InputError(f"--align: got {align!r}, expected one of: {', '.join(MOMENTS)}")
    page = comparison_page(read_source(run), read_source(other), align or None)
    output.write_text(page)
    return output
