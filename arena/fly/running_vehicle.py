"""Finds a vehicle of the running arenas by its name, and reads the settings to fly it.

Only files of the run are read.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from arena.errors import InputError, RunError
from arena.live_view.settings import Settings, VehicleSettings
from arena.simulation_speed import speed_of
from arena.supervisor import Control, RunState, active_runs, open_run


@dataclass(frozen=True, kw_only=True)
class RunningVehicle:
    """Vehicle of a running arena, with all that `arena fly` and `arena shell` need to connect to it.

    run: the run to which it belongs
    room: room and geofence of the arena
    settings: entry of the vehicle in the configuration file of viewers (slice `view.json`)
    program_file: the file that programs receive with `--uav`
    """

    run: RunState
    room: Settings
    settings: VehicleSettings
    program_file: Path

    @property
    def name(self) -> str:
        """Name of the vehicle."""
        return self.settings.name

    @property
    def is_real(self) -> bool:
        """True for a real vehicle, False for a simulated vehicle."""
        return self.settings.kind == "real"

    @property
    def speed(self) -> float:
        """Requested simulated seconds per second of wall time; inf for `max`, 1.0 for a real vehicle.

        Raises RunError if the file of the run cannot be read.
        """
        if self.is_real:
            return 1.0
        path = Path(self.run.run) / "slices" / "world.json"
        try:
            return speed_of(json.loads(path.read_text())["speed"])
        except (OSError, ValueError, KeyError) as error:
            raise RunError(f"{path}: cannot read the speed of the simulation: {error}") from error

    def facts(self) -> Mapping[str, Any]:
        """Return what the supervisor reports about the vehicle, such as `armed`, `mode` and `control`.

        control: who commands the vehicle. blocked: why user programs may not fly the vehicle. Each fact may be missing.

        Raises RunError if the supervisor does not reply.
        """
        control = Control(Path(self.run.rt) / "control.sock")
        try:
            status = control.ask(do="view")
        finally:
            control.close()
        facts = status.get("facts") or {}
        own = f"{self.name}."
        return {key.removeprefix(own): value for key, value in facts.items() if key.startswith(own)}


def find_vehicle(name: str | None, run: Path | None = None) -> RunningVehicle:
    """Find a vehicle of the running arenas by its name.

    name: name of the vehicle; None for the only vehicle. run: run folder; None searches all running arenas.
    Raises RunError if no arena runs, and InputError if no vehicle or several vehicles have this name.
    """
    states = _running(run)
    vehicles = [vehicle for state in states for vehicle in _vehicles_of(state)]
    found = [v for v in vehicles if name in (None, v.name)]
    if not found:
        if not vehicles:
            raise InputError(
                "the running arena has no vehicle. Add one to its YAML, or give another run folder with --run"
            )
        known = ", ".join(v.name for v in vehicles)
        raise InputError(
            f"{name}: no running arena has this vehicle. The vehicles of running arenas are: {known}"
        )
    if len(found) > 1:
        choices = "\n".join(f"  {v.name} in {v.run.run}" for v in found)
        raise InputError(
            f"{len(found)} vehicles match. Give the name of one, and its run folder with --run:\n{choices}"
        )
    vehicle = found[0]
    if vehicle.settings.kind == "replayed" or vehicle.settings.tools is None:
        raise InputError(f"{vehicle.name}: this is a vehicle of a replay, which cannot be flown")
    return vehicle


def _running(run: Path | None) -> Sequence[RunState]:
    if run is None:
        states = [state for state in active_runs() if state.live]
        if not states:
            raise RunError("no arena is running. Start one with `arena up`")
        return states
    state = open_run(run.resolve())
    if state is None or not state.live:
        raise RunError(f"{run}: no arena is running from this folder. `arena runs` lists the run folders")
    return [state]


def _vehicles_of(state: RunState) -> list[RunningVehicle]:
    slices = Path(state.run) / "slices"
    try:
        room = Settings.from_slice(json.loads((slices / "view.json").read_text()))
    except (OSError, ValueError) as error:
        raise RunError(f"{slices}: cannot read the vehicles of the run: {error}") from error
    return [
        RunningVehicle(run=state, room=room, settings=v, program_file=slices / f"program.{v.name}.json")
        for v in room.vehicles
    ]


def lock_pilot(vehicle: RunningVehicle) -> TextIO:
    """Lock a vehicle, so that no second `arena fly` or `arena shell` can fly it at the same time.

    The lock ends with the process or with `close`.

    Raises RunError if another process has the lock.
    """
    file = (Path(vehicle.run.rt) / f"pilot.{vehicle.name}.lock").open("a")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise RunError(
            f"{vehicle.name}: another `arena fly` or `arena shell` flies this vehicle: end that command first"
        ) from error
    return file
