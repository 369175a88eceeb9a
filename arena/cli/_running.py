"""Functions that find the running arena to which a command applies, and connect to its supervisor."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import Annotated

import typer

from arena.errors import InputError, RunError
from arena.supervisor import Control, RunState, active_runs, open_run

RunOption = Annotated[
    Path | None,
    typer.Option(
        "--run", metavar="DIR", help="run folder of the arena; needed only if several arenas are running"
    ),
]


def find(run: Path | None, *, stale: bool = False) -> RunState:
    """Return the state of the running arena that a command must use: the one of `--run`, or the only one.

    run: path of the run folder; None for the only running arena.
    stale: also accept a run whose supervisor has died.
    Raises InputError, with a list of the arenas, if several are running, and RunError if none is running.
    """
    if run is not None:
        state = open_run(run.resolve())
        if state is None:
            raise InputError(
                f"{run}: no arena is running from this folder. `arena runs` lists the run folders"
            )
        if not (state.live or stale):
            raise RunError(
                f"{run}: its supervisor has died. Use `arena down --run {run}` to land the vehicles and end the processes"
            )
        return state
    runs = active_runs()
    found = [state for state in runs if state.live or stale]
    if not found:
        for state in runs:
            if state.survivors():
                raise RunError(
                    f"the supervisor of {state.run} has died, and its processes still run. "
                    f"Land the vehicles and end the processes with `arena down --run {state.run}`"
                )
        raise RunError("no arena is running. Start one with `arena up`")
    if len(found) > 1:
        choices = "\n".join(f"  --run {state.run}   ({state.name} on {state.address})" for state in found)
        raise InputError(f"{len(found)} arenas are running; choose one:\n{choices}")
    return found[0]


def connect(state: RunState) -> Control:
    """Connect to the supervisor of a run. The supervisor is the process `arena up`."""
    return Control(Path(state.rt) / "control.sock")


def user_name() -> str:
    """Return the login name of the user who runs this command."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a container without this user id
        return "the operator"
