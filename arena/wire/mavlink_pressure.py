"""Unit of the pressure in HIGHRES_IMU, which depends on the autopilot. Pure."""

HPA_PA = 100.0
HIGHEST_HPA = 2000.0
"""A greater pressure is in pascal."""


def pressure_pa(abs_pressure: float) -> float:
    """Return the field `abs_pressure` of HIGHRES_IMU in pascal. MAVLink defines hPa, but PX4 (checked: v1.16) sends Pa."""
    return abs_pressure if abs_pressure > HIGHEST_HPA else abs_pressure * HPA_PA
