"""Search for the arena that a command is about: the only one that is up, or the one named by `--run`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.errors import InputError, RunError
from arena.supervisor import Control, RunState, active_runs, open_run

RunOption = Annotated[
    Path | None, typer.Option("--run", metavar="DIR", help="the run folder, when several arenas are up")
]


def find(run: Path | None, *, stale: bool = False) -> RunState:
    """Return the run that is meant.

    run: the run folder, None for the only arena that is up.  stale: accept a run whose supervisor has died.
    Raises InputError that lists the arenas when several are up, RunError when none is.
    """
    if run is not None:
        state = open_run(run.resolve())
        if state is None:
            raise InputError(f"{run}: no arena is running from this folder")
        if not (state.live or stale):
            raise RunError(
                f"{run}: its supervisor has died; `arena down --run {run}` lands the vehicles and ends its processes"
            )
        return state
    found = [state for state in active_runs() if state.live or stale]
    if not found:
        raise RunError("no arena is up")
    if len(found) > 1:
        choices = "\n".join(f"  --run {state.run}   ({state.name} on {state.address})" for state in found)
        raise InputError(f"{len(found)} arenas are up; choose one:\n{choices}")
    return found[0]


def connect(state: RunState) -> Control:
    """Connect to the supervisor of a run."""
    return Control(Path(state.rt) / "control.sock")
