"""Child process that was forked without `subprocess`, with the methods of `subprocess.Popen` that its users need."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess


class ForkedChild:
    """Child process that was started by fork, with methods as those of `subprocess.Popen`.

    pid: process id.  returncode: exit code as in `subprocess.Popen`, negative for a signal; None while it runs, or is not yet known.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._ended = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Return the exit code, or None while the process runs."""
        return self._collect(os.WNOHANG)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process and return the exit code. Raises subprocess.TimeoutExpired.

        timeout: longest wait [s]; None: no limit.
        """
        waits = self.returncode is None and timeout is not None
        if waits and not select.select([self._ended], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
        code = self._collect(0)
        assert code is not None
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to the process. Does nothing if it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM to the process."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL to the process."""
        self.send_signal(signal.SIGKILL)

    def _collect(self, options: int) -> int | None:
        if self.returncode is not None:
            return self.returncode
        try:
            pid, status = os.waitpid(self.pid, options)
        except ChildProcessError:  # something else waited for it
            pid, status = self.pid, 0
        if pid:
            self.returncode = os.waitstatus_to_exitcode(status)
            os.close(self._ended)
        return self.returncode
