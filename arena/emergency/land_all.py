"""Commands `arena land-all` and `arena kill-all`; also runs as `python -m arena.emergency.land_all`."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from arena.emergency.dispatch import bring_down
from arena.emergency.run_record import record_command
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
    """Land all vehicles that are found, and print a line for each. Return the exit code. Raises InputError if
    there are none.
    """
    found, targets = _chosen(arena, run, only, spared)
    if not targets:
        _say("no vehicle to land")
        return EXIT_OK
    _say(f"landing {', '.join(t.name for t in targets)} (addresses from {found.source})")
    _record("land-all", targets)
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
    """Stop all motors, also in the air. Return the exit code. Raises InputError without `yes`."""
    if not yes:
        raise InputError(
            "kill-all stops all motors, also in the air: vehicles fall. Confirm with --yes, or land with land-all"
        )
    found, targets = _chosen(arena, run, only, spared)
    if not targets:
        _say("no vehicle to stop")
        return EXIT_OK
    _say(f"STOPPING THE MOTORS of {', '.join(t.name for t in targets)} (addresses from {found.source})")
    _record("kill-all", targets)
    return _worst(found, bring_down(targets, action="kill", timeout_s=timeout_s, say=_say))


def _record(command: str, targets: Sequence[Target]) -> None:
    for folder in {t.run for t in targets if t.run is not None}:
        record_command(folder, command, [t.name for t in targets if t.run == folder])


def _worst(found: Found, code: int) -> int:
    """Print each run whose vehicles could not be commanded. Return `code`, or EXIT_FAILED if `code` is 0 and there is such a run."""
    for why in found.unread:
        _say(f"NOT COMMANDED: the vehicles of an active run whose files cannot be read: {why}")
    return code or (EXIT_FAILED if found.unread else EXIT_OK)


def names(text: str) -> tuple[str, ...]:
    """Split a comma-separated list of vehicle names, such as `uav1,uav2`."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def command(verb: str, arguments: Sequence[str], prog: str = "arena") -> int:
    """Run land-all or kill-all from command-line arguments, without importing typer.

    Raises ArenaError, and SystemExit as argparse does.
    """
    parser = argparse.ArgumentParser(prog=f"{prog} {verb}".strip(), allow_abbrev=False)
    parser.add_argument("arena", nargs="?", type=Path, help="arena.yaml, read only when no run is active")
    parser.add_argument("--run", type=Path, metavar="DIR", help="the run folder")
    parser.add_argument("--only", type=names, default=(), metavar="A,B")
    parser.add_argument("--except", dest="spared", type=names, default=(), metavar="A,B")
    parser.add_argument(
        "--timeout", type=float, default=KILL_TIMEOUT_S if verb == "kill-all" else LAND_TIMEOUT_S, metavar="S"
    )
    if verb == "kill-all":
        parser.add_argument(
            "--yes", action="store_true", help="required: confirms that flying vehicles will fall"
        )
    a = parser.parse_args(arguments)
    selection = {"arena": a.arena, "run": a.run, "only": a.only, "spared": a.spared, "timeout_s": a.timeout}
    with _ignoring_hangup():
        return kill_all(**selection, yes=a.yes) if verb == "kill-all" else land_all(**selection)


def _chosen(
    arena: Path | None, run: Path | None, only: Sequence[str], spared: Sequence[str]
) -> tuple[Found, tuple[Target, ...]]:
    found = find(arena=arena, run=run)
    return found, choose(found.targets, only, spared)


def _say(line: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # the terminal is gone: continue the landing
        print(line, flush=True)


@contextlib.contextmanager
def _ignoring_hangup() -> Iterator[None]:
    """Ignore SIGHUP, so that a dropped ssh session does not end a landing. Ctrl-C still ends it."""
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
