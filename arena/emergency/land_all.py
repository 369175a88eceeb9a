"""Commands `arena land-all` and `arena kill-all`; also runs as `python -m arena.emergency.land_all`."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from arena.background_writer import BackgroundWriter, write_to
from arena.constants import LAND_TIMEOUT_S
from arena.emergency.active_runs import active_runs, user_name
from arena.emergency.first_commands import send_first_commands
from arena.emergency.landing_sequence import Action
from arena.emergency.other_users import start_for_others
from arena.emergency.run_record import record_command
from arena.emergency.targets import Found, Target, choose, find, of_runs, untrusted_text
from arena.errors import EXIT_FAILED, EXIT_OK, ArenaError, InputError

KILL_TIMEOUT_S = 10.0
_OUTPUT, _RECORDS = BackgroundWriter("output", 10_000), BackgroundWriter("records", 1_000)
"""Threads that print and that record, because a frozen terminal or a disk that does not respond must not delay a landing."""
_FLUSH_S = 2.0
_NOT_RECORDED = "could not be recorded, so a program may arm a vehicle whose router was not ready"
_RESULT_S = 5.0  # a process for another user must end within this time after the timeout


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Vehicles that land-all or kill-all commands, as selected on the command line, and the time limit.

    arena, run: see `find`
    only, spared: names of vehicles to command or not to command
    timeout_s: [s]
    """

    arena: Path | None = None
    run: Path | None = None
    only: Sequence[str] = ()
    spared: Sequence[str] = ()
    timeout_s: float = LAND_TIMEOUT_S


def land_all(
    *,
    arena: Path | None = None,
    run: Path | None = None,
    only: Sequence[str] = (),
    spared: Sequence[str] = (),
    timeout_s: float = LAND_TIMEOUT_S,
) -> int:
    """Land all vehicles of the active runs or of the YAML. Print a line for each, and return the exit code.

    Raises InputError if no vehicle is found.
    """
    selection = Selection(arena=arena, run=run, only=only, spared=spared, timeout_s=timeout_s)
    return _command_all("land", selection)


def kill_all(
    *,
    arena: Path | None = None,
    run: Path | None = None,
    only: Sequence[str] = (),
    spared: Sequence[str] = (),
    yes: bool = False,
    timeout_s: float = KILL_TIMEOUT_S,
) -> int:
    """Stop the motors of all selected vehicles, even in flight. Return the exit code.

    Raises InputError without `yes`.
    """
    if not yes:
        raise InputError(
            "kill-all stops all motors, also in the air: vehicles fall. Confirm with --yes, or land with land-all"
        )
    selection = Selection(arena=arena, run=run, only=only, spared=spared, timeout_s=timeout_s)
    return _command_all("kill", selection)


def _command_all(action: Action, selection: Selection) -> int:
    """Land (or stop) the vehicles of this user's runs; as root, also the vehicles of other users."""
    others = []
    if selection.run is None:
        others = start_for_others(partial(_command_of_user, action, selection))

    def elsewhere() -> bool:
        return any([one.has_runs() for one in others])

    end = time.monotonic() + selection.timeout_s + _RESULT_S
    try:
        code = _command_own(action, selection, elsewhere)
    except InputError:
        if not elsewhere():
            raise
        code = EXIT_OK
    finally:
        codes = [one.wait(max(0.0, end - time.monotonic()), _say) for one in others]
        _flush()
    return code or next(filter(None, codes), EXIT_OK)


def _command_own(action: Action, selection: Selection, elsewhere: Callable[[], bool]) -> int:
    found = find(arena=selection.arena, run=selection.run, elsewhere=elsewhere)
    for replay in found.replays:
        _say(
            f"not commanded: {replay} is a replay. Its vehicles are recorded: they do not fly, and cannot land"
        )
    if found.replays and not found.source:
        return _report_unread(found, EXIT_OK)
    targets = choose(found.targets, selection.only, selection.spared)
    if not targets:
        if found.source:
            _say(f"no vehicle to {'land' if action == 'land' else 'stop'}")
        return _report_unread(found, EXIT_OK)
    return _command_found(action, selection, found, targets)


def _command_of_user(action: Action, selection: Selection, uid: int, report: Callable[[bool], None]) -> int:
    """Land (or stop) the vehicles of another user, in a process that has the rights of that other user.

    Return the exit code.
    """
    try:
        return _command_runs_of(action, selection, uid, report)
    finally:
        _flush()


def _command_runs_of(action: Action, selection: Selection, uid: int, report: Callable[[bool], None]) -> int:
    found = of_runs(active_runs(), selection.arena)
    names_found = {target.name for target in found.targets} if found is not None else set()
    only = [name for name in selection.only if name in names_found]
    selects = found is not None and bool(only or not selection.only)
    report(selects)
    if found is None or not selects:
        return EXIT_OK
    targets = choose(found.targets, only, [name for name in selection.spared if name in names_found])
    if not targets:
        return EXIT_OK
    found = replace(found, source=f"{found.source} of user {user_name(uid)}")
    return _command_found(action, selection, found, targets)


def _command_found(action: Action, selection: Selection, found: Found, targets: tuple[Target, ...]) -> int:
    at = time.monotonic()
    send_first_commands(targets, action)
    _record(f"{action}-all", targets, at)
    from arena.emergency.dispatch import bring_down  # imported late: loading it delays the first command

    what = "landing" if action == "land" else "STOPPING THE MOTORS of"
    _say(f"{what} {', '.join(t.name for t in targets)} (addresses from {found.source})")
    return _report_unread(found, bring_down(targets, action=action, timeout_s=selection.timeout_s, say=_say))


def _record(command: str, targets: Sequence[Target], at: float) -> None:
    """Record the command in the run folders. at: time before the first command, monotonic [s]."""
    for folder in {t.run_folder for t in targets if t.run_folder is not None}:
        names_in_run = [t.name for t in targets if t.run_folder == folder]
        _RECORDS.submit(partial(_write_record, folder, command, names_in_run, at))


def _write_record(folder: Path, command: str, names_in_run: Sequence[str], at: float) -> None:
    if why := record_command(folder, command, names_in_run, at):
        _say(f"{folder / 'emergency.jsonl'}: {command} {_NOT_RECORDED}: {why}")


def _flush() -> None:
    """Wait until everything is recorded and printed, but not for long."""
    if not _RECORDS.flush(_FLUSH_S):
        _say(f"the command {_NOT_RECORDED}: the disk of the run folder does not respond")
    _OUTPUT.flush(_FLUSH_S)


def _report_unread(found: Found, code: int) -> int:
    """Print a line for each active run whose files cannot or must not be read. Return the exit code of land-all or kill-all.

    code: exit code for the vehicles that were commanded. It is returned, except that EXIT_FAILED replaces 0 if the files of
        a run were not read.
    """
    for why in found.unread:
        _say(f"NOT COMMANDED: the vehicles of an active run whose files cannot be read: {why}")
    for folder in found.untrusted:
        _say(untrusted_text(folder))
    return code or (EXIT_FAILED if found.unread or found.untrusted else EXIT_OK)


def names(text: str) -> tuple[str, ...]:
    """Split a list of vehicle names that are separated by commas, such as `uav1,uav2`."""
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


def _say(line: str) -> None:
    """Print a line for the user without waiting for the terminal."""
    _OUTPUT.submit(partial(_print, line))


def _print(line: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # the terminal is gone: continue the landing
        write_to(sys.stdout, f"{line}\n")


@contextlib.contextmanager
def _ignoring_hangup() -> Iterator[None]:
    """Ignore SIGHUP, so that a dropped ssh session does not end a landing.

    Ctrl-C still ends the landing.
    """
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
