"""The work of `arena check`, and its plain command lines. This module does not import typer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arena.cli._arena import at_free_address, what_would_run

_MACHINE = {"--machine": True, "--no-machine": False}


@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Arguments of `arena check`.

    file: YAML file, or a folder with arena.yaml.
    overrides: `key=value` texts of `--set`.
    machine: whether this computer is checked, too.
    """

    file: Path = Path("arena.yaml")
    overrides: tuple[str, ...] = ()
    machine: bool = True


def plain_options(arguments: Sequence[str]) -> CheckOptions | None:
    """Return the options of a correct command line without `--help`, or None.

    For None, typer reads the command line: it prints the help or what is wrong. The import of typer and its validators take a
    tenth of the CPU time of `arena check`.

    arguments: what follows `check`.
    """
    files, overrides, machine = [], [], True
    rest = iter(arguments)
    for each in rest:
        if each in _MACHINE:
            machine = _MACHINE[each]
        elif each == "--set":
            overrides.append(next(rest, "-"))
        elif each.startswith("--set="):
            overrides.append(each.removeprefix("--set="))
        else:
            files.append(each)
    if len(files) > 1 or any(not each or each.startswith("-") for each in (*files, *overrides)):
        return None
    return CheckOptions(file=Path(*files or ["arena.yaml"]), overrides=tuple(overrides), machine=machine)


def check(given: CheckOptions) -> None:
    """Print `ok` and what would run. Raises InputError with every problem of the arena."""
    from arena.plan import make_plan
    from arena.plan.machine import check_machine
    from arena.schema import load_arena

    arena = load_arena(given.file, given.overrides)
    plan = make_plan(arena)
    if given.machine:
        arena, plan, moved = at_free_address(arena, plan, given.overrides)
        check_machine(arena, plan)
        if moved:
            print(moved)
    print(f"ok: {arena.name} ({arena.file})")
    for line in what_would_run(arena, plan):
        print(f"  {line}")
