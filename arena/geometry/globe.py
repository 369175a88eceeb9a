"""Conversion between metres north and east of an origin and degrees of latitude and longitude. Scalars or arrays.

The projection is a plane that touches a sphere at the origin. In a room it equals PX4's azimuthal projection (v1.16,
src/lib/geo) within some micrometres.
"""

from __future__ import annotations

from typing import Any

import numpy as np

EARTH_M = 6_371_000.0
"""Radius of PX4's sphere [m]."""


def globe_from_local(lat0_deg: Any, lon0_deg: Any, north: Any, east: Any) -> tuple[Any, Any]:
    """Return latitude and longitude [deg], not wrapped, of a place north and east [m] of an origin [deg]."""
    return lat0_deg + np.degrees(north / EARTH_M), lon0_deg + np.degrees(
        east / (EARTH_M * np.cos(np.radians(lat0_deg)))
    )


def local_from_globe(lat0_deg: Any, lon0_deg: Any, lat_deg: Any, lon_deg: Any) -> tuple[Any, Any]:
    """Return north and east [m] of an origin [deg] for a latitude and longitude [deg], the shorter way round the Earth."""
    east_deg = (lon_deg - lon0_deg + 180.0) % 360.0 - 180.0
    return np.radians(lat_deg - lat0_deg) * EARTH_M, np.radians(east_deg) * np.cos(
        np.radians(lat0_deg)
    ) * EARTH_M
