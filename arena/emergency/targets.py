"""Search for the vehicles to land: in the plans of the active runs, else in the YAML.

Reads files only; needs no running process.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from arena.emergency.active_runs import ActiveRun, active_runs, active_runs_of_others
from arena.emergency.run_record import DirectAddress, valid_uid, with_run_record
from arena.emergency.yaml_fallback import VehicleEntry, read_yaml, vehicles_of
from arena.errors import InputError
from arena.run_dirs import untrusted_folders
from arena.transport import Address, url_from_json

_SOFTWARE = (
    "builtin",
    "px4",
)  # autopilots that run on this computer, unlike a flight controller in the loop (hitl)
_NO_REPLAY = '"replay": ""'  # in the plan.json of every other run
_LINK_BASE, _PANIC_AUTOPILOT, _PANIC_PARTNER, _TOOLS = 24000, 4, 5, 6


@dataclass(frozen=True, kw_only=True)
class Target:
    """Vehicle to land: its name, its MAVLink id, and the addresses on which the vehicle receives commands.

    id: MAVLink system id
    autopilot, partner: the two ends of its panic link, the autopilot's and this computer's
    tools: address at which the router receives frames for this vehicle
    radio: false if no pilot has an RC transmitter (`radio: none` of a real vehicle)
    run: run folder of a simulated vehicle, which records crashes; None for a real vehicle
    ends_with_world: true if body and autopilot are simulated: without the world process, nothing flies
    direct: address for a connection to a real vehicle without router and link process; None if simulated or
    unknown
    """

    name: str
    id: int
    autopilot: Address
    partner: Address
    tools: Address
    radio: bool = True
    run: Path | None = field(default=None, compare=False)
    ends_with_world: bool = field(default=False, compare=False)
    direct: DirectAddress | None = field(default=None, compare=False)

    @property
    def run_folder(self) -> Path | None:
        """Run folder of a simulated or real vehicle; None for a vehicle that was found in a YAML."""
        return self.run or (self.direct.run if self.direct is not None else None)

    @property
    def name_in_run(self) -> str:
        """Name with the run folder, such as `uav1 of lab/runs/2026-01-31_12-00-00`, for vehicles of several runs."""
        run = self.run_folder
        return f"{self.name} of {run}" if run is not None else f"{self.name} (system id {self.id})"

    @property
    def signs(self) -> bool:
        """True if the vehicle has a signing key."""
        return self.direct is not None and bool(self.direct.key_file)


@dataclass(frozen=True, kw_only=True)
class Found:
    """Vehicles that land-all or kill-all has found, and error texts of the runs that could not be read.

    source: the run folders or the YAML that contain the addresses
    unread: one message per active run whose plan cannot be read
    untrusted: folders with runs of this user that are not read, because others may write to them
    replays: the active runs that are replays: they have no vehicle, and are not commanded
    """

    source: str
    targets: tuple[Target, ...]
    unread: tuple[str, ...] = ()
    replays: tuple[str, ...] = ()
    untrusted: tuple[Path, ...] = ()


def find(
    *,
    arena: Path | None = None,
    run: Path | None = None,
    elsewhere: Callable[[], bool] = lambda: False,
) -> Found:
    """Return the vehicles to land: those of the given run, or without one those of the active runs, or else of the YAML.

    Raises InputError if no vehicle is found.

    Own runs are first. Runs of other users are included if the owner shares them with a group of this user. For root,
    another process commands them, with the rights of their owner (`other_users`).
    arena: path of a YAML. It selects the active runs that were started from it, else an active run on its
    address.
    run: path of a run folder
    elsewhere: function that returns whether another process commands the vehicles; then no YAML is read
    """
    if run is not None:
        chosen = ActiveRun(folder=run)
        if is_replay(chosen):
            return Found(source="", targets=(), replays=(str(chosen),))
        return _of_run(chosen)
    runs = active_runs()
    if os.geteuid() != 0:
        runs += [shared for found in active_runs_of_others().values() for shared in found]
    replays = tuple(str(one) for one in runs if is_replay(one))
    untrusted = tuple(untrusted_folders())
    try:
        return replace(_find_in(runs, arena, elsewhere, replays), replays=replays, untrusted=untrusted)
    except InputError as error:
        raise InputError("\n".join([str(error), *map(untrusted_text, untrusted)])) from error


def untrusted_text(folder: Path) -> str:
    """Return the message for a folder with runs that others may write."""
    return (
        f"NOT COMMANDED: the vehicles of runs in {folder}: others may write to this folder, and so choose which addresses are "
        f"commanded. If nobody has changed its files: chmod go-w {folder}, then repeat"
    )


def _find_in(
    runs: Sequence[ActiveRun], arena: Path | None, elsewhere: Callable[[], bool], replays: Sequence[str]
) -> Found:
    if selected := of_runs(runs, arena):
        return selected
    if elsewhere():
        return Found(source="", targets=())
    if arena is None:
        arena = Path("arena.yaml")
        only_replays = len(replays) == len(runs)
        if replays and only_replays and not _names_real_vehicle(arena):
            return Found(source="", targets=())
        if not arena.is_file():
            raise InputError(
                "nothing to land: no run is active, and there is no arena.yaml in this folder. Name the file: arena land-all FILE"
            )
        if selected := of_runs(runs, arena):
            return selected
    return from_yaml(_yaml_path(arena))


def of_runs(runs: Sequence[ActiveRun], arena: Path | None) -> Found | None:
    """Return the vehicles of the active runs that were started from one YAML, or of all active runs.

    If no run was started from this YAML, the newest run on its address is used. Returns None if there is no run, or none
    can be read.
    runs: active runs. Replays are ignored: their vehicles are recorded, so they cannot land.
    """
    runs = [run for run in runs if not is_replay(run)]
    if arena is None:
        return _of_all(runs)
    file = _yaml_path(arena)
    if found := _of_all([run for run in runs if _began_from(run.folder) == str(file.resolve())]):
        return found
    with contextlib.suppress(InputError):
        hosts = {target.tools[0] for target in from_yaml(file).targets}
        for run in reversed(runs):
            with contextlib.suppress(InputError):
                running = _of_run(run)
                if hosts & {target.tools[0] for target in running.targets}:
                    return running
    return None


def _names_real_vehicle(arena: Path) -> bool:
    """Return whether a YAML contains a real vehicle; False if the file does not exist.

    While a replay runs, a bare land-all does not search for simulated vehicles of arena.yaml: they exist in a run only. Real vehicles
    are landed as without the replay.
    """
    if not arena.is_file():
        return False
    try:
        return any(target.direct is not None for target in from_yaml(arena).targets)
    except InputError:
        return True


def is_replay(run: ActiveRun) -> bool:
    """Return whether a run plays back a recorded flight; False if its plan cannot be read."""
    for folder in (run.folder, run.runtime):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            if folder is not None:
                text = (folder / "plan.json").read_text()
                may_be = (
                    _NO_REPLAY not in text and '"replay"' in text
                )  # else the text is not parsed, to command vehicles sooner
                return may_be and _plays_back(json.loads(text))
    return False


def _plays_back(plan: Any) -> bool:
    """Return whether a plan is a replay of a recorded flight.

    A plan with a real vehicle is never a replay.
    """
    return bool(plan.get("replay")) and all(v["simulated"] is True for v in plan["vehicles"])


def _yaml_path(arena: Path) -> Path:
    return arena / "arena.yaml" if arena.is_dir() else arena


def _of_all(runs: Iterable[ActiveRun]) -> Found | None:
    """Return the vehicles of all runs whose files can be read; None if no run can be read.

    `Found.unread` has one error text for each run whose files cannot be read.
    """
    plans: list[tuple[ActiveRun, Found]] = []
    unread = []
    for run in runs:
        try:
            plans.append((run, _of_run(run)))
        except InputError as error:
            unread.append(str(error))
    if not plans:
        return None
    source = ", ".join(found.source for _, found in plans)
    return Found(source=source, targets=_distinct(plans), unread=tuple(unread))


def _began_from(folder: Path) -> str:
    """Return the path of the YAML from which a run was started; "" if unknown.

    The first line of the run's arena.yaml contains this path.
    """
    try:
        with (folder / "arena.yaml").open(errors="replace") as file:
            return str(Path(file.readline().partition("# resolved from ")[2].strip()).resolve())
    except OSError:
        return ""


def choose(
    targets: Sequence[Target], only: Sequence[str] = (), spared: Sequence[str] = ()
) -> tuple[Target, ...]:
    """Return the vehicles named in `only`, except those named in `spared`.

    An empty `only` selects all vehicles.

    Raises InputError for an unknown name.
    """
    names = [target.name for target in targets]
    for name in (*only, *spared):
        if name not in names:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(names)}")
    return tuple(t for t in targets if (not only or t.name in only) and t.name not in spared)


def from_plan(text: str, run: Path | None = None) -> tuple[Target, ...]:
    """Return the vehicles in a plan.json.

    Raises ValueError, KeyError or TypeError if the text is not a plan.

    text: contents of the file
    run: run folder of the file
    """
    plan = json.loads(text)
    return tuple(
        Target(
            name=str(v["name"]),
            id=int(v["id"]),
            autopilot=(v["panic"]["autopilot_host"], int(v["panic"]["autopilot_port"])),
            partner=(v["panic"]["partner_host"], int(v["panic"]["partner_port"])),
            tools=(v["router"]["partner_host"], int(v["tools_port"])),
            radio=v["simulated"] is True or v.get("radio") != "none",
            run=run if v["simulated"] is True else None,
            ends_with_world=v["simulated"] is True and v.get("autopilot") in _SOFTWARE,
            direct=None if v["simulated"] is True else _planned_direct(plan, str(v["name"]), run),
        )
        for v in plan["vehicles"]
    )


def _planned_direct(plan: Any, vehicle: str, run: Path | None) -> DirectAddress | None:
    try:
        slice_ = plan["slices"][f"link.{vehicle}.json"]
        direct = DirectAddress.of(url_from_json(slice_["wire"]))
        key_file = str(slice_.get("key_file", ""))
        direct = replace(direct, uid=valid_uid(slice_.get("uid")), key_file=key_file)
    except (KeyError, TypeError, ValueError):
        return None
    return with_run_record(direct, vehicle, run) if run is not None else direct


def from_yaml(path: Path) -> Found:
    """Return the vehicles of a YAML, with the ports that the schema assigns.

    Raises InputError if the YAML contains no vehicle.
    """
    try:
        text = path.read_text(errors="replace")
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    host, vehicles = vehicles_of(read_yaml(text))
    if not vehicles:
        raise InputError(f"{path}: the file names no vehicle. Expected `vehicles:` with one name per line")
    targets = tuple(_by_port_rule(one, host, path.parent) for one in vehicles)
    return Found(source=str(path), targets=targets)


def _by_port_rule(vehicle: VehicleEntry, host: str, folder: Path) -> Target:
    """Return the addresses of a vehicle of a YAML, computed from its id (docs/reference/ports.md).

    folder: folder of the YAML.
    """
    direct = None
    if vehicle.connection is not None:
        key_file = str((folder / vehicle.key_file).absolute()) if vehicle.key_file else ""
        direct = replace(DirectAddress.of(vehicle.connection), uid=valid_uid(vehicle.uid), key_file=key_file)
    base = _LINK_BASE + 10 * vehicle.id
    return Target(
        name=vehicle.name,
        id=vehicle.id,
        autopilot=(host, base + _PANIC_AUTOPILOT),
        partner=(host, base + _PANIC_PARTNER),
        tools=(host, base + _TOOLS),
        radio=vehicle.radio,
        direct=direct,
    )


def _of_run(run: ActiveRun) -> Found:
    """Return the vehicles of a run from its plan.json; from its arena.yaml if the plan cannot be read.

    The runtime folder has a copy of plan.json, which is read if the run folder was deleted or belongs to another user.
    """
    why: Exception | None = None
    for folder in (run.folder, run.runtime):
        if folder is None:
            continue
        try:
            text = (folder / "plan.json").read_text()
            return Found(source=str(run), targets=from_plan(text, run.folder))
        except (OSError, ValueError, KeyError, TypeError) as error:
            why = why or error
    with contextlib.suppress(OSError):
        if (run.folder / "arena.yaml").is_file():
            return from_yaml(run.folder / "arena.yaml")
    is_missing = isinstance(why, FileNotFoundError) and not run.folder.is_dir()
    text = "no such folder" if is_missing else f"neither plan.json nor arena.yaml can be read: {why}"
    raise InputError(f"{run}: {text}") from why


def _distinct(plans: Iterable[tuple[ActiveRun, Found]]) -> tuple[Target, ...]:
    """Return the vehicles of several runs without duplicates: one vehicle per autopilot address.

    If several plans have the same address, the newest run of this user counts; without such a run, the first plan counts.
    plans: runs with their vehicles. The runs of this user come first, oldest first.
    """
    found: dict[Address, Target] = {}
    for run, plan in plans:
        for target in plan.targets:
            if not run.owner or target.autopilot not in found:
                found[target.autopilot] = target
    return tuple(found.values())
