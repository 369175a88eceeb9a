"""`python -m arena.sim slice.json`: the world, and beside it the built-in autopilots of the vehicles it
holds.

The one place where the cores of two rooms meet.
"""

from __future__ import annotations

import sys

from arena.errors import ArenaError
from arena.sim.loop import MakePilots, serve


def main(argv: list[str] | None = None, make_pilots: MakePilots | None = None) -> int:
    """make_pilots: how to make the autopilots from the slice and the period [s]; the built-in ones unless
    told otherwise.
    """
    try:
        serve(make_pilots or _builtin(), argv)
    except ArenaError as error:
        print(f"arena world: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _builtin() -> MakePilots:
    from arena.autopilot import Autopilots

    return Autopilots


if __name__ == "__main__":
    sys.exit(main())
