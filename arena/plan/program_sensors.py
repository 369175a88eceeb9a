"""Makes parts of a user program's configuration (slice): emulated relative sensors, and other programs of the arena. Pure."""

from __future__ import annotations

from arena.plan.job import Json
from arena.schema import Arena, Vehicle


def program_sensors(arena: Arena, v: Vehicle, stale_s: float) -> Json:
    """Return the settings of a vehicle's relative sensors for its program: neighbours, beacons, age limits.

    The program cannot read a measurement that is older than its age limit. The limit is `stale_s`, or three periods of the sensor
    if these are longer.
    stale_s: age limit of the vehicle's other data, such as position and attitude [s].
    """
    sensor = v.beacon_sensor
    numbers = {name: number for number, name in enumerate(arena.beacons, 1)}
    return {
        "neighbours": [{"name": n, "id": arena.vehicle(n).id} for n in v.neighbours],
        "neighbours_stale_s": max(stale_s, 3.0 / v.neighbour_sensor.rate_hz),
        "beacons": [{"name": n, "number": numbers[n]} for n in beacon_names(arena, v)],
        "beacons_stale_s": stale_s if sensor is None else max(stale_s, 3.0 / sensor.rate_hz),
    }


def beacon_names(arena: Arena, v: Vehicle) -> list[str]:
    """Return the names of the beacons that a vehicle measures, in the order of the YAML."""
    sensor = v.beacon_sensor
    if sensor is None:
        return []
    return [name for name in arena.beacons if sensor.beacons is None or name in sensor.beacons]


def programs_with_same_clock(arena: Arena, vehicle: Vehicle) -> list[str]:
    """Return the vehicles with a program for which `uav.wait_for` of this vehicle's program waits.

    Programs of real vehicles use the wall clock, those of simulated vehicles the simulation clock. Their times cannot be compared.
    """
    programs = [v for v in arena.vehicles if v.program is not None and not v.program.once]
    return [v.name for v in programs if v.simulated == vehicle.simulated]
