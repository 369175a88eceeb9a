"""Flight on a circle around a point (MAV_CMD_DO_ORBIT): the request, and the setpoint of each step. Pure.

The rules are PX4 v1.16's: the vehicle approaches the nearest point of the circle with its nose to the centre, then flies along the circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

Point = tuple[float, float, float]
_NAN = math.nan
SMALLEST_RADIUS_M, FASTEST_M_S = 1.0, 10.0
_MOST_ACCEL_M_S2 = 2.0  # centripetal
_ON_CIRCLE_M = 2.0
_RADIAL_GAIN = 1.0  # speed per distance from the circle [1/s]
_FENCE_POINTS = 36


class YawBehaviour(IntEnum):
    """ORBIT_YAW_BEHAVIOUR: heading of the vehicle on the circle."""

    FRONT_TO_CENTRE = 0
    INITIAL_HEADING = 1
    UNCONTROLLED = 2
    FRONT_TANGENT = 3


class OrbitRequest(NamedTuple):
    """Parameters of MAV_CMD_DO_ORBIT.

    NaN selects the default, or the present position.

    radius: [m], negative for a counter-clockwise flight
    speed: [m/s]
    yaw: ORBIT_YAW_BEHAVIOUR
    lat, lon, alt: centre, latitude and longitude [deg], altitude AMSL [m]
    """

    radius: float
    speed: float
    yaw: float
    lat: float
    lon: float
    alt: float


class OrbitSetpoint(NamedTuple):
    """Setpoint on a circle: position, velocity, acceleration [NED] (3,) and heading [rad].

    NaN means that the value is not controlled.
    """

    p_n: Point
    v_n: Point
    a_n: Point
    yaw: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Orbit:
    """Circle that a vehicle flies.

    centre: centre, at the height of the flight [m] [NED]
    radius: [m]
    velocity: speed along the circle, positive clockwise as seen from above [m/s]
    initial_yaw: heading at the request [rad]
    """

    centre: Point
    radius: float
    velocity: float
    yaw_behaviour: YawBehaviour
    initial_yaw: float

    def points(self) -> list[Point]:
        """Return points of the circle [m] [NED], to check that the circle is inside the geofence."""
        angles = [2.0 * math.pi * k / _FENCE_POINTS for k in range(_FENCE_POINTS)]
        n, e, d = self.centre
        return [(n + self.radius * math.cos(a), e + self.radius * math.sin(a), d) for a in angles]

    def is_reached(self, p_n: Point, within_up_m: float) -> bool:
        """Return whether a vehicle at this position has reached the circle, with a small tolerance.

        p_n: position [m] [NED]. within_up_m: largest difference of height [m]
        """
        away = math.dist(p_n[:2], self.centre[:2])
        return abs(away - self.radius) < _ON_CIRCLE_M and abs(p_n[2] - self.centre[2]) < within_up_m

    def nearest(self, p_n: Point) -> Point:
        """Return the point of the circle that is nearest to a position [m] [NED]."""
        out = _outward(p_n, self.centre)
        return (
            self.centre[0] + out[0] * self.radius,
            self.centre[1] + out[1] * self.radius,
            self.centre[2],
        )

    def setpoint(self, p_n: Point, velocity: float) -> OrbitSetpoint:
        """Return the setpoint for the next step of a vehicle at a position [m] [NED].

        velocity: present speed along the circle, see `Orbit`
        """
        out = _outward(p_n, self.centre)
        inward = _RADIAL_GAIN * (self.radius - math.dist(p_n[:2], self.centre[:2]))
        accel = -velocity * velocity / self.radius
        return OrbitSetpoint(
            (_NAN, _NAN, self.centre[2]),
            (-out[1] * velocity + out[0] * inward, out[0] * velocity + out[1] * inward, _NAN),
            (out[0] * accel, out[1] * accel, _NAN),
            self.heading(p_n),
        )

    def heading(self, p_n: Point) -> float:
        """Return the heading setpoint [rad] at a position [m] [NED]. NaN keeps the present heading."""
        out = _outward(p_n, self.centre)
        if self.yaw_behaviour is YawBehaviour.INITIAL_HEADING:
            return self.initial_yaw
        if self.yaw_behaviour is YawBehaviour.UNCONTROLLED:
            return _NAN
        if self.yaw_behaviour is YawBehaviour.FRONT_TANGENT:
            way = math.copysign(1.0, self.velocity)
            return math.atan2(way * out[0], -way * out[1])
        return math.atan2(-out[1], -out[0])


def orbit_of(
    request: OrbitRequest, centre: Point, yaw: float, most_radius: float, before: Orbit | None
) -> Orbit | None:
    """Return the requested circle; None if its radius is not allowed.

    centre: requested centre [m] [NED].  yaw: present heading [rad].  most_radius: MC_ORBIT_RAD_MAX [m]
    before: circle that the vehicle flies already; values that are not given are those of this circle
    """
    old = before or Orbit(
        centre=centre,
        radius=SMALLEST_RADIUS_M,
        velocity=1.0,
        yaw_behaviour=YawBehaviour.FRONT_TO_CENTRE,
        initial_yaw=yaw,
    )
    radius = abs(request.radius) if math.isfinite(request.radius) else old.radius
    clockwise = request.radius > 0 if math.isfinite(request.radius) else old.velocity > 0
    speed = request.speed if math.isfinite(request.speed) else abs(old.velocity)
    if not SMALLEST_RADIUS_M <= radius <= most_radius:
        return None
    speed = min(max(speed, -FASTEST_M_S), FASTEST_M_S)
    fastest = math.sqrt(_MOST_ACCEL_M_S2 * radius)
    speed = min(max(speed, -fastest), fastest)
    known = math.isfinite(request.yaw) and int(request.yaw + 0.5) in tuple(YawBehaviour)
    behaviour = YawBehaviour(int(request.yaw + 0.5)) if known else old.yaw_behaviour
    return replace(
        old,
        centre=centre,
        radius=radius,
        velocity=speed if clockwise else -speed,
        yaw_behaviour=behaviour,
        initial_yaw=yaw,
    )


def _outward(p_n: Point, centre: Point) -> tuple[float, float]:
    """Return the horizontal unit vector from the centre of a circle to a position.

    At the centre the vector points north.
    """
    away = (p_n[0] - centre[0], p_n[1] - centre[1])
    length = math.hypot(*away)
    return (away[0] / length, away[1] / length) if length > 1e-6 else (1.0, 0.0)
