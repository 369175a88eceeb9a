"""events.jsonl: every transition with its reason, and what the children told. Also tells the terminal."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Protocol

_LONGEST = 2000
_PER_PROCESS = 2000


class Say(Protocol):
    """Where lines for the person go. Never raises: a dead terminal must not end a flight."""

    def __call__(self, text: str, /) -> None: ...


class Journal:
    """path: events.jsonl, appended to. A disk that is full costs events, not the flight: `lost` counts them."""

    def __init__(self, path: Path, say: Say) -> None:
        self._file = path.open("a", buffering=1)
        self._say = say
        self._told: Counter[str] = Counter()
        self.lost = 0

    def transition(self, mono: float, process: str, before: str, after: str, reason: str) -> None:
        """mono: monotonic time [s]."""
        self._write({"mono": mono, "process": process, "from": before, "to": after, "reason": reason})
        self._say(
            f"{process}: {after}: {reason}" if after != "STARTING" else f"{process}: starting: {reason}"
        )

    def event(self, mono: float, process: str, text: str, *, aloud: bool = True) -> None:
        """Something that happened to a process, or that it told; a chatterbox is cut off after some thousands."""
        self._told[process] += 1
        if self._told[process] > _PER_PROCESS:
            return
        more = " (its further events are dropped)" if self._told[process] == _PER_PROCESS else ""
        self._write({"mono": mono, "process": process, "event": text[:_LONGEST] + more})
        if aloud:
            self._say(f"{process}: {text[:_LONGEST]}{more}")

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, entry: dict[str, object]) -> None:
        entry = {"t": datetime.now().astimezone().isoformat(timespec="milliseconds"), **entry}
        try:
            self._file.write(json.dumps(entry) + "\n")
        except OSError:
            self.lost += 1
