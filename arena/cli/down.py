"""`arena down`: land the vehicles and stop an arena, even if its supervisor is dead or paused (SIGSTOP)."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find
from arena.errors import EXIT_FAILED, EXIT_OK, RunError
from arena.supervisor import Control, RunState, sweep

_LONGEST_S = 600.0
_STOPPED_S = 3.0


def register(app: typer.Typer) -> None:
    """Add the command `arena down` to the typer app."""

    @app.command()
    def down(
        run: RunOption = None,
        now: Annotated[
            bool,
            typer.Option(
                "--now",
                help="do not land simulated vehicles; real vehicles that may be flying are always landed",
            ),
        ] = False,
    ) -> None:
        """Land the vehicles, then stop the arena. The exit code is the exit code of the run."""
        state = find(run, stale=True)
        if state.live and not _stays_stopped(state):
            code = _down(state, now)
            if code is not None:
                raise SystemExit(code)
        if state.live:
            print(
                f"the supervisor {state.supervisor.pid} is paused by SIGSTOP and does not reply: ending the arena without it",
                flush=True,
            )
        sweep(state, print, now=now)
        print(f"all processes of {state.run} have ended")


def _stays_stopped(state: RunState) -> bool:
    """Return whether the supervisor is paused (SIGSTOP) and stays paused for _STOPPED_S seconds."""
    deadline = time.monotonic() + _STOPPED_S
    while (stopped := state.stopped) and time.monotonic() < deadline:
        time.sleep(0.05)
    return stopped


def _down(state: RunState, now: bool) -> int | None:
    """Ask the supervisor to end the run, and return the exit code of the run.

    Returns None if the supervisor is paused by SIGSTOP.
    """
    control = connect(state)
    try:
        control.ask(do="subscribe")
        control.ask(do="down", now=now)
    except RunError:
        if _stays_stopped(state):
            return None
        raise
    _print_lines(control, state, time.monotonic() + _LONGEST_S)
    if _stays_stopped(state):
        return None
    while state.live:
        if not _wait_for_end(state):
            raise RunError(
                f"the supervisor {state.supervisor.pid} has not ended in time. {state.run}/events.jsonl shows its last events. "
                f"If it hangs, end it with `kill -9 {state.supervisor.pid}` and run `arena down --run {state.run}` again"
            )
    print(f"run folder: {state.run}")
    return _exit_code(Path(state.run))


def _print_lines(control: Control, state: RunState, deadline: float) -> None:
    """Print the log lines of a run until the run ends or its supervisor is paused (SIGSTOP).

    deadline: time [s] at which to return in any case.
    """
    while time.monotonic() < deadline:
        try:
            packet = control.listen(1.0)
        except TimeoutError:
            if _stays_stopped(state):
                return
            continue
        if packet is None:
            return
        if "say" in packet:
            print(packet["say"], flush=True)


def _wait_for_end(state: RunState, limit_s: float = 10.0) -> bool:
    deadline = time.monotonic() + limit_s
    while state.live and time.monotonic() < deadline:
        time.sleep(0.05)
    return not state.live


def _exit_code(folder: Path) -> int:
    try:
        return int(json.loads((folder / "outcome.json").read_text())["exit_code"])
    except (OSError, ValueError, KeyError):
        return EXIT_FAILED if not (folder / "outcome.json").exists() else EXIT_OK
