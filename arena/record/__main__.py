"""The logger of one vehicle: `python -m arena.record slice.json`."""

from __future__ import annotations

import sys

from arena.errors import ArenaError
from arena.record.logger import Logger
from arena.room import Room


def main() -> int:
    try:
        room = Room.enter()
        logger = Logger(room)
    except (ArenaError, OSError) as error:
        print(f"logger: {error}", file=sys.stderr)
        return error.exit_code if isinstance(error, ArenaError) else 1
    room.ready()
    try:
        logger.run()
    except OSError as error:
        print(f"logger: {error}", file=sys.stderr)
        return 1
    finally:
        logger.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
