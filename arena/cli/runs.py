"""`arena runs`: list the run folders of an arena with their results."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._summary import read_json
from arena.errors import EXIT_INTERRUPTED, EXIT_OK, InputError
from arena.supervisor import active_runs, open_run


def register(app: typer.Typer) -> None:
    """Add the command `arena runs` to the typer app."""

    @app.command()
    def runs(
        folder: Annotated[
            Path,
            typer.Argument(metavar="DIR", help="folder of an arena, or a folder that contains run folders"),
        ] = Path(),
    ) -> None:
        """List the run folders of an arena, oldest first, and every running arena."""
        from rich.console import Console
        from rich.table import Table

        found = run_folders(folder)
        found += [
            Path(s.run) for s in active_runs() if s.live and Path(s.run) not in map(Path.resolve, found)
        ]
        if not found:
            print(f"no run folders in {folder.resolve()}; `arena up` creates one")
            return
        table = Table("time", "arena", "result", "run folder", box=None, pad_edge=False)
        for run in found:
            table.add_row(*row(run))
        console = Console()
        console.width = console.width if console.is_terminal else 400
        console.print(table)


def run_folders(folder: Path) -> list[Path]:
    """Return the run folders in `folder/runs`, oldest first. Without `folder/runs`, search in `folder`."""
    inside = folder / "runs"
    candidates = (inside if inside.is_dir() else folder).glob("*/plan.json")
    return sorted((path.parent for path in candidates), key=lambda run: run.name)


def last_run(folder: Path) -> Path:
    """Return the newest run folder of an arena's folder. Return a run folder, or any other path, unchanged."""
    if (folder / "plan.json").is_file() or not (folder / "runs").is_dir():
        return folder
    found = run_folders(folder)
    if not found:
        raise InputError(f"{folder}: contains no run folders; `arena up` creates one")
    return found[-1]


def row(run: Path) -> tuple[str, str, str, str]:
    """Return the table row of one run folder: start time, name of the arena, result, path."""
    outcome, plan = read_json(run / "outcome.json"), read_json(run / "plan.json")
    began = str(outcome.get("start", ""))[:19].replace("T", " ") or _modified(run / "plan.json")
    return began, str(plan.get("name", "?")), _result(run, outcome), str(run)


def _result(run: Path, outcome: dict[str, object]) -> str:
    state = open_run(run.resolve())
    if state is not None:
        return "running" if state.live else f"its supervisor has died: clean up with arena down --run {run}"
    if not outcome:
        return "no outcome was recorded"
    if outcome["exit_code"] == EXIT_OK:
        return "succeeded"
    if outcome["exit_code"] == EXIT_INTERRUPTED:
        return "interrupted"
    failed = outcome["failed"]
    return f"failed: {failed[0]}" if isinstance(failed, list) and failed else "failed"


def _modified(path: Path) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(path.stat().st_mtime))
