"""Tables of the vehicles and processes of a run, for the live view of `arena up` and for `arena ps`. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from arena.supervisor.release import blocked

SLOW_FACTOR = 0.98
"""Real-time factor below which the simulation is shown as too slow."""
OLD_POSE_MS = 200.0

_COLOURS = {
    "READY": "green",
    "STARTING": "yellow",
    "BACKOFF": "magenta",
    "STOPPING": "yellow",
    "FATAL": "bold red",
    "EXITED": "cyan",
    "STOPPED": "dim",
}


def status_view(status: Mapping[str, Any]) -> Group:
    """Return a header line and the tables of vehicles and processes.

    status: reply of the supervisor to `ps`.
    """
    vehicles = [vehicles_table(status)] if status["vehicles"] else []
    return Group(header(status), *vehicles, processes_table(status))


def header(status: Mapping[str, Any]) -> Text:
    """Return the header line, such as `lab: running, 12 s, real-time factor 0.99`.

    The factor is yellow below SLOW_FACTOR.
    """
    rows = status["processes"].values()
    text = Text(f"{status['name']}: {status['phase']}, {status['up_s']:.0f} s", style="bold")
    if status.get("replay"):
        text.append(", replayed", style="magenta")
    if status["phase"] == "starting":
        text.append(
            f", {sum(row['starts'] > 0 and row['state'] != 'STARTING' for row in rows)} of {len(rows)} ready"
        )
    for row in rows:
        rtf = row["stats"].get("rtf") if row["kind"] in ("world", "replay") else None
        if rtf is not None:
            text.append(", real-time factor ")
            text.append(f"{rtf:.2f}", style="yellow" if rtf < SLOW_FACTOR else "green")
    return text


def processes_table(status: Mapping[str, Any]) -> Table:
    """Return a table with one row per process: state, CPU, memory, restarts and message rates."""
    table = Table(box=None, pad_edge=False)
    # In a narrow terminal only the last column is shortened.
    longest = max(map(len, status["processes"]), default=0)
    table.add_column("process", no_wrap=True, min_width=longest)
    table.add_column("state", no_wrap=True, min_width=max(map(len, _COLOURS)))
    for name in ("cpu %", "MB", "restarts"):
        table.add_column(name, justify="right", no_wrap=True, min_width=len(name))
    table.add_column("")
    for name, row in status["processes"].items():
        calm = row["state"] in ("READY", "STARTING")
        last = Text(rates(row["stats"]) if calm else str(row["reason"]), no_wrap=True, overflow="ellipsis")
        if row.get("member_of"):
            table.add_row(name, Text(f"in {row['member_of']}", style="dim"), "", "", "", last)
            continue
        table.add_row(
            name,
            Text(row["state"], style=_COLOURS.get(row["state"], "")),
            f"{100 * row['cpu_now']:.0f}",
            f"{row['rss_mb']:.0f}",
            str(row["restarts"] or ""),
            last,
        )
    return table


def vehicles_table(status: Mapping[str, Any]) -> Table:
    """Return a table with one row per vehicle: mode, armed, landed, height, battery and age of the last pose.

    The column `control` is shown if somebody other than its program commands a vehicle. The values of a vehicle that sends no
    telemetry are marked as old: `was yes`.
    """
    table = Table(box=None, pad_edge=False)
    controls = [_control(status["facts"], vehicle) for vehicle in status["vehicles"]]
    shows_control = any(control.plain not in ("-", "program") for control in controls)
    for name in ("vehicle", "mode", "armed", "landed", *(["control"] if shows_control else [])):
        table.add_column(name, no_wrap=True)
    for name in ("height", "battery", "pose age"):
        table.add_column(name, justify="right", no_wrap=True)
    telemetry: dict[str, Any] = {}
    for row in status["processes"].values():
        telemetry.update(row["stats"].get("telemetry") or {} if row["kind"] == "router" else {})
    for vehicle, control in zip(status["vehicles"], controls, strict=True):
        facts = [status["facts"].get(f"{vehicle}.{name}") for name in ("mode", "armed", "landed")]
        own = telemetry.get(vehicle, {})
        silent = status["facts"].get(f"{vehicle}.connected") is False
        states = [_marked(_text(value), silent) for value in facts]
        figures = [
            _marked(_figure(own.get("height_m"), ".2f", "m"), silent),
            _marked(_figure(own.get("battery"), ".0f", "%"), silent),
        ]
        table.add_row(
            vehicle, *states, *([control] if shows_control else []), *figures, _pose_age(status, vehicle)
        )
    return table


def _marked(text: str, silent: bool) -> Text:
    """Return the table cell of a value. If the vehicle is silent, the cell says that this value is an old one."""
    return Text(f"was {text}", style="red") if silent and text != "-" else Text(text)


def _control(facts: Mapping[str, Any], vehicle: str) -> Text:
    """Return the table cell that names who controls a vehicle, such as its program or a pilot.

    If programs may not fly before `arena release`, the text contains `blocked` and is yellow.
    """
    words = [facts.get(f"{vehicle}.control") or "", "blocked" if blocked(vehicle, facts) else ""]
    text = ", ".join(word for word in words if word) or "-"
    return Text(text, style="yellow" if words[1] else "")


def rates(stats: Mapping[str, Any]) -> str:
    """Return up to three rates that a process reports, as text, such as `poses 100.0 Hz`.

    Rates are statistics whose name ends in `_hz`.
    """
    found = [(k, v) for k, v in stats.items() if k.endswith("_hz") and isinstance(v, int | float)]
    return ", ".join(f"{name[:-3]} {value:.1f} Hz" for name, value in found[:3])


def _pose_age(status: Mapping[str, Any], vehicle: str) -> Text:
    for row in status["processes"].values():
        if row["kind"] == "forward" and row["vehicle"] == vehicle:
            age_ms = row["stats"].get("pose_age_ms")
            old = age_ms is not None and age_ms > OLD_POSE_MS
            return Text(_figure(age_ms, ".0f", "ms"), style="yellow" if old else "")
    return Text("-")


def _figure(value: float | None, form: str, unit: str) -> str:
    return "-" if value is None else f"{value:{form}} {unit}"


def _text(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "-", True: "yes", False: "no"}[value]
    return str(value)
