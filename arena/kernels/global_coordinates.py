"""Conversion of a local position to latitude and longitude, also as integers of MAVLink messages. Pure."""

from __future__ import annotations

import math

from arena.kernels import limits

_DEG, _RAD = 180.0 / math.pi, math.pi / 180.0


def latitude_longitude(
    north: float, east: float, heading: float, lat0: float, lon0: float, earth_m: float
) -> tuple[float, float]:
    """Return latitude and longitude [deg] of a local position. The longitude is not wrapped to +-180 deg.

    `arena.geometry.globe_from_local` has the formula for arrays.

    north, east: position from the origin [m]
    heading: direction of the local frame's north, clockwise from true north [rad]
    lat0, lon0: origin [deg]
    earth_m: radius of the Earth [m]
    """
    cos, sin = math.cos(heading), math.sin(heading)
    true_north, true_east = cos * north - sin * east, sin * north + cos * east
    lat = lat0 + _DEG * (true_north / earth_m)
    return lat, lon0 + _DEG * (true_east / (earth_m * math.cos(_RAD * lat0)))


def global_position(
    north: float, east: float, heading: float, lat0: float, lon0: float, earth_m: float
) -> tuple[float, float]:
    """Return latitude and longitude [1e-7 deg] of a local position, rounded to integers.

    The arguments are those of `latitude_longitude`.
    """
    lat, lon = latitude_longitude(north, east, heading, lat0, lon0, earth_m)
    lat = limits.within(lat, -90.0, 90.0)
    return rounded(lat * 1e7), rounded(((lon + 180.0) % 360.0 - 180.0) * 1e7)


def rounded(x: float) -> float:
    """Return the nearest integer as a float.

    A value without a nearest integer, such as NaN, is returned unchanged.
    """
    return math.floor(x + 0.5) if abs(x) < 1e15 else x
