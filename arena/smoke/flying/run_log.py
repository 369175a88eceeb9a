"""The log of a running arena, read while it grows: events.jsonl, the world's log, and the recorded processes
of state.json.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arena.supervisor import open_run
from arena.supervisor.run_folder import Member


class Tail:
    """A text file that grows. Only complete lines are read."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._rest = path, 0, b""

    def lines(self) -> list[str]:
        """Return the lines written since the last call."""
        try:
            if self._path.stat().st_size <= self._at:
                return []
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read()
        except OSError:
            return []
        self._at += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace") for line in whole]


class RunLog:
    """The log of one run folder.

    states: process -> READY, EXITED, ... as the supervisor last wrote.
    crashed: vehicle -> crash report.
    A supervisor that is dead or stopped writes nothing: then the recorded pids show which processes have
        ended, and the world's own log has the crashes.
    """

    def __init__(self, run: Path, processes: Iterator[str] | list[str]) -> None:
        self._run = run
        self.states = dict.fromkeys(processes, "STOPPED")
        self.crashed: dict[str, str] = {}
        self._events, self._world = Tail(run / "events.jsonl"), Tail(run / "logs" / "world.log")
        self._members: dict[str, Member] = {}

    def read(self) -> list[str]:
        """Return the events since the last call: `program.uav1: EXITED: exit 1`, `world: uav1 crashed:
        touched a wall at 3.2 s`.
        """
        events = [line for line in map(self._parse, self._events.lines()) if line]
        for line in self._world.lines():
            self._take_crash(line)
        return events

    @property
    def started(self) -> bool:
        """True when every process has been started, including those that have ended since."""
        return not any(state in ("STOPPED", "STARTING") for state in self.states.values())

    def member(self, process: str) -> Member | None:
        """Return the process's newest record; "supervisor" has one too. After the run the last known record
        is returned.
        """
        if (state := open_run(self._run)) is not None:
            self._members = {**self._members, **state.processes, "supervisor": state.supervisor}
        return self._members.get(process)

    def members(self) -> dict[str, Member]:
        """Return all recorded processes, alive or not."""
        self.member("")
        return dict(self._members)

    def update_without_supervisor(self) -> None:
        """Set the state EXITED for each process that has ended, when no supervisor does so."""
        members = self.members()
        for process, state in self.states.items():
            if state not in ("EXITED", "FATAL", "STOPPED") and not (
                process in members and members[process].alive
            ):
                self.states[process] = "EXITED"

    def _parse(self, line: str) -> str:
        try:
            entry: dict[str, Any] = json.loads(line)
            process = str(entry["process"])
        except (ValueError, KeyError, TypeError):
            return ""
        if "to" in entry:
            self.states[process] = str(entry["to"])
            return f"{process}: {entry['to']}: {entry.get('reason', '')}"
        text = str(entry.get("event", ""))
        if process == "world":
            self._take_crash(text)
        return f"{process}: {text}"

    def _take_crash(self, text: str) -> None:
        vehicle, crashed, how = text.partition(" crashed: ")
        if crashed and " " not in vehicle:
            self.crashed.setdefault(vehicle, how)
