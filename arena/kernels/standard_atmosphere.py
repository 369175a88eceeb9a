"""International standard atmosphere below 11 km (ISO 2533): pressure as a function of height."""

from __future__ import annotations

import math

SEA_LEVEL_HPA = 1013.25


def pressure_hpa(height_m: float) -> float:
    """Return the static pressure [hPa] at a height above mean sea level [m]. 0 above 44 km, where the formula has no result."""
    share = 1.0 - 2.25577e-5 * height_m
    return 0.0 if share < 0.0 else SEA_LEVEL_HPA * math.pow(share, 5.25588)
