"""The process `recorder`, which records an arena in flight.mcap: `python -m arena.recorder slice.json`."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable

from arena.errors import RunError
from arena.process_context import ProcessContext, run_and_close, run_process
from arena.recorder.shell import RecorderShell


def main() -> int:
    return run_process("recorder", _make)


def _make(process: ProcessContext) -> Callable[[], None]:
    try:
        shell = RecorderShell(process)
    except OSError as error:  # the file cannot be created
        raise RunError(str(error)) from error
    gc.freeze()  # modules and classes stay until the end: the garbage collector need not visit them again
    process.ready()
    return run_and_close(shell)


if __name__ == "__main__":
    sys.exit(main())
