"""`python -m arena.safety.land_all`, and the body of `arena land-all`: every vehicle on the ground and disarmed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from arena.errors import EXIT_OK, ArenaError, InputError
from arena.safety.panic import bring_down
from arena.safety.targets import choose, find

TIMEOUT_S = 60.0


def land_all(
    *, arena: Path | None = None, run: Path | None = None, only: Sequence[str] = (), spared: Sequence[str] = (),
    timeout_s: float = TIMEOUT_S,
) -> int:
    """Land everybody found, say a line for each; returns the exit code. Raises InputError when nobody is found."""
    found = find(arena=arena, run=run)
    targets = choose(found.targets, only, spared)
    if not targets:
        print("no vehicle is left to land")
        return EXIT_OK
    print(f"landing {', '.join(t.name for t in targets)} ({found.source})", flush=True)
    return bring_down(targets, action="land", timeout_s=timeout_s, say=_say)


def kill_all(*, arena: Path | None = None, run: Path | None = None, yes: bool = False, timeout_s: float = 10.0) -> int:
    """Stop every motor, flying or not. Raises InputError without `yes`."""
    if not yes:
        raise InputError("kill-all stops every motor, also in the air: vehicles fall. To mean it, give --yes; to land, land-all")
    found = find(arena=arena, run=run)
    print(f"STOPPING THE MOTORS of {', '.join(t.name for t in found.targets)} ({found.source})", flush=True)
    return bring_down(found.targets, action="kill", timeout_s=timeout_s, say=_say)


def names(text: str) -> tuple[str, ...]:
    """`a,b` -> ("a", "b")."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _say(line: str) -> None:
    print(line, flush=True)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m arena.safety.land_all", description="Land every vehicle.")
    parser.add_argument("arena", nargs="?", type=Path, help="arena.yaml; only its addresses are read")
    parser.add_argument("--run", type=Path, help="the run folder")
    parser.add_argument("--only", type=names, default=(), metavar="A,B")
    parser.add_argument("--except", dest="spared", type=names, default=(), metavar="A,B")
    parser.add_argument("--timeout", type=float, default=TIMEOUT_S, metavar="S")
    a = parser.parse_args(argv)
    try:
        return land_all(arena=a.arena, run=a.run, only=a.only, spared=a.spared, timeout_s=a.timeout)
    except ArenaError as error:
        print(f"land-all: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
