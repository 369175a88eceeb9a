"""Barometer: measures the pressure altitude above mean sea level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.kernels.standard_atmosphere import pressure_hpa
from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site
from arena.wire.hil import HilFields

_TEMPERATURE_DEG_C = 25.0


def _write_hil(values: NDArray[np.float32], sensors: Mapping[str, Array], row: int) -> None:
    """Write a vehicle's HIL_SENSOR values: pressures [hPa], altitude [m], temperature [deg C].

    The pressures are absolute pressure and differential pressure.
    """
    altitude = float(sensors["baro_alt_m"][row])
    values[:] = pressure_hpa(altitude), 0.0, altitude, _TEMPERATURE_DEG_C


class Barometer(Sensor):
    """Barometer that measures the altitude above mean sea level [m] (V,)."""

    stream = 4
    channels = (Channel(axes=1, noise="noise_m", default_noise=0.05, bias="bias_m", default_bias=0.2),)
    readings = ("baro_alt_m",)
    on_request = False
    log_columns = ("baro",)
    hil = HilFields(bits=0x1A00, every=5, first=9, count=4, write=_write_hil)

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site, period_s: float) -> None:
        self._altitude_m = site.origin.alt_m if site.origin else 0.0

    def views(self, values: Array) -> dict[str, Array]:
        """Return baro_alt_m, the altitude above mean sea level [m] (V,)."""
        return {"baro_alt_m": values[:, 0]}

    def measure(self, values: Array, motion: Motion) -> None:
        motion.measured.add_altitude(values, self._altitude_m)
