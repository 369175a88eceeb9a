"""`arena plan`: prints the processes of an arena. With `--explain KEY`, prints where YAML values come from."""

from __future__ import annotations

import shlex
import sys
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._arena import what_would_run
from arena.cli._options import File, Set
from arena.errors import InputError

if TYPE_CHECKING:
    from arena.plan import Plan, ProcessSpec
    from arena.schema import Arena


COLUMNS = ("name", "needs", "ready", "ports", "command")


def register(app: typer.Typer) -> None:
    """Add the command `arena plan` to the typer app."""

    @app.command()
    def plan(
        file: File = Path("arena.yaml"),
        set_: Set = None,
        json: Annotated[bool, typer.Option("--json", help="print the whole plan as JSON")] = False,
        explain: Annotated[
            str,
            typer.Option(
                "--explain",
                metavar="KEY",
                help="print the value of a key, and of all keys below it, each with its source, such as arena.yaml:7",
            ),
        ] = "",
    ) -> None:
        """Print every process of an arena with its ports, its command and the processes that it needs.

        Starts nothing.
        """
        from arena.plan import make_plan
        from arena.schema import load_arena

        arena = load_arena(file, set_ or [])
        if explain:
            print("\n".join(explained(arena, explain)))
            return
        made = make_plan(arena)
        print(made.to_json()) if json else _show(arena, made)


def explained(arena: Arena, key: str) -> list[str]:
    """Return the value of a YAML key, and of each key below it, as lines with the source of each value.

    A source is, for example, `arena.yaml:7`.

    Raises InputError, with the most similar key, if the key is unknown.
    """
    from arena.plan.firmware import origins as firmware_origins
    from arena.schema.source import near

    origins = {**arena.origins, **firmware_origins(arena)}
    found = {k: o for k, o in origins.items() if k == key or k.startswith((f"{key}.", f"{key}["))}
    if not found:
        raise InputError(f"--explain {key}: {arena.file} has no such key. {near(key, list(origins))}")
    return [f"{k} = {_text(o.value)} {_from(o.source)}" for k, o in found.items()]


def _text(value: object) -> str:
    return (
        dumps(value)
        if isinstance(value, (tuple, list, dict, str))
        else "none"
        if value is None
        else str(value)
    )


def _from(source: str) -> str:
    """Return the source of a YAML value as text: `from arena.yaml:7`, `from --set` or `(default)`."""
    return f"from {source}" if source == "--set" or source.rpartition(":")[2].isdigit() else f"({source})"


def _show(arena: Arena, made: Plan) -> None:
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{made.name} on {made.address}", box=SIMPLE, title_justify="left")
    for column in COLUMNS:
        table.add_column(column, no_wrap=column in ("name", "ready"), overflow="fold")
    for spec in made.processes:
        table.add_row(*row(spec))
    console = Console() if sys.stdout.isatty() else Console(width=1000)
    console.print(table)
    for line in what_would_run(arena, made):
        print(line)


def row(spec: ProcessSpec) -> tuple[str, ...]:
    """Return one row of the table of processes: name, needs, readiness probe, ports and command."""
    ports = ", ".join(str(x.port) for x in spec.listens)
    return spec.name, ", ".join(spec.needs), spec.ready, ports, command(spec)


def command(spec: ProcessSpec) -> str:
    """Return the command line of a process as text, without the folder of the Python interpreter."""
    first = Path(spec.argv[0]).name
    return " ".join((first, *(arg if "{run}" in arg else shlex.quote(arg) for arg in spec.argv[1:])))
