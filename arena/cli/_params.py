"""Functions that the commands of `arena params` share.

They find the addresses of vehicles and read parameter sets.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from arena.cli._params_output import ending_text
from arena.errors import InputError

if TYPE_CHECKING:
    from arena.params.checks.diff import Difference
    from arena.params.checks.findings import Environment
    from arena.params.param_files import ParamSource
    from arena.params.transfer.transports import ParamTarget
    from arena.plan.firmware import Firmware
    from arena.schema import Arena, Vehicle
    from arena.supervisor import RunState

YAML, _DEFAULTS = "yaml:", "defaults"


def not_applicable(row: Difference, a: str, b: str) -> bool:
    """Return whether `arena params diff` omits a parameter that only one of the compared sets contains.

    In these cases it is normal that the other set does not contain it:

    - The set from the YAML has no value, because the YAML does not require every parameter.
    - Only PX4's defaults have a value, because they contain the parameters of all vehicles.
    """
    of_yaml = (row.a is None and a.startswith(YAML)) or (row.b is None and b.startswith(YAML))
    of_defaults = (row.a is None and b == _DEFAULTS) or (row.b is None and a == _DEFAULTS)
    return of_yaml or of_defaults


def selected_vehicles(arena: Arena, names: Sequence[str] | None) -> list[Vehicle]:
    """Return the vehicles with these names, or all vehicles if no name is given. Raises InputError for an unknown name."""
    known = {v.name: v for v in arena.vehicles}
    for name in names or ():
        if name not in known:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)] if names else list(arena.vehicles)


def has_board(v: Vehicle) -> bool:
    """Return whether the autopilot of a vehicle is a real flight controller. Its body may be simulated (HITL)."""
    return v.autopilot in ("hardware", "hitl")


def split_arena(what: Sequence[str], default: Path) -> tuple[Path, list[str]]:
    """Split the arguments of `arena params check` into the arena's YAML and the parameter sources to check.

    what: the arguments; at most one of them is a YAML file or a folder.
    default: YAML to use if none of the arguments is a YAML file or a folder.
    Raises InputError for more than one YAML file or folder.
    """
    arenas = [name for name in what if name.endswith((".yaml", ".yml")) or Path(name).is_dir()]
    if len(arenas) > 1:
        raise InputError(f"got {len(arenas)} YAML files or folders ({', '.join(arenas)}), expected one")
    return Path(arenas[0]) if arenas else default, [name for name in what if name not in arenas]


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Convert an OSError inside the `with` block to an InputError that names the file and the reason."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename or path}: {error.strerror}") from error


def refuse_existing(paths: Iterable[Path]) -> None:
    """Raise InputError if one of the files exists."""
    if existing := [str(path) for path in paths if path.exists()]:
        raise InputError(
            f"{', '.join(existing)}: the file exists, and nothing was read. Choose another folder with -o, or replace the file "
            "with --force"
        )


def version_for(vehicle: Vehicle | None, asked: str) -> str:
    """Return the PX4 version whose parameter names to use: `asked`, else the vehicle's `px4_version`, else 1.16."""
    from arena.plan.firmware import px4_version

    return px4_version(vehicle, asked)


def required_parameters(arena: Arena, vehicle: Vehicle, asked: str) -> Firmware:
    """Return the PX4 parameters that the YAML requires of a vehicle.

    asked: PX4 version given on the command line, or "".
    """
    from arena.plan.firmware import firmware

    return firmware(arena, vehicle, asked)


def params_file_text(arena: Arena, vehicle: Vehicle, asked: str) -> str:
    """Return the text of a QGroundControl .params file with the required parameters of a vehicle."""
    from arena.params.facts.parameter_table import is_unreleased, parameters
    from arena.params.generation.generate import generate as make
    from arena.plan.firmware import left_out_names, requirements, unmeasured
    from arena.wire.qgc_params import INT32, REAL32, format_params

    version = version_for(vehicle, asked)
    made, known = make(requirements(arena, vehicle), version), parameters(version)
    header = [
        f"{vehicle.name} of {arena.name} ({arena.file}), made by arena params generate",
        f"Version: {version}",
    ]
    if is_unreleased(version):
        header.append(
            f"PX4 {version} was not released when this table was made: the names are those of its development version"
        )
    header += [f"NOT POSSIBLE: {sentence}" for sentence in made.not_possible]
    if left_out := left_out_names(arena, vehicle):
        header.append(
            f"NOT USED, because they are calibrations of one vehicle or counters: {', '.join(left_out)}"
        )
    if made.replaced:
        header.append(
            f"NOT USED from params_file, because the YAML or a failsafe needs other values: {', '.join(made.replaced)}"
        )
    if kept := unmeasured(arena, vehicle, asked):
        header.append(f"NOT SET, because nobody has set or measured it: {', '.join(kept)}")
    comments = {line.name: f"{line.meaning}; {line.reason}" for line in made.lines}
    types = {name: INT32 if known[name].type == "INT32" else REAL32 for name in made.values if name in known}
    return format_params(made.values, vehicle.id, header=header, types=types, comments=comments)


def targets_of(arena: Arena, vehicles: Sequence[Vehicle]) -> dict[str, ParamTarget]:
    """Return {vehicle name: address}, with the address at which to read and write the vehicle's parameters.

    Vehicles of a running arena are reached through its MAVLink router, and the arena signs the messages if the vehicle has
    a key. Without a running arena, real vehicles are reached directly, with the signing key of the YAML.
    """
    from arena.params.transfer.transports import ParamTarget

    run = _run_of(arena)
    if run is not None:
        _check_run_has(run, vehicles)
        print(
            f"reaching the vehicles through the router of the running arena {run.name} ({run.run})",
            file=sys.stderr,
        )
    found: dict[str, ParamTarget] = {}
    for v in vehicles:
        if run is not None:
            uid = v.uid or _uid_of_run(run, v)
            found[v.name] = ParamTarget(system=v.id, remote=(run.address, v.ports.tools), uid=uid)
        elif v.wire is None or v.simulated:
            raise InputError(
                f"{v.name} is simulated, but no arena is running on {arena.address}. Start the arena with `arena up`"
            )
        elif v.wire.kind == "serial":
            at = ParamTarget(system=v.id, device=v.wire.device, baud=v.wire.baud)
            found[v.name] = replace(at, uid=v.uid, key_file=v.key_file)
        else:
            there = (v.wire.host, v.wire.port)
            here = v.wire.kind == "udpin"
            at = ParamTarget(system=v.id, local=there) if here else ParamTarget(system=v.id, remote=there)
            found[v.name] = replace(at, uid=v.uid, key_file=v.key_file)
    return found


def run_folder_of(arena: Arena) -> Path:
    """Return the run folder of the running arena of this YAML, or the current folder if no arena is running."""
    run = _run_of(arena)
    return Path(run.run) if run is not None else Path()


def _uid_of_run(run: RunState, v: Vehicle) -> str:
    """Return the hardware uid that the running arena has recorded for a real vehicle; "" if unknown."""
    if v.wire is None:
        return ""
    try:
        return str(json.loads((Path(run.run) / "wire" / f"{v.name}.json").read_text()).get("uid", ""))
    except (OSError, ValueError, AttributeError):
        return ""


def _run_of(arena: Arena) -> RunState | None:
    """Return the state of the running arena that belongs to this YAML, or None if no arena is running.

    If the YAML has an `address`, return the arena at this address. Else prefer the arena that was started
    from this YAML to the arena at the default address.
    Raises InputError if several arenas were started from this YAML.
    """
    from arena.supervisor.run_folder import active_runs, started_from

    runs = [state for state in active_runs() if state.live]
    if not arena.source.given(("address",)):
        started = [state for state in runs if started_from(state) == Path(arena.file).resolve()]
        if len(started) > 1:
            choices = " or ".join(f"--set address={state.address}" for state in started)
            raise InputError(
                f"{arena.file}: {len(started)} running arenas were started from this file. Choose one: {choices}"
            )
        if started:
            return started[0]
    return next((state for state in runs if state.address == arena.address), None)


def _check_run_has(run: RunState, vehicles: Sequence[Vehicle]) -> None:
    """Raise InputError if a vehicle has a different name, id or kind (simulated, real) in the running arena."""
    from arena.supervisor import plan_of

    plan = plan_of(run)
    there = {v.name: (v.id, v.simulated) for v in plan.vehicles} if plan else {}
    for v in vehicles:
        if there.get(v.name) != (v.id, v.simulated):
            raise InputError(
                f"{v.name}: the YAML has a {'simulated' if v.simulated else 'real'} vehicle {v.name} with id {v.id}, "
                f"but the arena {run.name} that runs on {run.address} ({run.run}) has none. "
                f"Use the YAML of the running arena, or end it with `arena down --run {run.run}`"
            )


class ParamSources:
    """Reader of the parameter sets that `arena params diff` and `check` compare.

    A set comes from a vehicle, a file, a log, the YAML, or PX4's defaults.

    file: path of the arena's YAML, which is loaded only when needed.
    sets: overrides of the YAML (`--set`).
    version: PX4 version to use instead of the vehicle's own; "" for the vehicle's own.
    """

    def __init__(self, file: Path, sets: Sequence[str], version: str) -> None:
        self._file, self._sets, self._version = file, sets, version
        self._arena: Arena | None = None

    @property
    def arena(self) -> Arena:
        """The arena that the YAML describes. Raises InputError if the YAML is wrong or missing."""
        from arena.schema import load_arena

        self._arena = self._arena or load_arena(self._file, list(self._sets))
        return self._arena

    def read(self, name: str, other: str) -> ParamSource:
        """Return the parameters of one source: a vehicle, a file, a log, the YAML, or PX4's defaults.

        name: the source as written on the command line.
        other: the source to compare with; `defaults` means the defaults of its PX4 version.
        Raises InputError for an unknown name, a wrong file, or a vehicle that cannot be read.
        """
        from arena.params.facts.parameter_table import defaults
        from arena.params.param_files import ParamSource, read_values
        from arena.params.transfer.session import pull as pull_now

        if name == _DEFAULTS:
            of_other = self.read(other, "").version if other not in ("", _DEFAULTS) else ""
            version = version_for(None, self._version or of_other)
            return ParamSource(values=defaults(version), types={}, version=version, origin=name)
        if name.startswith(YAML):
            vehicle = selected_vehicles(self.arena, [name.removeprefix(YAML)])[0]
            made = required_parameters(self.arena, vehicle, self._version)
            return ParamSource(
                values=made.values, types={}, version=version_for(vehicle, self._version), origin=name
            )
        if Path(name).is_file():
            return read_values(Path(name))
        if name not in (known := {v.name: v for v in self.arena.vehicles}):
            raise InputError(
                f"got {name!r}, expected a vehicle ({', '.join(known)}), whose parameters are then read, `yaml:VEHICLE` for the "
                "parameters that the YAML requires, `defaults` or a file"
            )
        vehicle = known[name]
        pulled = pull_now(targets_of(self.arena, [vehicle]))[name]
        if not pulled.complete:
            raise InputError(
                f"{name}: the parameters could not be read: {ending_text(pulled.ending, pulled.why)}"
            )
        values = {n: v.value for n, v in pulled.values.items()}
        return ParamSource(values=values, types={}, version=version_for(vehicle, self._version), origin=name)

    def environment(self, name: str) -> Environment:
        """Return the conditions in which a vehicle flies, such as GPS and room height, for the parameter check.

        name: the source as written on the command line. If no vehicle has this name (a file), the first vehicle is used.
        Without a YAML, the default `Environment` is returned.
        """
        from arena.params.checks.findings import Environment
        from arena.plan.firmware import requirements

        if not (self._file.is_file() or (self._file / "arena.yaml").is_file()):
            return Environment()
        vehicle = next(
            (v for v in self.arena.vehicles if v.name == name.removeprefix(YAML)), self.arena.vehicles[0]
        )
        required = requirements(self.arena, vehicle)
        return Environment(
            vision=required.vision_delay_ms is not None,
            gps=required.gps,
            rc=required.sticks,
            joystick=required.joystick,
            latency_ms=required.vision_delay_ms if required.simulated else None,
            height_m=required.ceiling_m,
        )
