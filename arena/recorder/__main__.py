"""The process `logger.<vehicle>`, which writes the log of one vehicle: `python -m arena.recorder slice.json`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.errors import RunError
from arena.process_context import ProcessContext, run_process
from arena.recorder.logger import Logger


def main() -> int:
    return run_process("logger", _make)


def _make(room: ProcessContext) -> Callable[[], None]:
    try:
        logger = Logger(room)
    except OSError as error:  # the log file cannot be created
        raise RunError(str(error)) from error

    def serve() -> None:
        room.ready()
        try:
            logger.run()
        except OSError as error:
            raise RunError(str(error)) from error
        finally:
            logger.close()

    return serve


if __name__ == "__main__":
    sys.exit(main())
