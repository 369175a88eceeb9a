"""Process that runs the user programs of a group of vehicles: `python -m arena.uav.group CONFIGURATION.json`."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path

from arena.process_context import ProcessContext, run_process
from arena.uav.group.programs import Group, end_report


def _make(context: ProcessContext) -> Callable[[], int]:
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)  # as in a program that has a process of its own
    program = str(context.settings["program"])
    sys.path[0], sys.argv = str(Path(program).parent), [program]

    def report(vehicle: str, code: int, why: str) -> None:
        context.send(end_report(vehicle, code, why, once=bool(context.settings["once"])))

    for member in context.settings["members"]:  # a restarted process clears what the last one reported
        context.send({"of": f"program.{member['vehicle']}", "stats": {"exit_code": None, "exit": None}})
    return Group(context.settings, report).run


if __name__ == "__main__":
    sys.exit(run_process("group", _make))
