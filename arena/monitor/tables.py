"""Texts and HTML tables of the live page. Pure.

Every text from outside is escaped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from html import escape

from arena.live_view import Event, FleetSnapshot, ProcessRow, Snapshot
from arena.monitor.colours import BAD, DIM, GOOD, WARN, css, trail
from arena.monitor.commands import WORDS, Command

OLD_POSE_S = 0.2
LOW_BATTERY, EMPTY_BATTERY = 30.0, 15.0
SILENT_S = 3.0
MAX_EVENTS = 40
_STATES = {
    "READY": GOOD,
    "STARTING": WARN,
    "BACKOFF": WARN,
    "STOPPING": WARN,
    "FATAL": BAD,
    "EXITED": DIM,
    "STOPPED": DIM,
}
_VERDICTS = {"waiting": WARN, "confirmed": GOOD, "not confirmed": BAD}
_STYLE = "font-size:12px;line-height:1.5;font-variant-numeric:tabular-nums;padding:0 0.75em 0.5em"


def label(fleet: FleetSnapshot, row: int) -> str:
    """Return the text beside a drawn vehicle: name, kind (such as real), mode, battery and pose age."""
    first = f"{fleet.names[row]} ({fleet.kinds[row]})"
    mode = fleet.modes[row] or "no heartbeat"
    figures = [mode if fleet.armed[row] is not False else f"{mode}, disarmed"]
    if math.isfinite(battery := fleet.battery[row]):
        figures.append(f"{battery:.0f} %")
    if math.isfinite(age := fleet.pose_age_s[row]) and age > OLD_POSE_S:
        figures.append(f"pose {age:.1f} s old")
    if math.isfinite(silent := fleet.silent_s[row]) and silent > SILENT_S:
        figures.append(f"silent for {silent:.0f} s")
    return f"{first}\n{', '.join(figures)}"


def status_html(snapshot: Snapshot | None, waiting_for: str) -> str:
    """Return the header of the page as HTML: arena, phase, time, real-time factor.

    Without an arena, the header contains the reason. snapshot: None without an arena.
    """
    if snapshot is None:
        return _block(
            f'<b>No arena</b><br><span style="color:{DIM}">{escape(waiting_for or "waiting for an arena")}</span>'
        )
    parts = [escape(snapshot.phase), f"{snapshot.time_s:.1f} s"]
    if snapshot.real_time_factor is not None:
        parts.append(f"real-time factor {snapshot.real_time_factor:.2f}")
    flying = sum(armed is True for armed in snapshot.fleet.armed)
    parts.append(f"{flying} of {len(snapshot.fleet.names)} armed")
    text = f'<b style="font-size:15px">{escape(snapshot.name)}</b><br><span style="color:{DIM}">{", ".join(parts)}</span>'
    if not snapshot.answers:
        text += f'<br><b style="color:{BAD}">the supervisor does not reply</b>'
    return _block(text)


def _dot(row: int) -> str:
    """Return a dot in the colour of a vehicle's flown path, as HTML. row: index of the vehicle."""
    return f'<span style="color:{css(trail(row))}" title="colour of its flown path">&#9679;</span>'


def plots_html(name: str, row: int) -> str:
    """Return the heading of the plots as HTML: the name of the plotted vehicle. row: index of the vehicle."""
    return _block(f"{_dot(row)} <b>{escape(name)}</b>")


def vehicles_html(fleet: FleetSnapshot, *, most: int = 250) -> str:
    """Return the HTML table of vehicles: colour of the flown path, mode, height, battery and pose age.

    most: largest number of rows.
    """
    rows = [_vehicle_row(fleet, i) for i in range(min(len(fleet.names), most))]
    return _table(("vehicle", "mode", "height", "battery", "pose"), rows)


def _vehicle_row(fleet: FleetSnapshot, i: int) -> Sequence[str]:
    silent = fleet.silent_s[i] > SILENT_S
    mode = (
        _coloured(fleet.modes[i] or "no heartbeat", BAD if silent else "")
        if silent
        else escape(fleet.modes[i])
    )
    if fleet.armed[i] is False:
        mode = f'<span style="color:{DIM}">{mode}</span>'
    control = fleet.controls[i]
    if control not in ("", "-", "program", "nobody"):
        mode += f' <span style="color:{WARN}">{escape(control)}</span>'
    battery, age = fleet.battery[i], fleet.pose_age_s[i]
    colour = BAD if battery < EMPTY_BATTERY else WARN if battery < LOW_BATTERY else ""
    return (
        f"{_dot(i)} {escape(fleet.names[i])}",
        mode,
        _figure(-fleet.p_n[i, 2], ".2f", "m"),
        _coloured(_figure(battery, ".0f", "%"), colour),
        _coloured(_figure(1e3 * age, ".0f", "ms"), WARN if age > OLD_POSE_S else ""),
    )


def processes_html(processes: Iterable[ProcessRow]) -> str:
    """Return the HTML table of processes: state, CPU, memory and restarts."""
    rows = []
    for p in processes:
        if p.member_of:
            rows.append(
                (escape(p.name), f'<span style="color:{DIM}">in {escape(p.member_of)}</span>', "", "", "")
            )
            continue
        state = _coloured(p.state.lower(), _STATES.get(p.state, ""))
        restarts = str(p.restarts) if p.restarts else ""
        rows.append((escape(p.name), state, f"{100 * p.cpu:.0f}", f"{p.memory_mb:.0f}", restarts))
    return _table(("process", "state", "CPU %", "MB", "restarts"), rows)


def events_html(events: Sequence[Event], *, details: bool) -> str:
    """Return the HTML list of events, newest first.

    details: also show the events of every normal flight.
    """
    shown = [e for e in events if details or not e.detail][-MAX_EVENTS:]
    rows = [
        (
            f'<span style="color:{DIM}">{"" if e.time_s is None else f"{e.time_s:.1f} s"}</span>',
            f"<b>{escape(e.source)}</b> {escape(e.text)}",
        )
        for e in reversed(shown)
    ]
    return (
        _table(("time", "event"), rows, left=2)
        if rows
        else _block(f'<span style="color:{DIM}">no events yet</span>')
    )


def commands_html(commands: Sequence[Command], *, most: int = 3) -> str:
    """Return the HTML list of the newest emergency commands, with the result of each vehicle."""
    texts = []
    for command in commands[:most]:
        clock = time.strftime("%H:%M:%S", time.localtime(command.began))
        head = f'<span style="color:{DIM}">{clock}</span> <b>{WORDS[command.action]}</b>'
        lines = []
        for vehicle in command.vehicles:
            verdict, text = command.result(vehicle)
            colour = _VERDICTS[verdict]
            word = f"not confirmed: {text}" if verdict == "not confirmed" else text
            lines.append(f'<span style="color:{colour}">&#9679;</span> {escape(vehicle)}: {escape(word)}')
        texts.append("<br>".join([head, *lines]))
    return _block("<br>".join(texts)) if texts else ""


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 2) -> str:
    """Return an HTML table. left: number of left-aligned columns; the other columns are right-aligned."""
    sides = ["left" if k < left else "right" for k in range(len(head))]
    cell = 'style="text-align:{};padding:1px 0 1px 8px;font-weight:{};color:{}"'
    top = "".join(f"<th {cell.format(s, 500, DIM)}>{h}</th>" for h, s in zip(head, sides, strict=True))
    body = "".join(
        "<tr>"
        + "".join(f"<td {cell.format(s, 400, 'inherit')}>{c}</td>" for c, s in zip(row, sides, strict=True))
        + "</tr>"
        for row in rows
    )
    return _block(
        f'<table style="width:100%;border-collapse:collapse;margin-left:-8px"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'
    )


def _block(text: str) -> str:
    return f'<div style="{_STYLE}">{text}</div>'


def _coloured(text: str, colour: str) -> str:
    return f'<span style="color:{colour}">{escape(text)}</span>' if colour else escape(text)


def _figure(value: float, form: str, unit: str) -> str:
    return f"{value:{form}} {unit}" if math.isfinite(value) else "-"
