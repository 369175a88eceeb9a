"""What a run has written down of simulated vehicles that may never confirm a landing. Reads files: it needs nobody's health."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

_ENDED = ("EXITED", "FATAL")


def told_down(run: Path, vehicles: Iterable[str]) -> dict[str, str]:
    """Vehicle -> why it lies on the floor, of those named: it crashed, by the world's word, or its PX4 has ended."""
    found: dict[str, str] = {}
    names = set(vehicles)
    for event in _events(run / "events.jsonl"):
        process, words = str(event.get("process")), str(event.get("event", ""))
        name, crashed, reason = words.partition(" crashed: ")
        if process == "world" and crashed and name in names:
            found[name] = f"crashed: {reason}"
        vehicle = process.removeprefix("px4.")
        if vehicle != process and vehicle in names and "to" in event:
            _follow(found, vehicle, str(event["to"]), str(event.get("reason", "")))
    return found


def _follow(found: dict[str, str], vehicle: str, state: str, reason: str) -> None:
    """A state of its PX4's process. Started again, it is no longer down."""
    if state in _ENDED:
        found.setdefault(vehicle, f"its PX4 has ended: {reason}")
    elif state == "READY":
        found.pop(vehicle, None)


def _events(file: Path) -> Iterator[dict[str, Any]]:
    try:
        lines = file.read_text(errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        try:
            event = json.loads(line)
        except ValueError:  # the newest may be half written
            continue
        if isinstance(event, dict):
            yield event
