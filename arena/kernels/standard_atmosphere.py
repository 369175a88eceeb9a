"""International standard atmosphere below 11 km (ISO 2533): pressure as a function of height."""

from __future__ import annotations

import math

SEA_LEVEL_HPA = 1013.25


def pressure_hpa(height_m: float) -> float:
    """Return the static pressure [hPa] at a height above mean sea level [m]."""
    return SEA_LEVEL_HPA * math.pow(1.0 - 2.25577e-5 * height_m, 5.25588)
