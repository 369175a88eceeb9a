"""Functions of `arena params push`.

They choose the values to write, and keep the record of the push (the file from which an interrupted push can be resumed).
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from arena.cli._params import has_board, required_parameters, version_for, writable
from arena.errors import InputError

if TYPE_CHECKING:
    from arena.params.facts.parameter_table import Parameter
    from arena.params.transfer.push_record import PushRecord
    from arena.schema import Arena, Vehicle

RECORD, LOCK = "push.json", "push.lock"
_RESUME_OR_DELETE = (
    "Resume the push with that vehicle, or delete the file to begin a new push. The file contains the values from before "
    "the push"
)


def new_record(arena: Arena, chosen: Sequence[Vehicle], file: Path | None, version: str) -> PushRecord:
    """Create the record of a new parameter push, so that the push can be resumed after an interruption.

    Raises InputError if an earlier push is not complete.
    """
    from arena.params.transfer.push_record import PushRecord
    from arena.schema.address_text import address_text

    path = Path(arena.folder) / RECORD
    if path.exists() and PushRecord.read(path).unfinished:
        raise InputError(
            f"{path}: an earlier push was interrupted, or a vehicle has not acknowledged all of its values. "
            "Continue it with --resume, or delete this file. "
            "The file contains the values from before the push"
        )
    wanted = {v.name: _wanted(arena, v, file, version) for v in chosen}
    checked = [v for v in chosen if has_board(v) and file is None]
    return PushRecord.begin(
        path,
        wanted,
        {v.name: address_text(arena, v) for v in chosen},
        {v.name: version_for(v, version) for v in checked},
    )


def interrupted_record(
    arena: Arena, chosen: Sequence[Vehicle], file: Path | None, version: str
) -> PushRecord:
    """Return the record of an interrupted parameter push, for `arena params push --resume`.

    A record of an earlier `arena` has no PX4 versions: it gets those of the real vehicles.

    version: PX4 version given on the command line, or "".
    Raises InputError if there is no record, if the record has none of the chosen vehicles, or if a vehicle now has another
    address or hardware uid.
    """
    from arena.params.transfer.push_record import PushRecord
    from arena.schema.address_text import address_text

    if file is not None:
        raise InputError(
            "--resume continues the interrupted push with the values of that push, so --file cannot be used. Remove --file"
        )
    record = PushRecord.read(Path(arena.folder) / RECORD)
    if not any(v.name in record.wanted for v in chosen):
        raise InputError(
            f"{record.path}: the interrupted push has none of the chosen vehicles. Choose from {', '.join(record.wanted)}"
        )
    for v in chosen:
        if v.name in record.wanted and record.vehicles[v.name].at != address_text(arena, v):
            raise InputError(
                f"{record.path}: the interrupted push was to {v.name} at {record.vehicles[v.name].at}, "
                f"but this arena has {v.name} at {address_text(arena, v)}. "
                f"{_RESUME_OR_DELETE}"
            )
        if v.name in record.wanted and v.uid and record.vehicles[v.name].uid not in ("", v.uid):
            raise InputError(
                f"{record.path}: the interrupted push was to {v.name} with hardware uid {record.vehicles[v.name].uid}, "
                f"but this arena has {v.name} with hardware uid {v.uid}. "
                f"{_RESUME_OR_DELETE}"
            )
        entry = record.vehicles.get(v.name)
        if entry is not None and entry.px4_version is None:
            entry.px4_version = version_for(v, version) if has_board(v) else ""
    return record


def completed_reboots(arena: Arena, record: PushRecord, version: str) -> dict[str, list[str]]:
    """Return the written parameters that need a reboot, for the real vehicles to which the push of a record is complete.

    version: PX4 version given on the command line, or "".
    """
    from arena.params.facts.parameter_table import parameters

    found = {}
    for v in arena.vehicles:
        entry = record.vehicles.get(v.name)
        if entry is not None and entry.complete and has_board(v):
            table = parameters(entry.px4_version or version_for(v, version))
            found[v.name] = [name for name in entry.written if name in table and table[name].reboot]
    return found


def _wanted(arena: Arena, vehicle: Vehicle, file: Path | None, asked: str) -> dict[str, float]:
    """Return the values to write to a vehicle, from a file or from the YAML. Print what is left out."""
    from arena.params.checks.diff import exclusion_reason
    from arena.plan.firmware import left_out_names, replaced_text

    if file is not None:
        from arena.params.param_files import read_values

        read = read_values(file).values
        wanted = {name: value for name, value in read.items() if not exclusion_reason(name)}
        _print_left_out(vehicle, file, [name for name in read if name not in wanted])
        return wanted
    made = required_parameters(arena, vehicle, asked)
    for sentence in made.not_possible:
        print(f"{vehicle.name}: PX4 cannot meet a requirement of the YAML: {sentence}")
    if made.replaced:
        print(f"{vehicle.name}: {replaced_text(made.replaced)}")
    _print_left_out(vehicle, "params_file", left_out_names(arena, vehicle))
    return made.values


def _print_left_out(vehicle: Vehicle, file: Path | str, names: Sequence[str]) -> None:
    """Print how many parameters of a file are not written: calibrations of another vehicle, and values that PX4 changes itself."""
    names = [name for name in names if name != "MAV_SYS_ID"]
    if names:
        shown = f"{', '.join(names[:3])}{', ...' if len(names) > 3 else ''}"
        print(
            f"{vehicle.name}: {len(names)} parameters of {file} are left out, because they are calibrations "
            f"of one vehicle or counters: {shown}"
        )


def refuse_beyond_limits(
    wanted: Mapping[str, Mapping[str, float]], tables: Mapping[str, Mapping[str, Parameter]]
) -> None:
    """Raise InputError if a value is outside PX4's limits. PX4 itself would accept any number."""
    problems = [
        f"  {vehicle}: {name}: got {value:g}, expected {expected}"
        for vehicle, values in wanted.items()
        for name, value in values.items()
        if name in tables[vehicle] and (expected := tables[vehicle][name].expected_instead(value))
    ]
    if problems:
        raise InputError(
            "nothing was pushed, because these values are outside PX4's limits:\n" + "\n".join(problems)
        )


@contextmanager
def only_push(folder: Path) -> Iterator[None]:
    """Hold the lock of the pushes of one YAML during the `with` block, because two pushes would overwrite each other's record.

    The lock ends with this process. Raises InputError if another push runs.
    """
    with writable(folder):
        file = (folder / LOCK).open("a")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{folder}: another `arena params push` runs. Wait until it has ended") from None
        yield
