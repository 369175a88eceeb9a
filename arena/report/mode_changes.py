"""Causes of flight mode changes: the sender of the command, or the failsafe. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from arena.report.happening import Happening
from arena.report.run_data import Event, RunData

_COMMAND_S = 1.0  # a request counts as the cause of a change of mode at most so long before or after
_FAILSAFE_S = 2.0  # a failsafe counts as the cause of a change of mode at most so long after it
COMMANDED = ", commanded by "
"""Words between the modes and the sender of a commanded change of mode."""


def mode_text(before: str, after: str) -> str:
    """Return the report's text for a change of flight mode."""
    return f"mode {before} -> {after}"


def new_mode(h: Happening) -> str:
    """Return the new flight mode that an event of kind "mode" reports; "" for other events."""
    if h.kind != "mode" or not h.text.startswith("mode "):
        return ""
    return h.text.partition(" -> ")[2].partition(",")[0]


def with_causes(found: Sequence[Happening], run: RunData) -> list[Happening]:
    """Add the cause to each change of flight mode in a list of events.

    Events that report the same change again are left out.
    """
    made: list[Happening] = []
    repeated: set[int] = set()
    for h in found:
        made.append(_explained(h, found, run, repeated) if new_mode(h) else h)
    return [h for h, original in zip(made, found, strict=True) if id(original) not in repeated]


def _explained(h: Happening, found: Sequence[Happening], run: RunData, repeated: set[int]) -> Happening:
    near = [x for x in found if x.vehicles == h.vehicles and abs(x.at_s - h.at_s) <= _FAILSAFE_S]
    again = [x for x in near if "without a command" in x.text and x.text.endswith(new_mode(h))]
    failsafe = next((x for x in near if x.kind == "failsafe" and x.at_s <= h.at_s + _COMMAND_S), None)
    if failsafe is not None:
        repeated.update(id(x) for x in again)
        return replace(h, text=f"{h.text}, because of the failsafe")
    if who := _commander(h, run.events):
        return replace(h, level="good", text=f"{h.text}{COMMANDED}{who}")
    if again:
        repeated.update(id(x) for x in again)
        return replace(h, level="warn", text=f"{h.text}, without a command")
    return h


def _commander(h: Happening, events: Sequence[Event]) -> str:
    """Return the process that commanded a flight mode, such as `program.uav1`, or "" if none is recorded."""
    mode, name = new_mode(h), h.vehicles[0]
    for event in sorted(events, key=lambda e: abs(e.at_s - h.at_s) if math.isfinite(e.at_s) else math.inf):
        if not abs(event.at_s - h.at_s) <= _COMMAND_S:
            break
        a = event.audit
        if a.get("vehicle") == name and a.get("request") == f"mode {mode}" and not a.get("refused"):
            role = str(a.get("role"))
            return f"program.{name}" if role == "program" else role
    return ""
