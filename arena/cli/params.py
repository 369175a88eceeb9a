"""`arena params`: commands that generate, push, pull, compare and check the PX4 parameters of an arena's vehicles."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from arena.cli._options import File, Set
from arena.cli._params import (
    YAML,
    ParamSources,
    has_board,
    not_applicable,
    params_file_text,
    refuse_existing,
    selected_vehicles,
    split_arena,
    targets_of,
    version_for,
    writable,
)
from arena.cli._params_output import (
    ProgressBars,
    count_text,
    ending_text,
    measured_lines,
    print_differences,
    push_report_lines,
)
from arena.cli._params_push import (
    RECORD,
    completed_reboots,
    interrupted_record,
    new_record,
    only_push,
    refuse_beyond_limits,
)
from arena.cli._params_reboot import RebootsOfPush, reboot_vehicles
from arena.errors import EXIT_FAILED
from arena.whole_file import replace_file

ArenaOption = Annotated[Path, typer.Option("--arena", metavar="FILE", help="the arena's YAML, or its folder")]
VersionOption = Annotated[
    str,
    typer.Option(
        "--px4-version",
        metavar="VERSION",
        help="PX4 version whose parameter names are used, 1.9 to 1.18. Default: the vehicle's `px4_version`, else 1.16",
    ),
]
Vehicles = Annotated[
    list[str] | None, typer.Argument(help="names of vehicles. Default: every vehicle of the arena")
]


def register(app: typer.Typer) -> None:
    """Add the commands of `arena params` to the typer app."""
    group = typer.Typer(
        no_args_is_help=True, help="Generate, push, pull, compare and check the PX4 parameters of vehicles."
    )
    for command in (generate, measured, push, pull, diff, check):
        group.command()(command)
    app.add_typer(group, name="params")


def generate(
    file: File = Path("arena.yaml"),
    px4_version: VersionOption = "",
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", help="write one file per vehicle to this folder"),
    ] = None,
    set_: Set = None,
) -> None:
    """Print a QGroundControl .params file for every vehicle.

    Comments give the effect and the reason of each parameter.
    """
    from arena.schema import load_arena

    arena = load_arena(file, set_ or [])
    for vehicle in arena.vehicles:
        text = params_file_text(arena, vehicle, px4_version)
        if out is None:
            print(text, end="")
            continue
        with writable(out):
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{vehicle.name}.params").write_text(text)
        print(out / f"{vehicle.name}.params")


def measured(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    set_: Set = None,
) -> None:
    """Show which parameters of real vehicles were measured (when, how), and which nobody has set or measured."""
    from arena.plan.firmware import unmeasured
    from arena.schema import load_arena

    lab = load_arena(arena, set_ or [])
    real = [v for v in selected_vehicles(lab, vehicles) if not v.simulated]
    if not real:
        print(
            "no real vehicle, so no value needs to be measured: simulated vehicles use the values of their profile"
        )
    for vehicle in real:
        print("\n".join(measured_lines(vehicle, unmeasured(lab, vehicle, px4_version))))


def push(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    file: Annotated[
        Path | None,
        typer.Option(
            "--file", help="push this .params file instead of the parameters that the YAML requires"
        ),
    ] = None,
    px4_version: VersionOption = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="only read and compare; write nothing")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help=f"continue an interrupted push ({RECORD})")
    ] = False,
    reboot: Annotated[
        bool,
        typer.Option("--reboot", help="reboot the vehicles whose new values need a reboot, without asking"),
    ] = False,
    set_: Set = None,
) -> None:
    """Write the parameters that the YAML requires into the autopilots of vehicles.

    Reads all parameters, writes those that differ, and reads these again. Refuses armed vehicles. Refuses real vehicles whose PX4
    version differs from `px4_version`.
    After a reboot it finds real vehicles again, and reads all values again.
    Exit code 1 if a vehicle does not have all values, needs a reboot before they take effect, or is not found after the reboot.
    """
    from arena.params.facts.parameter_table import parameters
    from arena.params.transfer.session import push as push_now
    from arena.schema import load_arena
    from arena.schema.address_text import address_text

    lab = load_arena(arena, set_ or [])
    with nullcontext() if dry_run else only_push(Path(lab.folder)):
        chosen = selected_vehicles(lab, vehicles)
        record = (
            interrupted_record(lab, chosen, file, px4_version)
            if resume
            else new_record(lab, chosen, file, px4_version)
        )
        chosen = [v for v in chosen if v.name in record.wanted]
        wanted = {v.name: record.wanted[v.name] for v in chosen}
        versions = {
            v.name: record.vehicles[v.name].px4_version or version_for(v, px4_version) for v in chosen
        }
        tables = {name: parameters(version) for name, version in versions.items()}
        refuse_beyond_limits(wanted, tables)
        needs_reboot = frozenset(name for table in tables.values() for name, p in table.items() if p.reboot)
        real = {v.name: address_text(lab, v) for v in chosen if has_board(v)}
        reboots = RebootsOfPush(Path(lab.folder), real)
        if resume:
            reboots.add_completed(record, completed_reboots(lab, record, px4_version))
        targets = targets_of(lab, chosen)
        with ProgressBars(wanted) as bars, writable(record.path):
            reports = push_now(
                targets,
                wanted,
                dry_run=dry_run,
                record=record,
                reboot_names=needs_reboot,
                on_reboot_needed=reboots.before_write,
                on_progress=bars.show,
            )
        for name, report in reports.items():
            print("\n".join(push_report_lines(name, report, versions[name] if name in real else "")))
        held = all(report.holds or (dry_run and report.ending == "done") for report in reports.values())
        if record.unfinished and not dry_run:
            print(
                "The push was interrupted, or a vehicle has not acknowledged all values. "
                f"Continue it with `arena params push --resume` ({record.path})"
            )
        reports = reboots.after_push(reports, dry_run=dry_run)
        if not dry_run and not record.wanted:
            with writable(record.path):
                record.delete()
        held &= dry_run or reboot_vehicles(targets, reports, reboots, without_asking=reboot)
    if not held:
        raise typer.Exit(EXIT_FAILED)


def pull(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="folder for one .params file per vehicle")
    ] = Path(),
    force: Annotated[bool, typer.Option("--force", help="replace existing .params files")] = False,
    set_: Set = None,
) -> None:
    """Read all parameters of vehicles and save them as .params files.

    Refuses to replace an existing file, which may be the `params_file` of the YAML.
    """
    from arena.params.transfer.session import pull as pull_now
    from arena.schema import load_arena
    from arena.wire.qgc_params import format_params

    lab = load_arena(arena, set_ or [])
    chosen = selected_vehicles(lab, vehicles)
    paths = {v.name: out / f"{v.name}.params" for v in chosen}
    if not force:
        refuse_existing(paths.values())
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with ProgressBars([v.name for v in chosen]) as bars:
        found = pull_now(targets_of(lab, chosen), on_progress=bars.show)
    for v in chosen:
        pulled = found[v.name]
        if not pulled.complete:
            counts = f"{len(pulled.values)} read, {len(pulled.missing)} missing"
            print(f"{v.name}: {ending_text(pulled.ending, pulled.why)} ({counts}): no file written")
            continue
        values = {name: value.value for name, value in sorted(pulled.values.items())}
        types = {name: value.kind for name, value in pulled.values.items()}
        path = paths[v.name]
        header = [f"pulled from {v.name} by arena params pull", f"Version: {version_for(v, '')}"]
        with writable(path):
            replace_file(path, format_params(values, v.id, header=header, types=types))
        print(f"{path}: {len(values)} parameters saved")
    if not all(found[v.name].complete for v in chosen):
        raise typer.Exit(EXIT_FAILED)


def diff(
    a: Annotated[str, typer.Argument(help="a vehicle, a .params file, a ULog, `yaml:VEHICLE` or `defaults`")],
    b: Annotated[
        str,
        typer.Argument(
            help="set to compare with: a vehicle, a .params file, a ULog, `yaml:VEHICLE` or `defaults`"
        ),
    ],
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    all_: Annotated[bool, typer.Option("--all", help="also compare calibrations and counters")] = False,
    set_: Set = None,
) -> None:
    """Compare two sets of parameters, from vehicles, files, logs, the YAML or PX4's defaults.

    Exit code 1 if the sets differ.
    """
    from arena.params.checks.diff import diff as differences_of

    sources = ParamSources(arena, set_ or [], px4_version)
    first, second = sources.read(a, b), sources.read(b, a)
    rows = differences_of(first.values, second.values, first.version, second.version, include_excluded=all_)
    rows = [row for row in rows if not not_applicable(row, a, b)]
    print_differences(rows, a, b)
    if rows:
        raise typer.Exit(EXIT_FAILED)


def check(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            help="an arena's YAML or its folder, names of vehicles, .params files, ULogs. Default: every vehicle of the YAML"
        ),
    ] = None,
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    set_: Set = None,
) -> None:
    """Find parameters that are dangerous or cannot work in an indoor arena.

    Exit code 1 if there is an error.

    `arena params check arena.yaml` checks the parameters that the YAML requires of every vehicle.
    `arena params check arena.yaml uav1` reads the parameters from the vehicle uav1 and checks them.
    `arena params check tuned.params` checks a file.
    """
    from arena.params.checks.check import check as findings_of
    from arena.params.checks.check import finding_line

    yaml, names = split_arena(what or [], arena)
    sources = ParamSources(yaml, set_ or [], px4_version)
    failed = False
    for name in names or [f"{YAML}{v.name}" for v in sources.arena.vehicles]:
        source = sources.read(name, "")
        version = source.version or version_for(None, px4_version)
        found = findings_of(source.values, version, environment=sources.environment(name), types=source.types)
        failed |= any(f.severity == "error" for f in found)
        print(f"{name}: {count_text(found)}")
        for finding in found:
            print(f"  {finding_line(finding)}")
    if failed:
        raise typer.Exit(EXIT_FAILED)
