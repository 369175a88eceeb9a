"""Reader of a running arena's logs: events.jsonl, the log of the world, and state.json."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arena.supervisor import open_run
from arena.supervisor.run_folder import Member


class Tail:
    """Reader of a text file to which a second process appends. Only complete lines are read."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._rest = path, 0, b""

    def lines(self) -> list[str]:
        """Return the complete lines appended since the last call."""
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
    """Reader of the logs in one run folder.

    states: process -> READY, EXITED, ..., as the supervisor last wrote to events.jsonl.
    crashed: vehicle -> crash report.
    If the supervisor is dead or paused by SIGSTOP, it does not write events.jsonl. Then the pids in state.json show which processes
    have ended, and the crash reports come from the log of the world.
    """

    def __init__(self, run: Path, processes: Iterator[str] | list[str]) -> None:
        self._run = run
        self.states = dict.fromkeys(processes, "STOPPED")
        self.crashed: dict[str, str] = {}
        self._events, self._world = Tail(run / "events.jsonl"), Tail(run / "logs" / "world.log")
        self._members: dict[str, Member] = {}

    def read(self) -> list[str]:
        """Read the new log lines, and return their events as text.

        Updates `states` (process -> state) and `crashed` (vehicle -> crash report).

        Examples: `program.uav1: EXITED: exit 1`, `world: uav1 crashed: touched a wall at 3.2 s`.
        """
        events = [line for line in map(self._parse, self._events.lines()) if line]
        for line in self._world.lines():
            self._take_crash(line)
        return events

    @property
    def started(self) -> bool:
        """True if every process of the run has been started, even if it has already ended."""
        return not any(state in ("STOPPED", "STARTING") for state in self.states.values())

    def member(self, process: str) -> Member | None:
        """Return the newest entry of a process in state.json (such as its pid), or None without an entry.

        process: name, or "supervisor".

        After the run, when state.json is deleted, the last record that was read is returned.
        """
        if (state := open_run(self._run)) is not None:
            self._members = {**self._members, **state.processes, "supervisor": state.supervisor}
        return self._members.get(process)

    def members(self) -> dict[str, Member]:
        """Return process name -> newest entry in state.json, for running and ended processes."""
        self.member("")
        return dict(self._members)

    def update_without_supervisor(self) -> None:
        """Mark each ended process as EXITED. Call it if the supervisor is dead and cannot log the end itself."""
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
