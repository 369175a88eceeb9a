"""Reads which vehicles `arena land-all` and `arena kill-all` have commanded, from `emergency.jsonl` in the run folder.

A landing is latched by the processes that pass commands to a vehicle: world, router and link process. A process that was still
starting, or did not run, has not received the command. It gets the recorded landing from the supervisor instead. Otherwise a
program that starts after land-all could arm the vehicle.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arena.authority import Role
from arena.background_writer import BackgroundWriter
from arena.supervisor.process_set import ProcessSet
from arena.supervisor.process_state import State
from arena.supervisor.release import LANDING_RECORDED, guards

_READ_S = 0.2
_LATE_S = 1.0  # longest time between the first command of land-all and its record
_STRENGTH = {"land-all": 3, "kill-all": 4}  # as in `Authority.standing`


class LandingRecord:
    """Reader of the recorded landings of one run, which sends them to the processes that may have missed the command.

    folder: the run folder.
    released: vehicle -> time of its last successful `arena release`, monotonic [s]. Earlier landings are ignored.
    files: thread that reads the file, because a disk that does not respond must not stop the supervisor.
    """

    def __init__(
        self, folder: Path, processes: ProcessSet, released: Mapping[str, float], files: BackgroundWriter
    ) -> None:
        self._file = folder / "emergency.jsonl"
        self._processes, self._released, self._files = processes, released, files
        self._guards = guards(processes.plan)
        self._offset = 0
        self._next_read = float("-inf")
        self._found: deque[dict[str, Any]] = deque()

    def step(self, now: float) -> None:
        """Read new records while a process that passes commands is not ready, and handle what was read. now: monotonic [s]."""
        if now >= self._next_read and any(self._may_miss(name, now - 2.0 * _LATE_S) for name in self._guards):
            self._next_read = now + _READ_S
            self._files.submit(self._read, replaces=self._file.name)
        while self._found:
            self._take(self._found.popleft())

    def _may_miss(self, guard: str, at: float) -> bool:
        """Return whether a process may have missed a command, because it was not ready at the time `at`, monotonic [s]."""
        status = self._processes.statuses[guard]
        return status.state is not State.READY or status.since > at

    def _take(self, entry: Mapping[str, Any]) -> None:
        at, strength = float(entry["mono"]), _STRENGTH[entry["command"]]
        standing = {"latch": [int(Role.EMERGENCY), strength]}
        for vehicle in (v.name for v in self._processes.plan.vehicles if v.name in entry["vehicles"]):
            if at <= self._released.get(vehicle, float("-inf")):
                continue
            self._processes.last_facts[f"{vehicle}{LANDING_RECORDED}"] = standing
            late = [
                name for name in guards(self._processes.plan, vehicle) if self._may_miss(name, at - _LATE_S)
            ]
            self._processes.request({"do": "restore", "vehicle": vehicle, "standing": standing}, to=late)

    def _read(self) -> None:
        """Read the complete lines that were added to the file. Runs in the background thread."""
        try:
            with self._file.open("rb") as opened:
                opened.seek(self._offset)
                text = opened.read()
        except OSError:
            return
        whole = text[: text.rfind(b"\n") + 1]
        self._offset += len(whole)
        self._found.extend(filter(None, map(_entry, whole.splitlines())))


def _entry(line: bytes) -> dict[str, Any] | None:
    """Return a record of land-all or kill-all, or None if a line is none."""
    try:
        entry = json.loads(line)
        valid = isinstance(entry["mono"], int | float) and isinstance(entry["vehicles"], list)
        return entry if valid and entry["command"] in _STRENGTH else None
    except (ValueError, KeyError, TypeError):
        return None
