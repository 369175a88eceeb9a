"""The logger of one vehicle: `python -m arena.record slice.json`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.errors import RunError
from arena.record.logger import Logger
from arena.room import Room, run_room


def main() -> int:
    return run_room("logger", _make)


def _make(room: Room) -> Callable[[], None]:
    try:
        logger = Logger(room)
    except OSError as error:  # a folder or a disk that takes no file
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
