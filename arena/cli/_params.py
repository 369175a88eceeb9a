"""What the verbs of `arena params` share: whom they reach, what they compare, and saying what came of it."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from arena.errors import InputError

if TYPE_CHECKING:
    from arena.params.checks.check import Finding, Room
    from arena.params.checks.diff import Row
    from arena.params.facts.parameter_table import Parameter
    from arena.params.param_files import Source
    from arena.params.transfer.push_record import Record
    from arena.params.transfer.session import Report, Target
    from arena.plan.firmware import Firmware
    from arena.schema import Arena, Vehicle
    from arena.supervisor import RunState

RECORD = "push.json"
YAML, _DEFAULTS = "yaml:", "defaults"


def beside_the_question(row: Row, a: str, b: str) -> bool:
    """What the YAML does not ask for, and defaults of what the other side does not have."""
    of_yaml = (row.a is None and a.startswith(YAML)) or (row.b is None and b.startswith(YAML))
    of_defaults = (row.a is None and b == _DEFAULTS) or (row.b is None and a == _DEFAULTS)
    return of_yaml or of_defaults


def chosen_of(arena: Arena, names: Sequence[str] | None) -> list[Vehicle]:
    known = {v.name: v for v in arena.vehicles}
    for name in names or ():
        if name not in known:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] if names else list(arena.vehicles)


def begun(arena: Arena, chosen: Sequence[Vehicle], file: Path | None, asked: str) -> Record:
    """A new push; one that was cut short is not forgotten for it. Raises InputError."""
    from arena.params.transfer.push_record import Record

    path = Path(arena.folder) / RECORD
    if path.exists() and Record.read(path).unfinished:
        raise InputError(
            f"{path}: a push was cut short. Go on with it by --resume, or remove the file and the old values in it"
        )
    wanted = {v.name: _wanted(arena, v, file, asked) for v in chosen}
    return Record.begin(path, wanted, {v.name: place_of(arena, v) for v in chosen})


def resumed(arena: Arena, chosen: Sequence[Vehicle], file: Path | None) -> Record:
    """Raises InputError where there is none, or it is of other vehicles."""
    from arena.params.transfer.push_record import Record

    if file is not None:
        raise InputError("--resume goes on with the values that the record holds: leave --file out")
    record = Record.read(Path(arena.folder) / RECORD)
    if not any(v.name in record.wanted for v in chosen):
        raise InputError(f"{record.path}: the push that was cut short was of {', '.join(record.wanted)}")
    for v in chosen:
        if v.name in record.wanted and record.entries[v.name].at != place_of(arena, v):
            raise InputError(
                f"{record.path}: is of {v.name} at {record.entries[v.name].at}; here it is at {place_of(arena, v)}"
            )
    return record


def place_of(arena: Arena, v: Vehicle) -> str:
    """Return where a vehicle is reached, in the words that the record of a push keeps: files of earlier versions hold them."""
    if v.wire is None or v.simulated:
        return f"id {v.id}, simulated on {arena.address}"
    if v.wire.kind == "serial":
        return f"id {v.id}, serial {v.wire.device} at {v.wire.baud}"
    return f"id {v.id}, {v.wire}"


def rebooted(targets: Mapping[str, Target], *, asked: bool) -> bool:
    """Reboots those who need it, if it is wished. False when one refuses."""
    question = f"reboot {', '.join(targets)}, so that it takes effect?"
    if not targets or not (asked or (sys.stdin.isatty() and typer.confirm(question))):
        return True
    from arena.params.transfer.session import reboot as reboot_now

    became = reboot_now(targets)
    for name, why_not in became.items():
        print(f"{name}: {f'no reboot: {why_not}' if why_not else 'reboots'}")
    return not any(became.values())


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """What cannot be written is the user's to know, in a line."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename or path}: {error.strerror}") from error


def version_for(vehicle: Vehicle | None, asked: str) -> str:
    """Whose names: what is asked for, else the vehicle's, else what simulated vehicles keep."""
    from arena.plan.firmware import px4_version

    return px4_version(vehicle, asked)


def made_for(arena: Arena, vehicle: Vehicle, asked: str) -> Firmware:
    """Return what the YAML asks a vehicle to hold. `file_of` adds the rotor geometry of its profile."""
    from arena.plan.firmware import firmware

    return firmware(arena, vehicle, asked)


def file_of(arena: Arena, vehicle: Vehicle, asked: str) -> str:
    from arena.params.facts.parameter_table import assumed, parameters
    from arena.params.generation.generate import generate as make
    from arena.plan.firmware import requirements
    from arena.wire.qgc_params import INT32, REAL32, format_params

    version = version_for(vehicle, asked)
    made, known = make(requirements(arena, vehicle), version), parameters(version)
    header = [
        f"{vehicle.name} of {arena.name} ({arena.file}), made by arena params generate",
        f"Version: {version}",
    ]
    if assumed(version):
        header.append(
            f"no release of PX4 {version} was there to read: these are the names of its development"
        )
    header += [f"NOT POSSIBLE: {words}" for words in made.not_possible]
    comments = {line.name: f"{line.meaning}; {line.reason}" for line in made.lines}
    types = {name: INT32 if known[name].type == "INT32" else REAL32 for name in made.values if name in known}
    return format_params(made.values, vehicle.id, header=header, types=types, comments=comments)


def _wanted(arena: Arena, vehicle: Vehicle, file: Path | None, asked: str) -> dict[str, float]:
    if file is not None:
        from arena.params.param_files import read_values

        return {name: value for name, value in read_values(file).values.items() if name != "MAV_SYS_ID"}
    made = made_for(arena, vehicle, asked)
    for words in made.not_possible:
        print(f"{vehicle.name}: not possible: {words}")
    return made.values


def refuse_beyond_limits(
    wanted: Mapping[str, Mapping[str, float]], facts: Mapping[str, Mapping[str, Parameter]]
) -> None:
    """PX4 takes any number over MAVLink. Raises InputError with each that its own table does not allow."""
    said = [
        f"  {vehicle}: {name}: got {value:g}, expected {expected}"
        for vehicle, values in wanted.items()
        for name, value in values.items()
        if name in facts[vehicle] and (expected := facts[vehicle][name].objection(value))
    ]
    if said:
        raise InputError("nothing is pushed:\n" + "\n".join(said))


def targets_of(arena: Arena, vehicles: Sequence[Vehicle]) -> dict[str, Target]:
    """Through the router of the arena that is up, else straight to hardware."""
    from arena.params.transfer.session import Target
    from arena.supervisor import active_runs

    run = next((state for state in active_runs() if state.live and state.address == arena.address), None)
    up = _same_vehicles(run, vehicles) if run else False
    found: dict[str, Target] = {}
    for v in vehicles:
        if up:
            found[v.name] = Target(system=v.id, remote=(arena.address, v.ports.tools))
        elif v.wire is None or v.simulated:
            raise InputError(
                f"{v.name} is simulated, and no arena is up on {arena.address}: start one with arena up"
            )
        elif v.wire.kind == "serial":
            found[v.name] = Target(system=v.id, device=v.wire.device, baud=v.wire.baud)
        else:
            there = (v.wire.host, v.wire.port)
            found[v.name] = (
                Target(system=v.id, local=there)
                if v.wire.kind == "udpin"
                else Target(system=v.id, remote=there)
            )
    return found


def _same_vehicles(run: RunState, vehicles: Sequence[Vehicle]) -> bool:
    """True, and a line that says whose they are; raises InputError where that arena has others of these names."""
    from arena.supervisor import plan_of

    plan = plan_of(run)
    there = {v.name: (v.id, v.simulated) for v in plan.vehicles} if plan else {}
    for v in vehicles:
        if there.get(v.name) != (v.id, v.simulated):
            raise InputError(
                f"the arena that is up on {run.address}, {run.name} ({run.run}), has no such {v.name}"
            )
    print(f"through {run.name}, {run.run}", file=sys.stderr)
    return True


class Sides:
    """What `diff` and `check` read. The arena is loaded when something asks for it."""

    def __init__(self, file: Path, sets: Sequence[str], version: str) -> None:
        self._file, self._sets, self._version = file, sets, version
        self._arena: Arena | None = None

    @property
    def arena(self) -> Arena:
        from arena.schema import load_arena

        self._arena = self._arena or load_arena(self._file, list(self._sets))
        return self._arena

    def read(self, name: str, other: str) -> Source:
        from arena.params.facts.parameter_table import parameters
        from arena.params.param_files import Source, read_values
        from arena.params.transfer.session import pull as pull_now

        if name == _DEFAULTS:
            theirs = self.read(other, "").version if other not in ("", _DEFAULTS) else ""
            version = version_for(None, self._version or theirs)
            facts = parameters(version)
            return Source(
                values={n: p.default for n, p in facts.items()}, types={}, version=version, origin=name
            )
        if name.startswith(YAML):
            vehicle = chosen_of(self.arena, [name.removeprefix(YAML)])[0]
            made = made_for(self.arena, vehicle, self._version)
            return Source(
                values=made.values, types={}, version=version_for(vehicle, self._version), origin=name
            )
        if Path(name).is_file():
            return read_values(Path(name))
        if name not in (known := {v.name: v for v in self.arena.vehicles}):
            raise InputError(
                f"{name}: no such file, and no vehicle; there are {', '.join(known)}, yaml:VEHICLE and defaults"
            )
        vehicle = known[name]
        pulled = pull_now(targets_of(self.arena, [vehicle]))[name]
        if not pulled.whole:
            raise InputError(f"{name}: {pulled.why or pulled.ending}: its parameters could not be read whole")
        values = {n: v.value for n, v in pulled.values.items()}
        return Source(values=values, types={}, version=version_for(vehicle, self._version), origin=name)

    def room(self, name: str) -> Room:
        from arena.params.checks.check import Room
        from arena.plan.firmware import requirements

        if not (self._file.is_file() or (self._file / "arena.yaml").is_file()):
            return Room()
        vehicle = next(
            (v for v in self.arena.vehicles if v.name == name.removeprefix(YAML)), self.arena.vehicles[0]
        )
        needs = requirements(self.arena, vehicle)
        return Room(
            vision=needs.vision_delay_ms is not None,
            gps=needs.gps,
            sticks=needs.sticks,
            latency_ms=needs.vision_delay_ms,
            height_m=needs.ceiling_m,
        )


class Bars:
    """A progress bar per vehicle, where there is a terminal."""

    def __init__(self, names: Mapping[str, Any] | Sequence[str]) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[phase]}"),
        )
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._tasks = {name: self._progress.add_task(name, total=None, phase="") for name in names}

    def __enter__(self) -> Bars:
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


def told(name: str, report: Report) -> list[str]:
    """What became of a push, for people."""
    counts = Counter(r.outcome for r in report.results.values())
    said = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)
    ending = "" if report.ending == "done" else f"{report.ending}{f': {report.why}' if report.why else ''}; "
    lines = [f"{name}: {ending}{said or 'nothing'}, {report.traffic.seconds:.1f} s"]
    for parameter, r in report.results.items():
        if r.outcome in ("same", "untried"):
            continue
        old = "?" if r.old is None else f"{r.old:g}"
        what = {
            "written": f"{old} -> {r.wanted:g}",
            "differs": f"holds {old}, wanted {r.wanted:g}",
            "refused": f"wanted {r.wanted:g}, it keeps {'?' if r.new is None else f'{r.new:g}'}",
            "unknown": "the vehicle has no such parameter",
            "lost": "no answer: it may or may not be set",
        }[r.outcome]
        lines.append(f"  {parameter}: {r.outcome}: {what}{f' ({r.why})' if r.why else ''}")
    if report.needs_reboot:
        lines.append(f"  {name} needs a reboot for {', '.join(report.needs_reboot)}")
    return lines


def print_rows(rows: Sequence[Row], a: str, b: str) -> None:
    from rich.console import Console
    from rich.table import Table

    if not rows:
        print(f"{a} and {b}: no difference")
        return
    table = Table("name", a, b, "", box=None, pad_edge=False)
    for row in rows:
        table.add_row(row.name, *("-" if x is None else f"{x:.7g}" for x in (row.a, row.b)), row.note)
    Console().print(table)


def count_of(found: Sequence[Finding]) -> str:
    counts = {s: sum(f.severity == s for f in found) for s in ("error", "warning", "note")}
    return (
        ", ".join(f"{n} {severity}{'s' * (n != 1)}" for severity, n in counts.items() if n) or "nothing found"
    )


def line_of(f: Finding) -> str:
    value = "" if f.value is None else f" = {f.value:g}"
    return f"  {f.severity}: {f.name}{value}: {f.what}. {f.why}. {f.fix}.\n".replace("..", ".")
