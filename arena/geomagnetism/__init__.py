"""Magnetic field of the Earth at a place, by the World Magnetic Model 2025. Pure.

The epoch is 2025.0.

The table `wmm2025.csv` contains the Gauss coefficients [nT] of the model up to degree 12 (NOAA NCEI and British Geological
Survey, public domain, https://doi.org/10.25921/aqfd-sd83). The change with time is not used, so that a flight can be repeated:
the declination changes by about 0.2 deg per year.
"""

from __future__ import annotations

import csv
import functools
import math
from dataclasses import dataclass
from pathlib import Path

_TABLE = Path(__file__).with_name("wmm2025.csv")
_DEGREE = 12
_REFERENCE_RADIUS_M = 6_371_200.0
_EQUATOR_M, _FLATTENING = 6_378_137.0, 1.0 / 298.257223563  # WGS 84
_POLE_DEG = 89.999  # north and east are not defined at the poles
_NT_GAUSS = 1e-5


@dataclass(frozen=True, kw_only=True)
class MagneticField:
    """Magnetic field of the Earth at a place, in true north, east, down [gauss]."""

    north: float
    east: float
    down: float

    @property
    def declination_rad(self) -> float:
        """Direction of magnetic north, clockwise from true north [rad]."""
        return math.atan2(self.east, self.north)

    @property
    def inclination_rad(self) -> float:
        """Angle of the magnetic field below the horizontal [rad]."""
        return math.atan2(self.down, math.hypot(self.north, self.east))

    @property
    def strength(self) -> float:
        """Magnitude of the magnetic field [gauss]."""
        return math.hypot(self.north, self.east, self.down)


def magnetic_field(lat_deg: float, lon_deg: float, alt_m: float) -> MagneticField:
    """Return the magnetic field of the Earth at a place.

    lat_deg, lon_deg: geodetic latitude and longitude [deg]
    alt_m: altitude [m]; the height above the ellipsoid and above the sea level are not distinguished

    Source: The US/UK World Magnetic Model for 2025-2030, technical report, equations 7 to 17.
    """
    latitude = math.radians(min(max(lat_deg, -_POLE_DEG), _POLE_DEG))
    longitude = math.radians(lon_deg)
    geocentric, radius_m = _geocentric(latitude, alt_m)
    legendre, slope = _legendre(geocentric)
    north = east = down = 0.0
    for n, m, g, h in _coefficients():
        scale = (_REFERENCE_RADIUS_M / radius_m) ** (n + 2)
        c, s = math.cos(m * longitude), math.sin(m * longitude)
        north -= scale * (g * c + h * s) * slope[n][m]
        east += scale * m * (g * s - h * c) * legendre[n][m] / math.cos(geocentric)
        down -= scale * (n + 1) * (g * c + h * s) * legendre[n][m]
    # from geocentric to geodetic north and down
    c, s = math.cos(geocentric - latitude), math.sin(geocentric - latitude)
    return MagneticField(
        north=_NT_GAUSS * (north * c - down * s),
        east=_NT_GAUSS * east,
        down=_NT_GAUSS * (north * s + down * c),
    )


def _geocentric(latitude: float, alt_m: float) -> tuple[float, float]:
    """Return the geocentric latitude [rad] and the distance from the Earth's centre [m] of a place."""
    eccentricity = _FLATTENING * (2.0 - _FLATTENING)
    curvature_m = _EQUATOR_M / math.sqrt(1.0 - eccentricity * math.sin(latitude) ** 2)
    level_m = (curvature_m + alt_m) * math.cos(latitude)
    up_m = (curvature_m * (1.0 - eccentricity) + alt_m) * math.sin(latitude)
    return math.atan2(up_m, level_m), math.hypot(level_m, up_m)


def _legendre(latitude: float) -> tuple[list[list[float]], list[list[float]]]:
    """Return Schmidt's semi-normalised Legendre functions P[n][m] of sin(latitude), and their derivatives.

    The derivatives are by the latitude.
    """
    x, y = math.sin(latitude), math.cos(latitude)
    p = [[0.0] * (_DEGREE + 1) for _ in range(_DEGREE + 1)]
    dp = [[0.0] * (_DEGREE + 1) for _ in range(_DEGREE + 1)]
    p[0][0] = 1.0
    for n in range(1, _DEGREE + 1):
        diagonal = math.sqrt(1.0 - 0.5 / n) if n > 1 else 1.0
        p[n][n] = diagonal * y * p[n - 1][n - 1]
        dp[n][n] = diagonal * (y * dp[n - 1][n - 1] - x * p[n - 1][n - 1])
        for m in range(n):
            before = math.sqrt((n - 1) ** 2 - m * m) if n > 1 and m < n - 1 else 0.0
            norm = math.sqrt(n * n - m * m)
            older, slope_older = (p[n - 2][m], dp[n - 2][m]) if n > 1 else (0.0, 0.0)
            p[n][m] = ((2 * n - 1) * x * p[n - 1][m] - before * older) / norm
            dp[n][m] = ((2 * n - 1) * (x * dp[n - 1][m] + y * p[n - 1][m]) - before * slope_older) / norm
    return p, dp


@functools.cache
def _coefficients() -> tuple[tuple[int, int, float, float], ...]:
    """Return the coefficients of the World Magnetic Model as rows (degree n, order m, g [nT], h [nT])."""
    with _TABLE.open(newline="") as file:
        return tuple(
            (int(row["n"]), int(row["m"]), float(row["g_nt"]), float(row["h_nt"]))
            for row in csv.DictReader(file)
        )
