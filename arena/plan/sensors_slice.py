"""Makes the configuration file (slice) of the process `sensors`, which emulates relative sensors. Pure."""

from __future__ import annotations

import math
from typing import Any

from arena.plan import slices
from arena.plan.job import Job, Json
from arena.plan.program_slice import beacon_names
from arena.schema import Arena, Vehicle
from arena.schema.ports import SENSORS


def sensors(job: Job) -> Json:
    """Return the JSON configuration (slice) of the process `sensors`."""
    arena = job.arena
    used = _vehicles(arena)
    captured = _captured(arena)
    captures = []
    for simulated in (True, False):
        bodies = [v.mocap_body for v in used if v.simulated is simulated and v.name in captured]
        one = slices.capture(arena, bodies, simulated=simulated) if bodies else None
        captures += [{**one, "simulated": simulated}] if one is not None else []
    return {
        "name": "sensors",
        "listen": [arena.address, SENSORS],
        "clock": None if arena.hardware else slices.CLOCK,
        "captures": captures,
        "frame_rate_hz": arena.mocap.rate_hz,
        "pose_noise_m": arena.mocap.noise.position_mm / 1000.0,
        "seed": arena.world.seed,
        "vehicles": [_vehicle(arena, v) for v in used],
    }


def _vehicles(arena: Arena) -> list[Vehicle]:
    """Return the vehicles with a relative sensor, and all vehicles that such a sensor measures."""
    measured = {name for v in arena.vehicles for name in v.neighbours}
    return [v for v in arena.vehicles if v.has_sensors or v.name in measured]


def _captured(arena: Arena) -> set[str]:
    """Return the names of the vehicles whose captured poses are needed to emulate the relative sensors."""
    found = set()
    for v in arena.vehicles:
        if v.neighbours and v.neighbour_sensor.source == "mocap":
            found |= {v.name, *v.neighbours}
        if v.beacon_sensor is not None and v.beacon_sensor.source == "mocap":
            found.add(v.name)
    return found


def _estimated(arena: Arena) -> set[str]:
    """Return the names of the vehicles whose telemetry is needed to emulate the relative sensors."""
    found = set()
    for v in arena.vehicles:
        if v.neighbours and v.neighbour_sensor.source == "estimator":
            found |= {v.name, *v.neighbours}
        if v.beacon_sensor is not None and v.beacon_sensor.source == "estimator":
            found.add(v.name)
    return found


def _vehicle(arena: Arena, v: Vehicle) -> Json:
    return {
        "name": v.name,
        "id": v.id,
        "body": v.mocap_body,
        "simulated": v.simulated,
        "estimated": v.name in _estimated(arena),
        "router": [arena.address, v.ports.sensors_router] if v.has_sensors else None,
        "tools": [arena.address, v.ports.tools],
        "serve": [arena.address, v.ports.serve],
        "neighbours": _neighbours(v),
        "beacons": _beacons(arena, v),
    }


def _neighbours(v: Vehicle) -> dict[str, Any] | None:
    sensor = v.neighbour_sensor
    if not v.neighbours:
        return None
    return {
        "vehicles": list(v.neighbours),
        "source": sensor.source,
        "rate_hz": sensor.rate_hz,
        "position_noise_m": sensor.noise.position_m,
        "velocity_noise_m_s": sensor.noise.velocity_m_s,
    }


def _beacons(arena: Arena, v: Vehicle) -> dict[str, Any] | None:
    sensor = v.beacon_sensor
    if sensor is None:
        return None
    wanted = beacon_names(arena, v)
    return {
        "source": sensor.source,
        "rate_hz": sensor.rate_hz,
        "range_noise_m": sensor.noise.range_m,
        "bearing_noise": math.radians(sensor.noise.bearing_deg),
        "max_range_m": sensor.max_range_m,
        "beacons": [
            {"number": number, "name": name, "position": list(position)}
            for number, (name, position) in enumerate(arena.beacons.items(), 1)
            if name in wanted
        ],
    }
