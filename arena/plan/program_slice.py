"""Makes the configuration files (slices) of user programs and of groups of user programs, and their restart policy. Pure."""

from __future__ import annotations

from arena.plan import slices
from arena.plan.job import Job, Json, program_args
from arena.plan.model import Restart
from arena.schema import Arena, Vehicle

STALE_S = 0.5
"""Age limit of the data that a program reads, such as position and attitude [s]."""

_REAL_BACKOFF_S = 2.0
"""Wait before the program of a real vehicle is started again [s]: two periods of HEARTBEAT, which shows whether the vehicle was armed."""
_REAL_WINDOW_S = 60.0
"""Five starts of such a program within this time are too many [s]. It must exceed the waits between them, 30 s in sum."""


def program_restart(vehicle: Vehicle) -> Restart:
    """Return the restart policy of a vehicle's user program."""
    mode = vehicle.program.restart if vehicle.program else "never"
    if vehicle.simulated:
        return Restart(mode=mode)
    return Restart(mode=mode, backoff_s=_REAL_BACKOFF_S, window_s=_REAL_WINDOW_S)


def program(job: Job) -> Json:
    """Return the configuration file that a vehicle's program receives with the option `--uav`."""
    arena, v = job.arena, job.v
    kept = ("name", "mass_kg", "radius_m", "height_m", "num_rotors", "thrust_curve")
    return {
        "name": f"program.{v.name}",
        "vehicle": v.name,
        "id": v.id,
        "link": f"udpin:{arena.address}:{v.ports.program}",
        "capture": slices.capture(arena, [v.mocap_body], simulated=v.simulated),
        "body": v.mocap_body,
        "clock": slices.clock(v),
        "profile": {k: x for k, x in v.profile.slice().items() if k in kept},
        **_sensors(arena, v),
        "stale_s": STALE_S,
        "heartbeat": slices.heartbeat_address(arena),
        "log": slices.recorder_address(arena),
        "run": "{run}",
        "barriers": "{rt}/barriers",
        "programs": _programs_that_wait(arena, v),
        "backend": v.backend,
    }


def group(job: Job) -> Json:
    """Return the configuration (slice) of the process that runs the user programs of a group of vehicles."""
    vehicles = job.vehicles
    first = vehicles[0]
    if first.program is None:
        raise ValueError(
            f"cannot make the configuration of the group {job.group}: {first.name} has no program"
        )
    return {
        "name": f"group.{job.group}",
        "program": first.program.path,
        "once": first.program.once,
        "clock": slices.clock(first),
        "members": [
            {
                "vehicle": v.name,
                "argv": ["--uav", f"{{run}}/slices/program.{v.name}.json", *program_args(job.arena, v)],
            }
            for v in vehicles
        ],
        "heartbeat": slices.heartbeat_address(job.arena),
    }


def _sensors(arena: Arena, v: Vehicle) -> Json:
    """Return the settings of a vehicle's relative sensors for its program: neighbours, beacons, age limits.

    The program cannot read a measurement that is older than its age limit. The limit is STALE_S, or three periods of the sensor
    if these are longer.
    """
    sensor = v.beacon_sensor
    numbers = {name: number for number, name in enumerate(arena.beacons, 1)}
    return {
        "neighbours": [{"name": n, "id": arena.vehicle(n).id} for n in v.neighbours],
        "neighbours_stale_s": max(STALE_S, 3.0 / v.neighbour_sensor.rate_hz),
        "beacons": [{"name": n, "number": numbers[n]} for n in beacon_names(arena, v)],
        "beacons_stale_s": STALE_S if sensor is None else max(STALE_S, 3.0 / sensor.rate_hz),
    }


def beacon_names(arena: Arena, v: Vehicle) -> list[str]:
    """Return the names of the beacons that a vehicle measures, in the order of the YAML."""
    sensor = v.beacon_sensor
    if sensor is None:
        return []
    return [name for name in arena.beacons if sensor.beacons is None or name in sensor.beacons]


def _programs_that_wait(arena: Arena, vehicle: Vehicle) -> list[str]:
    """Return the names of the vehicles whose programs can wait for each other with `uav.wait_for`, including this vehicle.

    Programs of real vehicles use the wall clock, those of simulated vehicles the simulation clock. Their times cannot be compared.
    """
    programs = [v for v in arena.vehicles if v.program is not None and not v.program.once]
    return [v.name for v in programs if v.simulated == vehicle.simulated]
