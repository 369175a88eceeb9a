"""International standard atmosphere below 11 km (ISO 2533): pressure as a function of height."""

from __future__ import annotations

from arena.kernels import standard_atmosphere
from arena.portable_math import for_arrays

pressure_hpa = for_arrays(standard_atmosphere.pressure_hpa, 1)
"""Function of a height above mean sea level [m], a number or an array: returns the static pressure there [hPa]."""
