"""What a running arena writes down of itself, read as it grows: events.jsonl, and who is running by state.json."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arena.supervisor import open_run
from arena.supervisor.run_folder import Member


class Tail:
    """The lines of a file that have been written since the last look, whole ones only."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._rest = path, 0, b""

    def lines(self) -> list[str]:
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
    """Of one run folder. states: process -> READY, EXITED, ... as the supervisor last wrote; crashed: vehicle -> how.

    A supervisor that is dead or stopped writes nothing: then recorded pids tell who has gone, and the world's own log of crashes.
    """

    def __init__(self, run: Path, processes: Iterator[str] | list[str]) -> None:
        self._run = run
        self.states = dict.fromkeys(processes, "STOPPED")
        self.crashed: dict[str, str] = {}
        self._events, self._world = Tail(run / "events.jsonl"), Tail(run / "logs" / "world.log")
        self._members: dict[str, Member] = {}

    def read(self) -> list[str]:
        """What was told since the last call: `program.uav1: EXITED: exit 1`, `world: uav1 crashed: touched a wall at 3.2 s`."""
        told = [line for line in map(self._heed, self._events.lines()) if line]
        for line in self._world.lines():
            self._crash(line)
        return told

    @property
    def started(self) -> bool:
        """Everything has been started: it serves, or it has ended already."""
        return not any(state in ("STOPPED", "STARTING") for state in self.states.values())

    def member(self, process: str) -> Member | None:
        """Who it is now: the newest record, or the last that was seen where the run is over. "supervisor" is one too."""
        if (state := open_run(self._run)) is not None:
            self._members = {**self._members, **state.processes, "supervisor": state.supervisor}
        return self._members.get(process)

    def members(self) -> dict[str, Member]:
        """Everybody on record, alive or not."""
        self.member("")
        return dict(self._members)

    def look_who_is_left(self) -> None:
        """Without a supervisor: those that have gone have EXITED."""
        members = self.members()
        for process, state in self.states.items():
            if state not in ("EXITED", "FATAL", "STOPPED") and not (
                process in members and members[process].alive
            ):
                self.states[process] = "EXITED"

    def _heed(self, line: str) -> str:
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
            self._crash(text)
        return f"{process}: {text}"

    def _crash(self, text: str) -> None:
        vehicle, crashed, how = text.partition(" crashed: ")
        if crashed and " " not in vehicle:
            self.crashed.setdefault(vehicle, how)
