"""`arena params`: PX4's parameters of an arena's vehicles, made from the YAML, pushed, pulled, compared and checked."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arena.cli._arena import File, Set
from arena.errors import EXIT_FAILED, InputError

if TYPE_CHECKING:
    from arena.params.check import Finding, Room
    from arena.params.diff import Row
    from arena.params.record import Record
    from arena.params.session import Report, Target
    from arena.params.sources import Source
    from arena.params.table import Parameter
    from arena.schema import Arena, Vehicle
    from arena.supervise import RunState

ArenaOption = Annotated[Path, typer.Option("--arena", metavar="FILE", help="the arena's YAML, or its folder")]
VersionOption = Annotated[
    str, typer.Option("--px4-version", metavar="VERSION", help="1.9 to 1.18; by default what simulated vehicles fly, else 1.16")
]
Vehicles = Annotated[list[str] | None, typer.Argument(help="by default every vehicle of the arena")]
RECORD = "push.json"
_YAML, _DEFAULTS = "yaml:", "defaults"


def register(app: typer.Typer) -> None:
    group = typer.Typer(no_args_is_help=True, help="PX4's parameters: made from the YAML, pushed, pulled, compared, checked.")
    for command in (generate, push, pull, diff, check):
        group.command()(command)
    app.add_typer(group, name="params")


def generate(
    file: File = Path("arena.yaml"),
    px4_version: VersionOption = "",
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="DIR", help="write a file per vehicle there")] = None,
    set_: Set = None,
) -> None:
    """Make a QGroundControl .params file for every vehicle: what each line does, and which line of the YAML asked for it."""
    from arena.schema import load_arena

    arena = load_arena(file, set_ or [])
    for vehicle in arena.vehicles:
        text = _file(arena, vehicle, px4_version)
        if out is None:
            print(text, end="")
            continue
        with _writable(out):
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{vehicle.name}.params").write_text(text)
        print(out / f"{vehicle.name}.params")


def push(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    file: Annotated[Path | None, typer.Option("--file", help="push this .params file instead of what the YAML asks for")] = None,
    px4_version: VersionOption = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="read and compare, write nothing")] = False,
    resume: Annotated[bool, typer.Option("--resume", help=f"go on with a push that was cut short ({RECORD})")] = False,
    reboot: Annotated[bool, typer.Option("--reboot", help="reboot those that need it, without asking")] = False,
    set_: Set = None,
) -> None:
    """Make vehicles hold what the YAML asks for: reads first, writes what differs, reads back. Refuses while armed."""
    from arena.params.session import push as push_now
    from arena.params.table import parameters
    from arena.schema import load_arena

    lab = load_arena(arena, set_ or [])
    chosen = _chosen(lab, vehicles)
    record = _resumed(lab, chosen, file) if resume else _begun(lab, chosen, file, px4_version)
    chosen = [v for v in chosen if v.name in record.wanted]
    wanted = {v.name: record.wanted[v.name] for v in chosen}
    facts = {v.name: parameters(_version(lab, v, px4_version)) for v in chosen}
    _within_limits(wanted, facts)
    needs_reboot = frozenset(name for each in facts.values() for name, fact in each.items() if fact.reboot)
    targets = _targets(lab, chosen)
    with _Bars(wanted) as bars, _writable(record.path):
        reports = push_now(targets, wanted, dry_run=dry_run, record=record, reboot_names=needs_reboot, on_progress=bars.show)
    for name, report in reports.items():
        print("\n".join(_told(name, report)))
    held = all(report.holds or (dry_run and report.ending == "done") for report in reports.values())
    if record.unfinished and not dry_run:
        print(f"cut short: arena params push --resume goes on with it ({record.path})")
    again = {name: targets[name] for name, report in reports.items() if report.needs_reboot and report.ending == "done"}
    held &= _rebooted(again, asked=reboot)
    if not held:
        raise typer.Exit(EXIT_FAILED)


def pull(
    vehicles: Vehicles = None,
    arena: ArenaOption = Path("arena.yaml"),
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="where a .params file per vehicle is written")] = Path(),
    set_: Set = None,
) -> None:
    """Read every parameter of vehicles into .params files."""
    from arena.params.session import pull as pull_now
    from arena.schema import load_arena
    from arena.wire.qgcparams import format_params

    lab = load_arena(arena, set_ or [])
    chosen = _chosen(lab, vehicles)
    with _writable(out):
        out.mkdir(parents=True, exist_ok=True)
    with _Bars([v.name for v in chosen]) as bars:
        found = pull_now(_targets(lab, chosen), on_progress=bars.show)
    for v in chosen:
        pulled = found[v.name]
        if not pulled.whole:
            read = f"{len(pulled.values)} read, {len(pulled.missing)} missing"
            print(f"{v.name}: {pulled.why or pulled.ending}, {read}: nothing written")
            continue
        values = {name: value.value for name, value in sorted(pulled.values.items())}
        types = {name: value.kind for name, value in pulled.values.items()}
        path = out / f"{v.name}.params"
        header = [f"pulled from {v.name} by arena params pull", f"Version: {_version(lab, v, '')}"]
        with _writable(path):
            path.write_text(format_params(values, v.id, header=header, types=types))
        print(f"{path}: {len(values)} parameters")
    if not all(found[v.name].whole for v in chosen):
        raise typer.Exit(EXIT_FAILED)


def diff(
    a: Annotated[str, typer.Argument(help="a vehicle, a .params file, a ULog, `yaml:VEHICLE`, or `defaults`")],
    b: Annotated[str, typer.Argument(help="the same")],
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    all_: Annotated[bool, typer.Option("--all", help="calibrations and counters as well")] = False,
    set_: Set = None,
) -> None:
    """Compare two sets of parameters: vehicles, files, logs, the YAML's, the version's defaults. Exit code 1: they differ."""
    from arena.params.diff import diff as differences

    sides = _Sides(arena, set_ or [], px4_version)
    first, second = sides.read(a, b), sides.read(b, a)
    rows = differences(first.values, second.values, first.version, second.version, every=all_)
    rows = [row for row in rows if not _beside_the_question(row, a, b)]
    _print_rows(rows, a, b)
    if rows:
        raise typer.Exit(EXIT_FAILED)


def check(
    what: Annotated[list[str] | None, typer.Argument(help="vehicles, .params files, ULogs; by default the YAML's")] = None,
    arena: ArenaOption = Path("arena.yaml"),
    px4_version: VersionOption = "",
    set_: Set = None,
) -> None:
    """Look for what is dangerous or cannot work in a room with motion capture. Exit code 1: an error was found."""
    from arena.params.check import check as findings_of

    sides = _Sides(arena, set_ or [], px4_version)
    names = what or [f"{_YAML}{v.name}" for v in sides.arena.vehicles]
    worst = False
    for name in names:
        source = sides.read(name, "")
        found = findings_of(source.values, source.version or sides.version(None), room=sides.room(name), types=source.types)
        worst |= any(f.severity == "error" for f in found)
        print(f"{name}: {_count(found)}")
        print("".join(_finding(f) for f in found), end="")
    if worst:
        raise typer.Exit(EXIT_FAILED)


# -- what they share -------------------------------------------------------------------------------------------------------


def _beside_the_question(row: Row, a: str, b: str) -> bool:
    """What the YAML does not ask for, and defaults of what the other side does not have."""
    of_yaml = (row.a is None and a.startswith(_YAML)) or (row.b is None and b.startswith(_YAML))
    of_defaults = (row.a is None and b == _DEFAULTS) or (row.b is None and a == _DEFAULTS)
    return of_yaml or of_defaults


def _chosen(arena: Arena, names: Sequence[str] | None) -> list[Vehicle]:
    known = {v.name: v for v in arena.vehicles}
    for name in names or ():
        if name not in known:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] if names else list(arena.vehicles)


def _begun(arena: Arena, chosen: Sequence[Vehicle], file: Path | None, asked: str) -> Record:
    """A new push; one that was cut short is not forgotten for it. Raises InputError."""
    from arena.params.record import Record

    path = Path(arena.folder) / RECORD
    if path.exists() and Record.read(path).unfinished:
        raise InputError(f"{path}: a push was cut short. Go on with it by --resume, or remove the file and the old values in it")
    wanted = {v.name: _wanted(arena, v, file, asked) for v in chosen}
    return Record.begin(path, wanted, {v.name: _place(arena, v) for v in chosen})


def _resumed(arena: Arena, chosen: Sequence[Vehicle], file: Path | None) -> Record:
    """Raises InputError where there is none, or it is of other vehicles."""
    from arena.params.record import Record

    if file is not None:
        raise InputError("--resume goes on with the values that the record holds: leave --file out")
    record = Record.read(Path(arena.folder) / RECORD)
    if not any(v.name in record.wanted for v in chosen):
        raise InputError(f"{record.path}: the push that was cut short was of {', '.join(record.wanted)}")
    for v in chosen:
        if v.name in record.wanted and record.entries[v.name].at != _place(arena, v):
            raise InputError(f"{record.path}: is of {v.name} at {record.entries[v.name].at}; here it is at {_place(arena, v)}")
    return record


def _place(arena: Arena, v: Vehicle) -> str:
    return f"id {v.id}, {v.wire.words if v.wire and not v.simulated else f'simulated on {arena.address}'}"


def _rebooted(targets: Mapping[str, Target], *, asked: bool) -> bool:
    """Reboots those who need it, if it is wished. False when one refuses."""
    question = f"reboot {', '.join(targets)}, so that it takes effect?"
    if not targets or not (asked or (sys.stdin.isatty() and typer.confirm(question))):
        return True
    from arena.params.session import reboot as reboot_now

    became = reboot_now(targets)
    for name, why_not in became.items():
        print(f"{name}: {f'no reboot: {why_not}' if why_not else 'reboots'}")
    return not any(became.values())


@contextmanager
def _writable(path: Path) -> Iterator[None]:
    """What cannot be written is the user's to know, in a line."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename or path}: {error.strerror}") from error


def _version(arena: Arena, vehicle: Vehicle | None, asked: str) -> str:
    from arena.params.table import Version
    from arena.schema.resolve import SIMULATED_VERSION, version_of

    if asked:
        return str(Version.parse(asked))
    if vehicle is not None and vehicle.autopilot == "px4":
        return version_of(arena.px4)
    return SIMULATED_VERSION if vehicle is None else vehicle.px4_version


def _file(arena: Arena, vehicle: Vehicle, asked: str) -> str:
    from arena.params.generate import generate as make
    from arena.params.table import assumed, parameters
    from arena.wire.qgcparams import INT32, REAL32, format_params

    version = _version(arena, vehicle, asked)
    made, known = make(vehicle.needs, version), parameters(version)
    header = [f"{vehicle.name} of {arena.name} ({arena.file}), made by arena params generate", f"Version: {version}"]
    if assumed(version):
        header.append(f"no release of PX4 {version} was there to read: these are the names of its development")
    header += [f"NOT POSSIBLE: {words}" for words in made.cannot]
    comments = {line.name: f"{line.what}; {line.asked}" for line in made.lines}
    types = {name: INT32 if known[name].type == "INT32" else REAL32 for name in made.values if name in known}
    return format_params(made.values, vehicle.id, header=header, types=types, comments=comments)


def _wanted(arena: Arena, vehicle: Vehicle, file: Path | None, asked: str) -> dict[str, float]:
    if file is not None:
        from arena.params.sources import read_values

        return {name: value for name, value in read_values(file).values.items() if name != "MAV_SYS_ID"}
    from arena.params.generate import generate as make

    version = _version(arena, vehicle, asked)
    made = make(vehicle.needs, version)
    for words in made.cannot:
        print(f"{vehicle.name}: not possible: {words}")
    return dict(vehicle.params) if vehicle.autopilot == "builtin" and not asked else made.values


def _within_limits(wanted: Mapping[str, Mapping[str, float]], facts: Mapping[str, Mapping[str, Parameter]]) -> None:
    """PX4 takes any number over MAVLink. Raises InputError with each that its own table does not allow."""
    said = [
        f"  {vehicle}: {name}: got {value:g}, expected {expected}"
        for vehicle, values in wanted.items()
        for name, value in values.items()
        if name in facts[vehicle] and (expected := facts[vehicle][name].objection(value))
    ]
    if said:
        raise InputError("nothing is pushed:\n" + "\n".join(said))


def _targets(arena: Arena, vehicles: Sequence[Vehicle]) -> dict[str, Target]:
    """Through the router of the arena that is up, else straight to hardware."""
    from arena.params.session import Target
    from arena.supervise import active_runs

    run = next((state for state in active_runs() if state.live and state.address == arena.address), None)
    up = _same_vehicles(run, vehicles) if run else False
    found: dict[str, Target] = {}
    for v in vehicles:
        if up:
            found[v.name] = Target(system=v.id, remote=(arena.address, v.ports.tools))
        elif v.wire is None or v.simulated:
            raise InputError(f"{v.name} is simulated, and no arena is up on {arena.address}: start one with arena up")
        elif v.wire.kind == "serial":
            found[v.name] = Target(system=v.id, device=v.wire.device, baud=v.wire.baud)
        else:
            there = (v.wire.host, v.wire.port)
            found[v.name] = Target(system=v.id, local=there) if v.wire.kind == "udpin" else Target(system=v.id, remote=there)
    return found


def _same_vehicles(run: RunState, vehicles: Sequence[Vehicle]) -> bool:
    """True, and a line that says whose they are; raises InputError where that arena has others of these names."""
    from arena.supervise import plan_of

    plan = plan_of(run)
    there = {v.name: (v.id, v.simulated) for v in plan.vehicles} if plan else {}
    for v in vehicles:
        if there.get(v.name) != (v.id, v.simulated):
            raise InputError(f"the arena that is up on {run.address}, {run.name} ({run.run}), has no such {v.name}")
    print(f"through {run.name}, {run.run}", file=sys.stderr)
    return True


class _Sides:
    """What `diff` and `check` read. The arena is loaded when something asks for it."""

    def __init__(self, file: Path, sets: Sequence[str], version: str) -> None:
        self._file, self._sets, self._version = file, sets, version
        self._arena: Arena | None = None

    @property
    def arena(self) -> Arena:
        from arena.schema import load_arena

        self._arena = self._arena or load_arena(self._file, list(self._sets))
        return self._arena

    def version(self, vehicle: Vehicle | None) -> str:
        from arena.schema.resolve import SIMULATED_VERSION

        return _version(self.arena, vehicle, self._version) if vehicle else self._version or SIMULATED_VERSION

    def read(self, name: str, other: str) -> Source:
        from arena.params.generate import generate as make
        from arena.params.session import pull as pull_now
        from arena.params.sources import Source, read_values
        from arena.params.table import parameters

        if name == _DEFAULTS:
            told = self.read(other, "").version if other not in ("", _DEFAULTS) else ""
            version = self._version or told or self.version(None)
            facts = parameters(version)
            return Source(values={n: p.default for n, p in facts.items()}, types={}, version=version, origin=name)
        if name.startswith(_YAML):
            vehicle = _chosen(self.arena, [name.removeprefix(_YAML)])[0]
            version = self.version(vehicle)
            own = vehicle.autopilot == "builtin" and not self._version  # that one has no rotors among its parameters
            values = dict(vehicle.params) if own else make(vehicle.needs, version).values
            return Source(values=values, types={}, version=version, origin=name)
        if Path(name).is_file():
            return read_values(Path(name))
        if name not in (known := {v.name: v for v in self.arena.vehicles}):
            raise InputError(f"{name}: no such file, and no vehicle; there are {', '.join(known)}, yaml:VEHICLE and defaults")
        vehicle = known[name]
        pulled = pull_now(_targets(self.arena, [vehicle]))[name]
        if not pulled.whole:
            raise InputError(f"{name}: {pulled.why or pulled.ending}: its parameters could not be read whole")
        return Source(values={n: v.value for n, v in pulled.values.items()}, types={}, version=self.version(vehicle), origin=name)

    def room(self, name: str) -> Room:
        from arena.params.check import Room

        if not (self._file.is_file() or (self._file / "arena.yaml").is_file()):
            return Room()
        vehicle = next((v for v in self.arena.vehicles if v.name == name.removeprefix(_YAML)), self.arena.vehicles[0])
        needs = vehicle.needs
        return Room(
            vision=needs.vision_delay_ms is not None, gps=needs.gps, sticks=needs.sticks, latency_ms=needs.vision_delay_ms,
            height_m=needs.ceiling_m,
        )  # fmt: skip


class _Bars:
    """A progress bar per vehicle, where there is a terminal."""

    def __init__(self, names: Mapping[str, Any] | Sequence[str]) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[phase]}"))
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._tasks = {name: self._progress.add_task(name, total=None, phase="") for name in names}

    def __enter__(self) -> _Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    @property
    def show(self) -> Callable[[Mapping[str, Any]], None]:
        def update(progress: Mapping[str, Any]) -> None:
            for name, each in progress.items():
                self._progress.update(self._tasks[name], completed=each.n, total=each.of, phase=each.phase)

        return update


def _told(name: str, report: Report) -> list[str]:
    """What became of a push, for people."""
    counts = Counter(r.outcome for r in report.results.values())
    said = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)
    ending = "" if report.ending == "done" else f"{report.ending}{f': {report.why}' if report.why else ''}; "
    lines = [f"{name}: {ending}{said or 'nothing'}, {report.traffic.seconds:.1f} s"]
    for parameter, r in report.results.items():
        if r.outcome in ("same", "untried"):
            continue
        old = "?" if r.old is None else f"{r.old:g}"
        what = {"written": f"{old} -> {r.wanted:g}", "differs": f"holds {old}, wanted {r.wanted:g}",
                "refused": f"wanted {r.wanted:g}, it keeps {'?' if r.new is None else f'{r.new:g}'}",
                "unknown": "the vehicle has no such parameter",
                "lost": "no answer: it may or may not be set"}[r.outcome]  # fmt: skip
        lines.append(f"  {parameter}: {r.outcome}: {what}{f' ({r.why})' if r.why else ''}")
    if report.needs_reboot:
        lines.append(f"  {name} needs a reboot for {', '.join(report.needs_reboot)}")
    return lines


def _print_rows(rows: Sequence[Row], a: str, b: str) -> None:
    from rich.console import Console
    from rich.table import Table

    if not rows:
        print(f"{a} and {b}: no difference")
        return
    table = Table("name", a, b, "", box=None, pad_edge=False)
    for row in rows:
        table.add_row(row.name, *("-" if x is None else f"{x:.7g}" for x in (row.a, row.b)), row.note)
    Console().print(table)


def _count(found: Sequence[Finding]) -> str:
    counts = {s: sum(f.severity == s for f in found) for s in ("error", "warning", "note")}
    return ", ".join(f"{n} {severity}{'s' * (n != 1)}" for severity, n in counts.items() if n) or "nothing found"


def _finding(f: Finding) -> str:
    value = "" if f.value is None else f" = {f.value:g}"
    return f"  {f.severity}: {f.name}{value}: {f.what}. {f.why}. {f.fix}.\n".replace("..", ".")
