"""One task beside the plan's processes: the landing, the report. Its output is logged and shown line by line."""

from __future__ import annotations

import signal
from dataclasses import dataclass, field, replace

from arena.plan.model import ProcessSpec
from arena.supervisor import child_process
from arena.supervisor.child_process import Child
from arena.supervisor.event_log import Say
from arena.supervisor.process_state import Exit
from arena.supervisor.run_folder import RunFolder

STOPPED_S = 1.0
_SHOWN_PER_TURN = 1 << 16


@dataclass(kw_only=True)
class Task:
    """deadline: monotonic [s]; past it the group is killed, and so is one that a signal has stopped for STOPPED_S.

    say: where its output is shown.  expired: why it was killed, or "".
    """

    name: str
    child: Child
    deadline: float
    say: Say
    expired: str = ""
    _stopped_at: float | None = None
    _shown: int = 0
    _half: bytes = field(default=b"", repr=False)

    @classmethod
    def start(
        cls, spec: ProcessSpec, folder: RunFolder, timeout_s: float, now: float, say: Say
    ) -> Task | Exit:
        """now: monotonic [s]. Returns the Exit when it could not be started. It outlives the supervisor, as a landing must."""
        log = folder.log(spec.name)
        try:
            child = child_process.start(replace(folder.spec(spec), outlives=True), log, str(folder.path))
        except (OSError, ValueError) as error:
            return Exit(code=127, words=f"could not start: {error}", ran=False)
        shown = log.stat().st_size
        return cls(name=spec.name, child=child, deadline=now + timeout_s, say=say, _shown=shown)

    def poll(self, now: float) -> Exit | None:
        """Show what it has said; its Exit once it has ended."""
        exit = self.child.reap()
        self._show()
        if exit is not None:
            self.child.close()
            if self._half:
                self.say(f"{self.name}: {self._half.decode(errors='replace')}")
            return replace(exit, words=f"{self.expired}: {exit.words}") if self.expired else exit
        if not self.child.stopped:
            self._stopped_at = None
        elif self._stopped_at is None:
            self._stopped_at = now
        elif now - self._stopped_at >= STOPPED_S:
            self.stop(f"stopped by {self.child.stopped}")
        if now >= self.deadline:
            self.stop()
        return None

    def stop(self, why: str = "did not end in time") -> None:
        self.expired = self.expired or why
        self.child.signal(signal.SIGKILL)

    def _show(self) -> None:
        try:
            with self.child.log.open("rb") as file:
                file.seek(self._shown)
                new = file.read(_SHOWN_PER_TURN)
        except OSError:
            return
        self._shown += len(new)
        *lines, self._half = (self._half + new).split(b"\n")
        for line in lines:
            self.say(f"{self.name}: {line.decode(errors='replace')}")
