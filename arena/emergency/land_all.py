"""`python -m arena.emergency.land_all`, and the body of `arena land-all` and `arena kill-all`."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from arena.emergency.dispatch import bring_down
from arena.emergency.targets import Found, Target, choose, find
from arena.errors import EXIT_FAILED, EXIT_OK, ArenaError, InputError

LAND_TIMEOUT_S, KILL_TIMEOUT_S = 60.0, 10.0


def land_all(
    *,
    arena: Path | None = None,
    run: Path | None = None,
    only: Sequence[str] = (),
    spared: Sequence[str] = (),
    timeout_s: float = LAND_TIMEOUT_S,
) -> int:
    """Land everybody found, say a line for each; returns the exit code. Raises InputError when nobody is found."""
    found, targets = _chosen(arena, run, only, spared)
    if not targets:
        _say("no vehicle is left to land")
        return EXIT_OK
    _say(f"landing {', '.join(t.name for t in targets)} ({found.source})")
    return _worst(found, bring_down(targets, action="land", timeout_s=timeout_s, say=_say))


def kill_all(
    *,
    arena: Path | None = None,
    run: Path | None = None,
    only: Sequence[str] = (),
    spared: Sequence[str] = (),
    yes: bool = False,
    timeout_s: float = KILL_TIMEOUT_S,
) -> int:
    """Stop every motor, flying or not. Raises InputError without `yes`."""
    if not yes:
        raise InputError(
            "kill-all stops every motor, also in the air: vehicles fall. To mean it, give --yes; to land, land-all"
        )
    found, targets = _chosen(arena, run, only, spared)
    if not targets:
        _say("no vehicle is left to stop")
        return EXIT_OK
    _say(f"STOPPING THE MOTORS of {', '.join(t.name for t in targets)} ({found.source})")
    return _worst(found, bring_down(targets, action="kill", timeout_s=timeout_s, say=_say))


def _worst(found: Found, code: int) -> int:
    """Who is in a run that cannot be read was not commanded: said last, where it is seen."""
    for why in found.unread:
        _say(f"NOT COMMANDED, a run that is active but cannot be read: {why}")
    return code or (EXIT_FAILED if found.unread else EXIT_OK)


def names(text: str) -> tuple[str, ...]:
    """`a,b` -> ("a", "b")."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def command(verb: str, arguments: Sequence[str], prog: str = "arena") -> int:
    """One of the two command lines, without the packages of other verbs. Raises ArenaError, and SystemExit as argparse does."""
    parser = argparse.ArgumentParser(prog=f"{prog} {verb}".strip(), allow_abbrev=False)
    parser.add_argument(
        "arena", nargs="?", type=Path, help="arena.yaml; only its addresses are read, where no run is active"
    )
    parser.add_argument("--run", type=Path, metavar="DIR", help="the run folder")
    parser.add_argument("--only", type=names, default=(), metavar="A,B")
    parser.add_argument("--except", dest="spared", type=names, default=(), metavar="A,B")
    parser.add_argument(
        "--timeout", type=float, default=KILL_TIMEOUT_S if verb == "kill-all" else LAND_TIMEOUT_S, metavar="S"
    )
    if verb == "kill-all":
        parser.add_argument("--yes", action="store_true", help="needed: what flies will fall")
    a = parser.parse_args(arguments)
    whom = {"arena": a.arena, "run": a.run, "only": a.only, "spared": a.spared, "timeout_s": a.timeout}
    with _outliving_the_terminal():
        return kill_all(**whom, yes=a.yes) if verb == "kill-all" else land_all(**whom)


def _chosen(
    arena: Path | None, run: Path | None, only: Sequence[str], spared: Sequence[str]
) -> tuple[Found, tuple[Target, ...]]:
    found = find(arena=arena, run=run)
    return found, choose(found.targets, only, spared)


def _say(line: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # nobody reads any more: the landing goes on
        print(line, flush=True)


@contextlib.contextmanager
def _outliving_the_terminal() -> Iterator[None]:
    """A dropped ssh does not end a landing; Ctrl-C does."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


def main(argv: list[str] | None = None) -> int:
    try:
        return command("", sys.argv[1:] if argv is None else argv, prog="python -m arena.emergency.land_all")
    except ArenaError as error:
        print(f"land-all: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
