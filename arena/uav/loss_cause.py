"""Finds the reason why a program lost control of its vehicle.

The vehicle left OFFBOARD or was disarmed.

The autopilot reports its own failsafes. Commands of other senders do not pass through the program, but the
run folder records the commands of the supervisor, of the copilot and of `arena land-all`, and who has control of the vehicle. If
no record fits, a pilot or a ground station sent the command.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_RECENT_S = 10.0
_LAST_LINES = 200
_PILOT = re.compile(r"\bpilot|stick|switch", re.IGNORECASE)
_CONTROL = re.compile(r"(pilot|land-all|ground station) has control: (.+)")
_FAILSAFE = re.compile(r"failsafe|terminat|lockdown|kill", re.IGNORECASE)
UNKNOWN = "a pilot, a ground station or another program commanded it"


def cause_of_loss(vehicle: str, texts: Sequence[str], run: Path | None, monotonic_s: float) -> str:
    """Return why the program lost control of the vehicle, as text. It begins for example with "a pilot".

    The text is appended to a message.

    texts: recent STATUSTEXT messages of the autopilot. run: the run folder, None without one.
    monotonic_s: monotonic wall time [s].
    """
    if recorded := _recorded(vehicle, run, monotonic_s):
        return recorded
    for text in reversed(texts):
        if _PILOT.search(text):
            return f"a pilot ({text})"
        if _FAILSAFE.search(text):
            return f"failsafe of the autopilot ({text})"
    return UNKNOWN


def _recorded(vehicle: str, run: Path | None, monotonic_s: float) -> str:
    if run is None:
        return ""
    by_hand = holder = ""
    for entry in reversed(_recent(run / "emergency.jsonl", monotonic_s)):
        if isinstance(names := entry.get("vehicles"), list) and vehicle in names:
            by_hand = f"arena {entry.get('command', 'land-all')} commanded it"
            break
    for entry in reversed(_recent(run / "events.jsonl", monotonic_s)):
        process, event = entry.get("process"), str(entry.get("event", ""))
        if process == "arena" and "landing, then stopping" in event:
            return f"the arena is stopping and lands its vehicles ({event.partition(':')[0]})"
        if process == "copilot" and event.startswith(f"{vehicle}:"):
            return f"the copilot commanded it ({event.removeprefix(f'{vehicle}: ')})"
        if not holder and (control := _CONTROL.fullmatch(event.removeprefix(f"{vehicle}: "))):
            who, why = control.groups()
            holder = f"{'arena land-all' if who == 'land-all' else f'a {who}'} has taken control ({why})"
    return by_hand or holder


def _recent(file: Path, monotonic_s: float) -> list[dict[str, Any]]:
    try:
        lines = file.read_text(errors="replace").splitlines()[-_LAST_LINES:]
    except OSError:
        return []
    return [entry for line in lines if (entry := _entry(line)) and _age(entry, monotonic_s) <= _RECENT_S]


def _entry(line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):  # the last line may be half written
        return {}
    return found if isinstance(found, dict) else {}


def _age(entry: dict[str, Any], monotonic_s: float) -> float:
    written = entry.get("mono")
    try:
        return monotonic_s - written if isinstance(written, int | float) else float("inf")
    except OverflowError:  # an integer that is too large for a float
        return float("inf")
