"""The international standard atmosphere below 11 km (ISO 2533): height above mean sea level <-> pressure."""

from __future__ import annotations

SEA_LEVEL_HPA = 1013.25


def pressure_hpa(height_m: float) -> float:
    """Static pressure [hPa] at a height above mean sea level [m]."""
    return float(SEA_LEVEL_HPA * (1.0 - 2.25577e-5 * height_m) ** 5.25588)
