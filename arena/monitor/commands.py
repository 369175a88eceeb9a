"""Emergency commands of the live page. Each command runs as a separate process.

The processes are `arena land-all`, `arena kill-all`, and `arena.monitor.hold`. A hung page cannot stop such a
process, and the process continues when the page ends.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

Action = Literal["hold", "land", "kill"]
Verdict = Literal["waiting", "confirmed", "not confirmed"]

MAX_COMMANDS = 20
WORDS: dict[Action, str] = {"hold": "HOLD", "land": "LAND", "kill": "KILL"}


@dataclass(kw_only=True)
class Command:
    """An emergency command (hold, land or kill) that a user has given on the live page.

    began: wall time [s].  lines: output of the process so far.  exit_code: None while the process runs.
    """

    action: Action
    vehicles: tuple[str, ...]
    began: float
    lines: list[str] = field(default_factory=list)
    exit_code: int | None = None

    def result(self, vehicle: str) -> tuple[Verdict, str]:
        """Return whether a vehicle has confirmed this command, and the last output line about this vehicle."""
        text = next((line for line in reversed(self.lines) if line.startswith(f"{vehicle}: ")), "")
        text = text.removeprefix(f"{vehicle}: ")
        if "NOT CONFIRMED" in text:
            return "not confirmed", text.removeprefix("NOT CONFIRMED: ")
        if text.startswith(_CONFIRMED[self.action]):
            return "confirmed", text
        if self.exit_code is None:
            return "waiting", text or "command sent"
        return "not confirmed", text or (self.lines[-1] if self.lines else f"exit code {self.exit_code}")


_CONFIRMED: dict[Action, tuple[str, ...]] = {
    "hold": ("holds its position",),
    "land": ("landed and disarmed after", "already on the ground"),
    "kill": ("motors stopped",),
}


def argv(action: Action, run: Path, vehicles: Sequence[str]) -> list[str]:
    """Return the command line of the process for an emergency command.

    run: run folder. vehicles: names of all vehicles to command.
    """
    if action == "hold":
        return [sys.executable, "-m", "arena.monitor.hold", "--run", str(run), *vehicles]
    chosen = ["--run", str(run), "--only", ",".join(vehicles)]
    if action == "land":
        return [sys.executable, "-m", "arena", "land-all", *chosen]
    return [sys.executable, "-m", "arena", "kill-all", *chosen, "--yes"]


class Commands:
    """List of the newest emergency commands of the live page.

    `give` starts the process of a command and returns at once.
    """

    def __init__(self) -> None:
        self._commands: deque[Command] = deque(maxlen=MAX_COMMANDS)
        self.changes = 0

    def give(self, action: Action, run: Path, vehicles: Sequence[str]) -> Command:
        """Start the process of an emergency command, and read its output in a thread.

        The process has a session of its own.
        """
        command = Command(action=action, vehicles=tuple(vehicles), began=time.time())
        self._commands.appendleft(command)
        self.changes += 1
        try:
            process = subprocess.Popen(
                argv(action, run, vehicles),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            command.lines.append(f"the command could not be started: {error}")
            command.exit_code = 1
            return command
        threading.Thread(target=self._read, args=(command, process), daemon=True).start()
        return command

    def newest(self) -> list[Command]:
        """Return the emergency commands, newest first."""
        return list(self._commands)

    def _read(self, command: Command, process: subprocess.Popen[str]) -> None:
        if process.stdout is not None:
            for line in process.stdout:
                command.lines.append(line.rstrip("\n"))
                self.changes += 1
        command.exit_code = process.wait()
        self.changes += 1
