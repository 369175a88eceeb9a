"""`arena logs NAME`: print the log (stdout and stderr) of one process of a run."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections import deque
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._running import RunOption, find
from arena.cli.runs import last_run
from arena.errors import InputError, RunError
from arena.plan.model import Plan
from arena.supervisor import RunState, open_run

_LOOK_S = 0.1


def register(app: typer.Typer) -> None:
    """Add the command `arena logs` to the typer app."""

    @app.command()
    def logs(
        name: Annotated[str, typer.Argument(help="name of the process, as `arena ps` shows it")],
        follow: Annotated[
            bool, typer.Option("--follow", "-f", help="continue to print new lines until the run ends")
        ] = False,
        lines: Annotated[
            int, typer.Option("--lines", "-n", min=0, help="number of lines to print, from the end")
        ] = 50,
        run: RunOption = None,
    ) -> None:
        """Print the last lines of the log (stdout and stderr) of one process of a run."""
        folder = _folder(run)
        log = _log(folder, name)
        with log.open("rb") as file:
            for line in deque(file, maxlen=lines):
                _out(line)
            if follow:
                _follow(file.fileno(), log, folder)


def _folder(run: Path | None) -> Path:
    """Return the run folder with the logs: `run`, else the running arena, else the last run of the arena in this folder."""
    if run is not None:
        return last_run(run.resolve())
    try:
        return Path(find(None, stale=True).run)
    except RunError:
        ended = last_run(Path())
        if ended == Path():
            raise
        print(f"no arena is running; log of the last run in this folder, {ended}:", file=sys.stderr)
        return ended.resolve()


def _log(folder: Path, name: str) -> Path:
    log = folder / "logs" / f"{_process_of(folder, name)}.log"
    if "/" in name or not log.is_file():
        logged_processes = ", ".join(sorted(p.stem for p in folder.glob("logs/*.log"))) or "none yet"
        raise InputError(f"{folder}: no log of {name!r}; there are logs of: {logged_processes}")
    return log


def _process_of(folder: Path, name: str) -> str:
    """Return the name of the process in which a component runs, such as `world` for the router.

    A simulated arena can run its router, pose forwarders and recorder in the process `world`: `router` -> `world`.
    Programs can share a process `group.NAME`. The name of a process is returned unchanged.
    """
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        plan = Plan.from_json((folder / "plan.json").read_text())
        return next((p.name for p in plan.processes if any(m.name == name for m in p.members)), name)
    return name


def _follow(fd: int, log: Path, folder: Path) -> None:
    """Print new lines of a log until the run has ended.

    If the supervisor has shortened the log file, continue at the new end of the file.

    fd: the open log, at the position of the first new line.
    """
    while True:
        over = not _is_up(open_run(folder))
        if log.stat().st_size < os.lseek(fd, 0, os.SEEK_CUR):
            os.lseek(fd, 0, os.SEEK_END)
        while new := os.read(fd, 1 << 16):
            _out(new)
        if over:
            return
        time.sleep(_LOOK_S)


def _is_up(state: RunState | None) -> bool:
    return state is not None and (state.live or bool(state.survivors()))


def _out(data: bytes) -> None:
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()
