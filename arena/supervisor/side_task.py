"""The land task and the report task: processes at the end of a run that are not in the plan."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from arena.plan.model import ProcessSpec
from arena.supervisor import child_process
from arena.supervisor.child_process import Child
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.process_state import Exit
from arena.supervisor.run_folder import RunFolder

STOPPED_S = 1.0
_BYTES_PER_POLL = 1 << 16


@dataclass(kw_only=True)
class SideTask:
    """Running land task or report task, which lands the vehicles or writes the report at the end of a run.

    It is killed at its deadline, or when it has been paused (SIGSTOP) for STOPPED_S.

    deadline: time at which its process group is killed, monotonic [s].
    on_line: function that is called with each line of its output.
    expired: why the task was killed, or "".
    """

    name: str
    child: Child
    deadline: float
    on_line: Callable[[str], None]
    expired: str = ""
    _stopped_at: float | None = None
    _shown: int = 0
    _half: bytes = field(default=b"", repr=False)

    @classmethod
    def start(
        cls,
        spec: ProcessSpec,
        folder: RunFolder,
        timeout_s: float,
        now: float,
        on_line: Callable[[str], None],
        forks: ForkClient | None = None,
    ) -> SideTask | Exit:
        """Start the land task or the report task. Return an Exit if the start fails.

        timeout_s: time after which the task is killed [s].
        now: monotonic [s].

        forks: client of the fork server; None: a new interpreter runs the task.
        The task continues if the supervisor dies, so that a landing is completed.
        """
        log = folder.log(spec.name)
        try:
            spec = replace(folder.spec(spec), outlives=True)
            child = child_process.start(spec, log, str(folder.path), forks)
        except (OSError, ValueError) as error:
            return Exit(code=127, text=f"could not start: {error}", ran=False)
        shown = _size(log)
        return cls(name=spec.name, child=child, deadline=now + timeout_s, on_line=on_line, _shown=shown)

    def poll(self, now: float) -> Exit | None:
        """Pass each new line of output to `on_line`. Return the exit status of the task, or None while it runs.

        now: monotonic [s].
        """
        exit = self.child.reap()
        self._pass_output_on()
        if exit is not None:
            self.child.close()
            if self._half:
                self.on_line(f"{self.name}: {self._half.decode(errors='replace')}")
            return replace(exit, text=f"{self.expired}: {exit.text}") if self.expired else exit
        if not self.child.stopped:
            self._stopped_at = None
        elif self._stopped_at is None:
            self._stopped_at = now
        elif now - self._stopped_at >= STOPPED_S:
            self.stop(f"paused by {self.child.stopped}")
        if now >= self.deadline:
            self.stop()
        return None

    def stop(self, why: str = "did not end in time") -> None:
        """Kill the processes of the land task or report task with SIGKILL.

        why: the reason, which `poll` reports with the exit status.
        """
        self.expired = self.expired or why
        self.child.signal(signal.SIGKILL)

    def _pass_output_on(self) -> None:
        try:
            with self.child.log.open("rb") as file:
                file.seek(self._shown)
                new = file.read(_BYTES_PER_POLL)
        except OSError:
            return
        self._shown += len(new)
        *lines, self._half = (self._half + new).split(b"\n")
        for line in lines:
            self.on_line(f"{self.name}: {line.decode(errors='replace')}")


def _size(log: Path) -> int:
    """Return the size of a log file [bytes], or 0 if it cannot be read."""
    try:
        return log.stat().st_size
    except OSError:
        return 0
