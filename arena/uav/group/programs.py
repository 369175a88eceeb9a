"""Runs the user programs of a group of vehicles in this process.

The file is read and compiled once. With `run: each` it runs once for each vehicle, in a thread of its own, with its own
global variables; `UAV.from_args` returns the vehicle of the thread. With `run: once` it runs once, and `UAV.all_from_args`
returns all vehicles. The exit code is 1 if a program failed.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import CodeType
from typing import Any

from arena.errors import InputError
from arena.uav.group_clock import GroupThreads
from arena.uav.membership import MEMBERSHIP, Membership
from arena.uav.receiver import Receiver

Report = Callable[[str, int, str], None]


class Group:
    """User programs of a group of vehicles, which run in this process.

    The program runs once for all vehicles, or once per vehicle in a thread each.

    settings: JSON configuration of the process (slice).
    report: function that is called with vehicle, exit code and reason when a program has ended.
    """

    def __init__(self, settings: Mapping[str, Any], report: Report) -> None:
        self._name, self._file = str(settings["name"]), str(settings["program"])
        self._once = bool(settings["once"])
        self._argv = {str(m["vehicle"]): tuple(m["argv"]) for m in settings["members"]}
        self._report = report
        self._code = _compiled(self._file)
        self._threads, self._receiver = GroupThreads(settings["clock"], self._name), Receiver()
        self._codes: dict[str, int] = {}

    def run(self) -> int:
        """Run the user programs of the group until all have ended. Return the exit code of the process."""
        if self._once:
            self._run_program(self._argv)
        else:
            self._threads.run_all([partial(self._run_program, {v: a}) for v, a in self._argv.items()])
        failed = [vehicle for vehicle, code in self._codes.items() if code]
        if failed and not self._once:
            names, count = ", ".join(sorted(failed)), len(self._codes)
            print(f"{self._name}: {len(failed)} of {count} programs failed: {names}", file=sys.stderr)
        return 1 if failed else 0

    def _run_program(self, argv: dict[str, tuple[str, ...]]) -> None:
        """Run the user program for the vehicles in `argv`, close them and report its exit code. Never raises."""
        membership = Membership(
            argv=dict(argv), once=self._once, threads=self._threads, receiver=self._receiver
        )
        token = MEMBERSHIP.set(membership)
        code, why = 0, ""
        try:
            exec(self._code, {"__name__": "__main__", "__file__": self._file, "__builtins__": __builtins__})
        except SystemExit as end:
            code, why = _exit_of(end)
        except BaseException as error:
            code, why = 1, f"{type(error).__name__}: {error}"
            _print_failure(next(iter(argv)) if not self._once else self._name, error)
        finally:
            for uav in membership.opened:
                uav.close()
            MEMBERSHIP.reset(token)
        for vehicle in argv:
            self._codes[vehicle] = code
            self._report(vehicle, code, why)


def end_report(vehicle: str, code: int, why: str, *, once: bool) -> dict[str, Any]:
    """Return the packet that reports to the supervisor that the program of a vehicle has ended.

    once: one program flies all vehicles of the group. Then the report contains no event: the end of the process and the last line of
    its log say the same once, and not once per vehicle.
    """
    said = f"exit {code}" + (f" ({why})" if why else "")
    event = {} if once else {"event": f"EXITED: {said}"}
    return {"of": f"program.{vehicle}", **event, "stats": {"exit_code": code, "exit": said}}


def _compiled(file: str) -> CodeType:
    try:
        return compile(Path(file).read_bytes(), file, "exec", dont_inherit=True)
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{file}: {error}") from error


def _exit_of(end: SystemExit) -> tuple[int, str]:
    """Return the exit code and the message that a program has passed to `sys.exit`."""
    if end.code is None or isinstance(end.code, int):
        return int(end.code or 0), ""
    return 1, str(end.code)


def _print_failure(who: str, error: BaseException) -> None:
    """Print the traceback of a failed program. Each line begins with the name `who`.

    The first entry of the traceback is left out, because it shows this module and not the program.
    """
    trace = error.__traceback__.tb_next if error.__traceback__ is not None else None
    lines = "".join(traceback.format_exception(type(error), error, trace)).splitlines()
    print("\n".join(f"{who}: {line}" for line in lines), file=sys.stderr, flush=True)
