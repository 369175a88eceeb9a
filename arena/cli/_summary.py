"""Result of a run for the terminal, read from the run folder: a sentence and a short table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arena.errors import EXIT_INTERRUPTED, EXIT_OK

if TYPE_CHECKING:
    from rich.table import Table

SLOW_FACTOR = 0.98
"""Fraction of the requested speed below which the simulation counts as too slow."""


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file; {} if the file is missing or does not contain an object."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def verdict(run: Path) -> str:
    """Return the result of a run as one sentence.

    run: path of the run folder.
    """
    outcome, summary = read_json(run / "outcome.json"), read_json(run / "summary.json")
    if not outcome:
        return f"{run.name}: no outcome was recorded: the supervisor was killed, or could not write it"
    word = {EXIT_OK: "succeeded", EXIT_INTERRUPTED: "interrupted by Ctrl-C"}.get(
        outcome["exit_code"], "FAILED"
    )
    parts = [f"{outcome['name']}: {word} after {outcome['duration_s']:.1f} s"]
    parts += outcome["failed"] or _landings(summary.get("vehicles") or {}) or [str(outcome["landing"])]
    parts += failsafes(run)
    if stand_ins := [name for name, px4 in (summary.get("px4") or {}).items() if px4.get("stand_in")]:
        parts.append(f"{', '.join(stand_ins)} flew arena's stand-in for PX4, not PX4")
    if slow := slowness(outcome):
        parts.append(slow)
    return parts[0] + ": " + "; ".join(parts[1:])


def slowness(outcome: Mapping[str, Any]) -> str:
    """Return a warning if the simulation ran slower than requested, else "".

    outcome: content of outcome.json.
    """
    real_time = outcome.get("real_time") or {}
    factor, asked = real_time.get("factor"), real_time.get("asked")
    if factor is None or asked is None or factor >= SLOW_FACTOR * asked:
        return ""
    return f"SLOWER THAN REQUESTED: {factor:.2f} simulated seconds per second, {asked:g} was requested"


def failsafes(run: Path) -> list[str]:
    """Return the text of the newest failsafe event of each vehicle, from events.jsonl in a run folder."""
    found: dict[str, str] = {}
    try:
        lines = (run / "events.jsonl").read_text().splitlines()
    except OSError:
        return []
    for line in lines:
        if "failsafe" not in line.lower():
            continue
        event = json.loads(line)
        text = str(event.get("event", ""))
        if event.get("process") == "router" and "failsafe" in text.lower():
            found[text.partition(":")[0]] = text
    return list(found.values())


def short_table(run: Path) -> Table | None:
    """Return a table with one row per vehicle, or None if the run has no summary or no vehicles."""
    from rich.table import Table

    vehicles = read_json(run / "summary.json").get("vehicles") or {}
    if not vehicles:
        return None
    table = Table(box=None, pad_edge=False)
    table.add_column("vehicle", no_wrap=True)
    for name in ("in the air s", "max height m", "tracking rms m", "battery %"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("result")
    for name, found in vehicles.items():
        judged = found.get("verdict") or {}
        table.add_row(
            name,
            # reports of older versions have only the time of the simulated world
            _figure(found.get("in_air_s", judged.get("airborne_s")), ".1f"),
            _figure(judged.get("max_height_m"), ".2f"),
            _figure((found.get("tracking") or {}).get("rms_m"), ".3f"),
            _figure(found.get("battery_end"), ".0f"),
            _result(found),
        )
    return table


def _landings(vehicles: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return one text per group of vehicles whose flights ended in the same way, such as `uav1, uav2 landed`."""
    groups: dict[str, list[str]] = {}
    for name, found in vehicles.items():
        groups.setdefault(_result(found), []).append(name)
    return [f"{', '.join(names)} {result}" for result, names in groups.items()]


def _result(found: Mapping[str, Any]) -> str:
    if found.get("crashed"):
        return f"crashed ({found['crashed']})"
    if found.get("log_ends_early"):
        return "left a log that ends before its flight"
    if not found.get("flown"):
        return "did not fly"
    return "landed" if (found.get("landing") or {}).get("landed") else "landing not confirmed"


def _figure(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def lines_of(run: Path, *, columns: int | None = None) -> Sequence[str]:
    """Return the verdict and the short table of a run as lines of text.

    columns: width of the terminal; None for 160 columns.
    """
    from rich.console import Console

    lines = [verdict(run)]
    table = short_table(run)
    if table is not None:
        console = Console(width=columns or 160)
        with console.capture() as capture:
            console.print(table)
        lines += [line.rstrip() for line in capture.get().splitlines()]
    return lines
