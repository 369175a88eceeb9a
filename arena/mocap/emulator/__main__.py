"""Process of the motion capture emulator: emulated cameras, their clock and a vendor's server.

Run as `python -m arena.mocap.emulator slice.json`.
"""

from __future__ import annotations

import select
import sys

from arena.clock import SimClock
from arena.errors import RunError
from arena.mocap.emulator.shell import EmulatorShell
from arena.process_context import ProcessContext, run_process

_POLL_MS = 250  # wall time between checks for a stop signal
_EARLY_S = 1e-6


def main() -> int:
    return run_process("mocap", lambda process: _EmulatorProcess(process).serve)


class _EmulatorProcess:
    def __init__(self, process: ProcessContext) -> None:
        self._process, self._clock = process, SimClock(process.settings["clock"], process.name)
        self._shell = EmulatorShell(process, self._clock.now())
        self._wake_at: float | None = None  # requested from the clock [s]; None: awake
        self._poll = select.poll()
        for fd in (self._clock.fileno(), self._shell.faults.fileno()):
            if fd >= 0:
                self._poll.register(fd, select.POLLIN)

    def serve(self) -> None:
        """Simulate the cameras and send their frames until a stop signal arrives or the simulation ends."""
        try:
            while not self._process.stopping:
                if (now := self._sleep_until(self._shell.due)) is not None:
                    self._shell.advance(now)
        except RunError:
            return  # the world has ended, so there is nothing left to measure
        finally:
            self._shell.close()

    def _sleep_until(self, due: float) -> float | None:
        """Sleep until simulation time `due` [s]. Return the time; None if the sleep ended early.

        The sleep ends after 250 ms of wall time, and when injected faults have arrived. Faults are applied at once, because
        simulation time may stand still while many faults are sent.
        """
        if self._wake_at != due:
            self._clock.request_wake(due)
            self._wake_at = due
        ready = [fd for fd, _ in self._poll.poll(_POLL_MS)]
        if self._shell.faults.fileno() in ready:
            self._shell.apply_faults()
            return None
        now = self._clock.wait_for_wake(0.0) if ready else None
        if now is not None:
            self._wake_at = None
        # an earlier time is the answer to an earlier request
        return now if now is not None and now >= due - _EARLY_S else None


if __name__ == "__main__":
    sys.exit(main())
