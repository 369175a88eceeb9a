"""`arena params`: PX4's parameters of an arena's vehicles, made from the YAML, pushed, pulled, compared and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arena.cli._arena import File, Set
from arena.cli._params import (
    RECORD,
    YAML,
    Bars,
    Sides,
    begun,
    beside_the_question,
    chosen_of,
    count_of,
    file_of,
    line_of,
    print_rows,
    rebooted,
    refuse_beyond_limits,
    resumed,
    targets_of,
    told,
    version_for,
    writable,
)
from arena.errors import EXIT_FAILED

ArenaOption = Annotated[Path, typer.Option("--arena", metavar="FILE", help="the arena's YAML, or its folder")]
VersionOption = Annotated[
    str,
    typer.Option(
        "--px4-version",
        metavar="VERSION",
        help="1.9 to 1.18; by default what simulated vehicles fly, else 1.16",
    ),
]
Vehicles = Annotated[list[str] | None, typer.Argument(help="by default every vehicle of the arena")]


def register(app: typer.Typer) -> None:
    group = typer.Typer(
        no_args_is_help=True, help="PX4's parameters: made from the YAML, pushed, pulled, compared, checked."
    )
    for command in (generate, push, pull, diff, check):
        group.command()(command)
    app.add_typer(group, name="params")


def generate(
    file: File = Path("arena.yaml"),
    px4_version: VersionOption = "",
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIR", help="write a file per vehicle there")
    ] = None,
    set_: Set = None,
) -> None:
    """Make a QGroundControl .params file for every vehicle: what each line does, and which line of the YAML asked for it."""
    from arena.schema import load_arena

    arena = load_arena(file, set_ or [])
    for vehicle in arena.vehicles:
        text = file_of(arena, vehicle, px4_version)
        if out is None:
            print(text, end="")
            continue
        with writable(out):
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{vehicle.name}.params").write_text(text)
        print(out / f"{vehicle.name}.params")


def push(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    file: Annotated[
        Path | None, typer.Option("--file", help="push this .params file instead of what the YAML asks for")
    ] = None,
    px4_version: VersionOption = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="read and compare, write nothing")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help=f"go on with a push that was cut short ({RECORD})")
    ] = False,
    reboot: Annotated[
        bool, typer.Option("--reboot", help="reboot those that need it, without asking")
    ] = False,
    set_: Set = None,
) -> None:
    """Make vehicles hold what the YAML asks for: reads first, writes what differs, reads back. Refuses while armed."""
    from arena.params.facts.parameter_table import parameters
    from arena.params.transfer.session import push as push_now
    from arena.schema import load_arena

    lab = load_arena(arena, set_ or [])
    chosen = chosen_of(lab, vehicles)
    record = resumed(lab, chosen, file) if resume else begun(lab, chosen, file, px4_version)
    chosen = [v for v in chosen if v.name in record.wanted]
    wanted = {v.name: record.wanted[v.name] for v in chosen}
    facts = {v.name: parameters(version_for(v, px4_version)) for v in chosen}
    refuse_beyond_limits(wanted, facts)
    needs_reboot = frozenset(name for each in facts.values() for name, fact in each.items() if fact.reboot)
    targets = targets_of(lab, chosen)
    with Bars(wanted) as bars, writable(record.path):
        reports = push_now(
            targets, wanted, dry_run=dry_run, record=record, reboot_names=needs_reboot, on_progress=bars.show
        )
    for name, report in reports.items():
        print("\n".join(told(name, report)))
    held = all(report.holds or (dry_run and report.ending == "done") for report in reports.values())
    if record.unfinished and not dry_run:
        print(f"cut short: arena params push --resume goes on with it ({record.path})")
    again = {
        name: targets[name]
        for name, report in reports.items()
        if report.needs_reboot and report.ending == "done"
    }
    held &= rebooted(again, asked=reboot)
    if not held:
        raise typer.Exit(EXIT_FAILED)


def pull(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="where a .params file per vehicle is written")
    ] = Path(),
    set_: Set = None,
) -> None:
    """Read every parameter of vehicles into .params files."""
    from arena.params.transfer.session import pull as pull_now
    from arena.schema import load_arena
    from arena.wire.qgc_params import format_params

    lab = load_arena(arena, set_ or [])
    chosen = chosen_of(lab, vehicles)
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with Bars([v.name for v in chosen]) as bars:
        found = pull_now(targets_of(lab, chosen), on_progress=bars.show)
    for v in chosen:
        pulled = found[v.name]
        if not pulled.whole:
            read = f"{len(pulled.values)} read, {len(pulled.missing)} missing"
            print(f"{v.name}: {pulled.why or pulled.ending}, {read}: nothing written")
            continue
        values = {name: value.value for name, value in sorted(pulled.values.items())}
        types = {name: value.kind for name, value in pulled.values.items()}
        path = out / f"{v.name}.params"
        header = [f"pulled from {v.name} by arena params pull", f"Version: {version_for(v, '')}"]
        with writable(path):
            path.write_text(format_params(values, v.id, header=header, types=types))
        print(f"{path}: {len(values)} parameters")
    if not all(found[v.name].whole for v in chosen):
        raise typer.Exit(EXIT_FAILED)


def diff(
    a: Annotated[
        str, typer.Argument(help="a vehicle, a .params file, a ULog, `yaml:VEHICLE`, or `defaults`")
    ],
    b: Annotated[str, typer.Argument(help="the same")],
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    all_: Annotated[bool, typer.Option("--all", help="calibrations and counters as well")] = False,
    set_: Set = None,
) -> None:
    """Compare two sets of parameters: vehicles, files, logs, the YAML's, the version's defaults. Exit code 1: they differ."""
    from arena.params.checks.diff import diff as differences

    sides = Sides(arena, set_ or [], px4_version)
    first, second = sides.read(a, b), sides.read(b, a)
    rows = differences(first.values, second.values, first.version, second.version, every=all_)
    rows = [row for row in rows if not beside_the_question(row, a, b)]
    print_rows(rows, a, b)
    if rows:
        raise typer.Exit(EXIT_FAILED)


def check(
    what: Annotated[
        list[str] | None, typer.Argument(help="vehicles, .params files, ULogs; by default the YAML's")
    ] = None,
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    set_: Set = None,
) -> None:
    """Look for what is dangerous or cannot work in a room with motion capture. Exit code 1: an error was found."""
    from arena.params.checks.check import check as findings_of

    sides = Sides(arena, set_ or [], px4_version)
    names = what or [f"{YAML}{v.name}" for v in sides.arena.vehicles]
    worst = False
    for name in names:
        source = sides.read(name, "")
        version = source.version or version_for(None, px4_version)
        found = findings_of(source.values, version, room=sides.room(name), types=source.types)
        worst |= any(f.severity == "error" for f in found)
        print(f"{name}: {count_of(found)}")
        print("".join(line_of(f) for f in found), end="")
    if worst:
        raise typer.Exit(EXIT_FAILED)
