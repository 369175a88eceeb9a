"""Check of a trajectory before the flight: positions, speeds and accelerations. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arena.geometry import Array
from arena.live_view.settings import Settings, VehicleSettings
from arena.obstacles import Obstacle
from arena.trajectories import Trajectory

STEP_S = 0.02
_STEP_M = 0.05  # between two points of a jump
_MARGIN_M = 0.02


@dataclass(frozen=True, kw_only=True)
class FlightLimits:
    """Limits that a trajectory must keep: room, speed and acceleration.

    low, high: corners of the box that the vehicle's body origin must not leave [m] [NED] (3,)
    speed: horizontal speed [m/s]. up, down: climb and sink rate [m/s]. accel: acceleration [m/s2]
    where: name of the box, such as `geofence`
    obstacles: fixed bodies, from which the body origin must keep `clearance_m` [m]
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    where: str
    speed: float
    up: float
    down: float
    accel: float
    obstacles: tuple[Obstacle, ...] = ()
    clearance_m: float = 0.0


def limits_of(
    room: Settings, vehicle: VehicleSettings, speeds: tuple[float, float, float, float]
) -> FlightLimits:
    """Return the limits for a vehicle in its room: the geofence, or else the room minus the vehicle's size.

    speeds: horizontal speed, climb rate, sink rate [m/s] and acceleration [m/s2] of the vehicle
    """
    speed, up, down, accel = speeds
    margin = vehicle.radius_m + _MARGIN_M
    if room.fence is not None:
        (south, north), (west, east), top = room.fence.north, room.fence.east, room.fence.up
        where = "geofence"
    else:
        north, east = 0.5 * room.size_m[0] - margin, 0.5 * room.size_m[1] - margin
        south, west, top = -north, -east, room.size_m[2] - margin if room.ceiling else np.inf
        where = "room"
    return FlightLimits(
        low=(south, west, -top),
        high=(north, east, -_MARGIN_M),
        where=where,
        speed=speed,
        up=up,
        down=down,
        accel=accel,
        obstacles=room.obstacles,
        clearance_m=margin,
    )


def problems_of(trajectory: Trajectory, limits: FlightLimits) -> list[str]:
    """Return every reason not to fly a trajectory, with time and value; [] if it can be flown.

    The trajectory is sampled every 0.02 s. A jump of the position, as between the setpoints of a `SetpointList`, is allowed: the autopilot
    plans the way. The straight line between both positions must not meet an obstacle.
    """
    times = np.append(np.arange(0.0, trajectory.duration_s, STEP_S), trajectory.duration_s)
    found = [trajectory.at(float(t)) for t in times]
    p, v, a = (np.array([getattr(each, name) for each in found]) for name in ("pos", "vel", "acc"))
    problems = [_outside(times, p, limits, axis) for axis in range(3)]
    problems += collisions(times, p, limits)
    sideways = np.hypot(v[:, 0], v[:, 1])
    problems += [
        _above(times, sideways, limits.speed, "horizontal speed", "m/s"),
        _above(times, -v[:, 2], limits.up, "climb rate", "m/s"),
        _above(times, v[:, 2], limits.down, "sink rate", "m/s"),
        _above(times[:-1], np.linalg.norm(a, axis=1)[:-1], limits.accel, "acceleration", "m/s2"),
    ]
    return [problem for problem in problems if problem]


def collisions(times: Array | None, p: Array, limits: FlightLimits) -> Iterator[str]:
    """Yield a text for each obstacle that is too near to a path of straight lines.

    times: [s] (n,); None: the texts contain no time.  p: body origin [m] [NED] (n, 3)
    """
    for obstacle in limits.obstacles:
        for time_s, point in _on_the_way(np.zeros(len(p)) if times is None else times, p):
            near = obstacle.nearest(point)
            gap = float(np.linalg.norm(point - np.asarray(near)))
            if gap < limits.clearance_m:
                moment = "" if times is None else f" at {time_s:.2f} s"
                yield (
                    f"too near to the obstacle {obstacle.name}{moment}: {gap:.2f} m, "
                    f"allowed {limits.clearance_m:.2f} m (body origin)"
                )
                break


def _on_the_way(times: Array, p: Array) -> Iterator[tuple[float, Array]]:
    """Yield (time, position) of points on a path of straight lines, at most 0.05 m apart.

    The time of a point is the time at the end of its straight line.
    """
    if len(p):
        yield float(times[0]), p[0]
    for k in range(1, len(p)):
        parts = max(1, int(np.ceil(np.linalg.norm(p[k] - p[k - 1]) / _STEP_M)))
        for share in (np.arange(parts) + 1.0) / parts:
            yield float(times[k]), p[k - 1] + share * (p[k] - p[k - 1])


def _outside(times: Array, p: Array, limits: FlightLimits, axis: int) -> str:
    value, low, high = p[:, axis], limits.low[axis], limits.high[axis]
    bad = (value < low - 1e-6) | (value > high + 1e-6)
    if not bad.any():
        return ""
    k = int(bad.argmax())
    name = ("north", "east", "down")[axis]
    return (
        f"outside the {limits.where} at {times[k]:.2f} s: {name} {value[k]:.2f} m, allowed {low:.2f} to {high:.2f} m "
        f"(body origin; range of the file {value.min():.2f} to {value.max():.2f} m)"
    )


def _above(times: Array, values: Array, limit: float, what: str, unit: str) -> str:
    if not (values > limit + 1e-6).any():
        return ""
    k = int((values > limit + 1e-6).argmax())
    return f"{what} above {limit:g} {unit} at {times[k]:.2f} s: greatest value in the file {values.max():.2f} {unit}"
