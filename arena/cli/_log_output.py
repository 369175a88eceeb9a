"""Output of the commands `arena log ...`: tables of logs, topics and differences."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from arena.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from arena.flight_log.log_info import LogInfo
    from arena.report.flight_pair import Pair

_WIDTH = 400  # without a terminal, so that no line is wrapped
_LOGS = ("flight*.mcap", "ulog/*.ulg", "px4/*/log/**/*.ulg", "csv/*.csv", "parquet/*.parquet", "tlog/*.tlog")


def show(table: Table) -> None:
    """Print a table on the terminal.

    If stdout is not a terminal, lines are not wrapped.
    """
    from rich.console import Console

    console = Console()
    console.width = console.width if console.is_terminal else _WIDTH
    console.print(table)


def logs_table(run: Path) -> Table:
    """Return the table of the logs in a run folder."""
    from rich.table import Table

    table = Table("log", "size", "length s", "messages", "note", box=None, pad_edge=False)
    for column in table.columns[1:4]:
        column.justify = "right"
    for path in (path for pattern in _LOGS for path in sorted(run.glob(pattern))):
        table.add_row(*_log_row(run, path))
    if not table.row_count:
        table.add_row("no logs", "", "", "", "the recorder writes flight.mcap during the flight")
    return table


def _log_row(run: Path, path: Path) -> tuple[str, str, str, str, str]:
    from arena.flight_log.log_info import log_info

    name, size = str(path.relative_to(run)), size_text(path.stat().st_size)
    if path.suffix not in (".mcap", ".ulg", ".csv"):
        return name, size, "", "", ""
    try:
        found = log_info(path, brief=True)
    except InputError as error:
        return name, size, "", "", str(error).removeprefix(f"{path}: ")
    return name, size, _number(found.length_s, 1), str(found.messages), found.incomplete


def show_info(found: LogInfo) -> None:
    """Print the content of a log file: size, length, and a table of its topics."""
    from rich.table import Table

    print(f"{found.path}: {found.kind}, {size_text(found.size_bytes)}, {_number(found.length_s, 1)} s")
    for fact in found.facts:
        print(f"  {fact}")
    print(f"  {found.incomplete or 'complete: the file ended cleanly'}")
    table = Table("topic", "messages", "rate Hz", "longest gap s", "gaps", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for stream in found.streams:
        longest = _number(stream.longest_s, 3) if stream.count > 1 else ""
        table.add_row(
            stream.name, str(stream.count), _number(stream.rate_hz, 2), longest, str(stream.gaps or "")
        )
    show(table)


def show_comparison(pair: Pair) -> None:
    """Print two tables about two flights: the differences between them, and the values of both side by side."""
    from rich.table import Table

    from arena.report.flight_pair import difference
    from arena.report.pair_figures import pair_figures

    found = difference(pair)
    differences = Table("B minus A", "rms", "p95", "max.", box=None, pad_edge=False)
    for name, measured in found.measures().items():
        unit, digits = ("deg", 2) if name == "yaw" else ("m", 3)
        cells = ("-",) * 3 if measured is None else (measured.rms, measured.p95, measured.max)
        differences.add_row(
            f"{name} {unit}", *(c if isinstance(c, str) else _number(c, digits) for c in cells)
        )
    figures = Table("figure", pair.a.label, pair.b.label, box=None, pad_edge=False)
    for label, unit, digits, a, b in pair_figures(pair):
        figures.add_row(f"{label} {unit}", *("-" if x is None else _number(x, digits) for x in (a, b)))
    for table in (differences, figures):
        for column in table.columns[1:]:
            column.justify = "right"
    lasted = found.t[-1] - found.t[0]
    moments = f"{pair.a.zero_s:.2f} s and {pair.b.zero_s:.2f} s of their logs"
    print(
        f"{pair.name}: both flights compared for {lasted:.1f} s after the event `{pair.moment}`, which is at {moments}"
    )
    show(differences)
    print()
    show(figures)


def size_text(size: int) -> str:
    """Return a file size as text with a unit, such as `12.3 MB`."""
    value = float(size)
    for unit in ("B", "kB", "MB"):
        if value < 1000:
            return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:.1f} GB"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
