"""Worker process that flies one scenario or campaign flight and ends: `python -m arena.smoke.flying.worker`.

The fork server, a process that has already imported the packages, forks the worker.
The runner (`arena.smoke.flying.workers`) sends the task by the socket whose number is in CHANNEL_VARIABLE, and receives the result.
The worker has a fork server of its own, a copy of itself, which forks `arena up`.
"""

from __future__ import annotations

import os
import sys
from multiprocessing.connection import Connection

from arena.process_title import set_title
from arena.smoke.flying import arena_up
from arena.smoke.flying.workers import CHANNEL_VARIABLE, carry_out
from arena.supervisor.fork_client import ForkClient


def main() -> int:
    """Receive one task, such as a flight, carry it out and send the result to the runner. Return the exit code."""
    runner = os.getppid()
    with Connection(int(os.environ.pop(CHANNEL_VARIABLE))) as answer:
        set_title("arena:flight")
        task, work, cores = answer.recv()
        os.sched_setaffinity(0, cores)  # also of the fork server
        forks = ForkClient()  # its copy of this process leaves this function by an exception
        arena_up.use(forks)
        try:
            carry_out(answer, runner, task, work)
        finally:
            forks.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
