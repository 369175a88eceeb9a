"""The results of a campaign as text for a terminal. Pure."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from arena.campaign.measures import MEASURES
from arena.campaign.store import Listing, Record

_MOST_POINTS = 40
_MOST_FAILURES = 20
_SHOWN = ("tracking_rms_m", "setpoint_error_m", "landing_error_m", "crashes")


def in_campaign(listing: Listing, records: Iterable[Record]) -> list[Record]:
    """Return the records of the flights of this campaign, sorted as in its list of flights.

    A record whose flight is no longer in the list, because the sweep file was changed, is left out. Each record gets the number
    that its flight has in the list.
    """
    known = {record.id: record for record in records}
    return [
        dataclasses.replace(known[f["id"]], number=f["number"]) for f in listing.flights if f["id"] in known
    ]


def headline(listing: Listing, records: Sequence[Record]) -> str:
    """Return one line with the numbers of flights that passed, failed, were lost (no result) or are not flown yet."""
    passed = sum(r.passed for r in records)
    lost = sum(r.lost for r in records)
    parts = {
        "passed": passed,
        "failed": len(records) - passed - lost,
        "lost": lost,
        "not flown": len(listing.flights) - len(records),
    }
    counts = ", ".join(
        f"{count} {word}" for word, count in parts.items() if count or word in ("passed", "failed")
    )
    total = len(listing.flights)
    return f"{listing.name}: {total} flight{'s' if total != 1 else ''}: {counts}"


def text(listing: Listing, records: Sequence[Record]) -> RenderableType:
    """Return the report: headline, measures, and failures.

    The measures are shown for all flights, and for each combination of settings.
    """
    flown = [r for r in records if not r.lost]
    parts: list[RenderableType] = [Text(headline(listing, records), "bold")]
    if flown:
        parts += ["", _measures(flown)]
        parts += ["", points] if (points := _points(listing, flown)) is not None else []
    return Group(*parts, *failures(records))


def _measures(records: Sequence[Record]) -> Table:
    made = Table("measure", "unit", box=None, pad_edge=False)
    for head in ("flights", "min", "median", "95 %", "max"):
        made.add_column(head, justify="right")
    made.add_column("meaning")
    for measure in MEASURES:
        values = _values(records, measure.name)
        if values.size:
            figures = (values.min(), np.median(values), np.percentile(values, 95), values.max())
            numbers = (f"{x:.4g}" for x in figures)
            made.add_row(measure.name, measure.unit, str(values.size), *numbers, measure.meaning)
    return made


def _points(listing: Listing, records: Sequence[Record]) -> Table | None:
    """Return a table with the medians of the main measures (`_SHOWN`), one row per combination of settings.

    Return None if each combination was flown only once, or if the table would be too long.
    """
    rows: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        rows.setdefault(tuple(_cell(record.settings.get(n)) for n in listing.settings), []).append(record)
    if not listing.settings or len(rows) > _MOST_POINTS or len(rows) == len(records):
        return None
    shown = [m for m in MEASURES if m.name in _SHOWN and _values(records, m.name).size]
    made = Table(*(escape(n) for n in listing.settings), box=None, pad_edge=False)
    for head in ("flights", "failed", *(f"median {m.name}" for m in shown)):
        made.add_column(head, justify="right")
    for point, own in rows.items():
        failed = sum(not r.passed for r in own)
        medians = [f"{np.median(v):.4g}" if (v := _values(own, m.name)).size else "" for m in shown]
        made.add_row(*map(escape, point), str(len(own)), str(failed), *medians)
    return made


def failures(records: Sequence[Record]) -> list[RenderableType]:
    """Return one text per failed or lost flight: settings, run folder and reasons."""
    failed = [r for r in records if not r.passed]
    found: list[RenderableType] = []
    for record in failed[:_MOST_FAILURES]:
        word = "lost" if record.lost else "FAILED"
        head = f"\n{word}  {describe(record.number, record.seed, record.settings)}"
        found.append(Text(head + (f"  {record.run}" if record.run else ""), "bold red"))
        found += [Text(f"  {reason}") for reason in record.reasons]
    if len(failed) > _MOST_FAILURES:
        found.append(Text(f"\nand {len(failed) - _MOST_FAILURES} more failed flights; all are in the table"))
    return found


def describe(number: int, seed: int, settings: Any) -> str:
    """Return a flight as text: number, settings and seed."""
    parts = [f"{name}={_cell(value)}" for name, value in settings.items()]
    return " ".join([f"flight {number}", *parts, f"seed={seed}"])


def _values(records: Sequence[Record], measure: str) -> Any:
    return np.array([v for r in records if (v := r.measures.get(measure)) is not None], float)


def _cell(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_cell(v) for v in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)
