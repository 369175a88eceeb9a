"""Tables that `arena top` shows on the terminal: vehicles, processes and events. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from arena.live_view import Event, ProcessRow, Snapshot

SLOW_FACTOR = 0.98
"""Real-time factor below which the simulation is yellow."""
OLD_POSE_S, SILENT_S = 0.2, 1.5
"""Ages of the last pose and of the last message above which a value is yellow [s]."""
LOW_BATTERY, EMPTY_BATTERY = 25.0, 10.0
_MIN_EVENTS, _MAX_EVENTS = 3, 8
_FIGURES = ("battery", "north", "east", "height", "speed", "pose age", "poses", "message")
_LEFT_OUT = ((122, ("poses",)), (112, ("speed",)), (102, ("message", "north", "east")), (72, ("control",)))
"""Columns that a terminal with fewer columns than the number does not show."""
_KEYS = "q: quit   up, down: scroll the vehicles"
_STATES = {"READY": "green", "FATAL": "bold red", "EXITED": "cyan", "STOPPED": "dim", "BACKOFF": "magenta"}
_UNKNOWN = Text("-", style="dim")


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Numbers of vehicles, processes and events that `arena top` shows, chosen to fit the terminal.

    first: number of vehicles that are scrolled away.
    """

    vehicles: int
    processes: int
    events: int
    first: int


def frame(
    snapshot: Snapshot, *, width: int | None = None, height: int | None = None, scrolled: int = 0
) -> Group:
    """Return the whole picture of `arena top`: header, vehicles, processes and events.

    width, height: columns and rows of the terminal; None for complete tables.
    scrolled: number of vehicles to leave out at the top.
    """
    shown = own_processes(snapshot.processes)
    events = [e for e in snapshot.events if not e.detail]
    rows = row_numbers(len(snapshot.fleet.names), len(shown), len(events), height, scrolled)
    parts: list[RenderableType] = [header(snapshot), Text("")]
    if snapshot.fleet.names:
        parts += [vehicles_table(snapshot, rows.first, rows.vehicles, width), Text("")]
    if rows.processes:
        parts += [processes_table(shown, rows.processes), Text("")]
    parts += [event_line(e) for e in events[-rows.events :]] if rows.events else []
    if height is not None:
        parts.append(Text(_KEYS, style="dim"))
    return Group(*parts)


def waiting_frame(why: str) -> RenderableType:
    """Return the picture of `arena top` while no arena runs.

    why: reason, with what to do.
    """
    return Padding(
        Group(Text(why), Text("This view shows the arena as soon as it runs.   q: quit", style="dim")), 1
    )


def row_numbers(vehicles: int, processes: int, events: int, height: int | None, scrolled: int) -> Rows:
    """Divide the rows of the terminal among the tables of vehicles, processes and events.

    Vehicles have priority.

    vehicles, processes, events: numbers of existing rows.  height: rows of the terminal; None for no limit.
    scrolled: number of vehicles that the user has scrolled away.
    """
    if height is None:
        return Rows(vehicles=vehicles, processes=processes, events=min(events, _MAX_EVENTS), first=0)
    left = max(0, height - 9)  # header, headings of two tables, empty lines, keys, two lines for hidden rows
    lines = min(events, _MIN_EVENTS, left)
    least = min(processes, max(4, left // 4))
    for_vehicles = max(1, min(vehicles, left - lines - least))
    for_processes = max(0, min(processes, left - lines - for_vehicles))
    lines = min(events, _MAX_EVENTS, max(0, left - for_vehicles - for_processes))
    first = max(0, min(scrolled, vehicles - for_vehicles))
    return Rows(vehicles=for_vehicles, processes=for_processes, events=lines, first=first)


def own_processes(processes: Sequence[ProcessRow]) -> list[ProcessRow]:
    """Return the processes with a pid of their own. Failed and waiting ones (FATAL, BACKOFF) come first.

    Members, which run inside another process, are left out.
    """
    own = [p for p in processes if not p.member_of]
    return sorted(own, key=lambda p: p.state not in ("FATAL", "BACKOFF"))


def header(snapshot: Snapshot) -> Text:
    """Return the first line of `arena top`: arena name, phase, time, number of vehicles, real-time factor."""
    text = Text(f"{snapshot.name}: {snapshot.phase}", style="bold", no_wrap=True, overflow="ellipsis")
    text.append(f"   {snapshot.time_s:.1f} s", style="not bold")
    fleet = snapshot.fleet
    if fleet.names:
        armed, flying = sum(a is True for a in fleet.armed), sum(x is False for x in fleet.landed)
        text.append(f"   {len(fleet.names)} vehicles, {armed} armed, {flying} in the air", style="not bold")
    if snapshot.real_time_factor is not None:
        text.append("   real-time factor ", style="not bold")
        slow = snapshot.real_time_factor < SLOW_FACTOR
        text.append(f"{snapshot.real_time_factor:.2f}", style="yellow" if slow else "green")
    if not snapshot.answers:
        text.append("   the supervisor does not reply: processes and phase are old", style="bold yellow")
    return text


def vehicles_table(snapshot: Snapshot, first: int, count: int, width: int | None = None) -> Table:
    """Return the vehicle table of `arena top`, one row per vehicle: mode, armed, battery, position, pose age ...

    first: number of the first row.
    count: number of rows.
    width: columns of the terminal, in which the most important values must fit; None for all values.
    """
    fleet, table = snapshot.fleet, _table()
    left_out = {name for narrow, names in _LEFT_OUT for name in names if width is not None and width < narrow}
    if all(kind == "simulated" for kind in fleet.kinds):
        left_out.add("kind")
    last = min(first + count, len(fleet.names))
    rows = [_vehicle_row(snapshot, i) for i in range(first, last)]
    for name in rows[0] if rows else ("vehicle",):
        if name not in left_out:
            table.add_column(name, no_wrap=True, justify="right" if name in _FIGURES else "left")
    for row in rows:
        table.add_row(*(value for name, value in row.items() if name not in left_out))
    if hidden := len(fleet.names) - len(rows):
        table.add_row(Text(f"{hidden} more", style="dim"))
    return table


def _vehicle_row(snapshot: Snapshot, i: int) -> dict[str, Text]:
    """Return one row of the vehicle table of `arena top`: column -> value, for vehicle number i."""
    fleet = snapshot.fleet
    north, east, down = (float(x) for x in fleet.p_n[i])
    forwarder = (p for p in snapshot.processes if p.kind == "forward" and p.vehicle == fleet.names[i])
    rates = next((p.rates for p in forwarder), {})
    return {
        "vehicle": Text(fleet.names[i]),
        "kind": Text(fleet.kinds[i]),
        "mode": _mode(fleet.modes[i], bool(fleet.silent_s[i] > SILENT_S)),
        "armed": _flag(fleet.armed[i]),
        "landed": _flag(fleet.landed[i]),
        "control": Text(fleet.controls[i]) if fleet.controls[i] else _UNKNOWN,
        "battery": _battery(float(fleet.battery[i])),
        "north": _figure(north, ".2f", "m"),
        "east": _figure(east, ".2f", "m"),
        "height": _figure(-down, ".2f", "m"),
        "speed": _figure(float(np.linalg.norm(fleet.v_n[i])), ".1f", "m/s"),
        "pose age": _age(float(fleet.pose_age_s[i]), OLD_POSE_S),
        "poses": _figure(next(iter(rates.values()), math.nan), ".0f", "Hz"),
        "message": _age(float(fleet.silent_s[i]), SILENT_S),
    }


def processes_table(processes: Sequence[ProcessRow], count: int) -> Table:
    """Return the process table of `arena top`: state, CPU, memory, restarts, and rates or the reason of the state."""
    table = _table()
    for name in ("process", "state"):
        table.add_column(name, no_wrap=True)
    for name in ("cpu %", "MB", "restarts"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True, overflow="ellipsis")
    for row in processes[:count]:
        calm = row.state in ("READY", "STARTING")
        rates = ", ".join(f"{name} {value:.0f} Hz" for name, value in list(row.rates.items())[:3])
        table.add_row(
            row.name,
            Text(row.state, style=_STATES.get(row.state, "yellow")),
            f"{100.0 * row.cpu:.0f}",
            f"{row.memory_mb:.0f}",
            Text(str(row.restarts), style="yellow") if row.restarts else "",
            rates if calm else row.reason,
        )
    if len(processes) > count:
        table.add_row(Text(f"{len(processes) - count} more", style="dim"))
    return table


def event_line(event: Event) -> Text:
    """Return one event as a line, such as `12.3 s  uav1: armed, OFFBOARD`."""
    time = f"{event.time_s:8.1f} s  " if event.time_s is not None else " " * 12
    text = Text(time, style="dim", no_wrap=True, overflow="ellipsis")
    text.append(f"{event.source}: ", style="not dim bold")
    text.append(event.text, style="not dim")
    return text


def _table() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold dim")


def _mode(mode: str, silent: bool) -> Text:
    if not mode:
        return _UNKNOWN
    return Text(mode, style="yellow" if silent else "cyan" if mode == "OFFBOARD" else "")


def _flag(value: bool | None) -> Text:
    return _UNKNOWN if value is None else Text("yes" if value else "no")


def _figure(value: float, form: str, unit: str) -> Text:
    return Text(f"{value:z{form}} {unit}") if math.isfinite(value) else _UNKNOWN


def _battery(percent: float) -> Text:
    text = _figure(percent, ".0f", "%")
    style = "bold red" if percent <= EMPTY_BATTERY else "yellow" if percent <= LOW_BATTERY else ""
    return Text(text.plain, style=style or text.style)


def _age(age_s: float, limit_s: float) -> Text:
    """Format an age in ms, or in s from 10 s.

    Ages above the limit are yellow. An unknown age is a dash.
    """
    if not math.isfinite(age_s):
        return _UNKNOWN
    text = f"{1e3 * age_s:.0f} ms" if age_s < 10.0 else f"{age_s:.0f} s"
    return Text(text, style="yellow" if age_s > limit_s else "")
