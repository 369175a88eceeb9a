"""`arena down`: land, then stop a running arena; or sweep what a dead supervisor left."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._running import RunOption, connect, find
from arena.errors import EXIT_FAILED, EXIT_OK, RunError
from arena.supervise import Control, RunState, sweep

_LONGEST_S = 600.0


def register(app: typer.Typer) -> None:
    @app.command()
    def down(
        run: RunOption = None,
        now: Annotated[bool, typer.Option("--now", help="kill programs at once; vehicles still land first")] = False,
    ) -> None:
        """Land the vehicles, then stop the arena. Exits as the run does."""
        state = find(run, stale=True)
        if not state.live:
            sweep(state, print)
            print(f"nothing is left of {state.run}")
            return
        raise SystemExit(_down(state, now))


def _down(state: RunState, now: bool) -> int:
    control = connect(state)
    control.ask(do="subscribe")
    control.ask(do="down", now=now)
    _tell(control, time.monotonic() + _LONGEST_S)
    while state.live:
        if not _wait_for_end(state):
            raise RunError(f"the supervisor {state.supervisor.pid} closed its line but still runs: see {state.run}")
    print(f"run folder: {state.run}")
    return _verdict(Path(state.run))


def _tell(control: Control, deadline: float) -> None:
    """Print what the supervisor says until it has ended."""
    while time.monotonic() < deadline:
        try:
            packet = control.listen(deadline - time.monotonic())
        except TimeoutError:
            return
        if packet is None:
            return
        if "say" in packet:
            print(packet["say"], flush=True)


def _wait_for_end(state: RunState, limit_s: float = 10.0) -> bool:
    deadline = time.monotonic() + limit_s
    while state.live and time.monotonic() < deadline:
        time.sleep(0.05)
    return not state.live


def _verdict(folder: Path) -> int:
    try:
        return int(json.loads((folder / "outcome.json").read_text())["exit_code"])
    except (OSError, ValueError, KeyError):
        return EXIT_FAILED if not (folder / "outcome.json").exists() else EXIT_OK
