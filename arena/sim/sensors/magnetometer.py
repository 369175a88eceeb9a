"""Magnetometer: measures the Earth's magnetic field in body axes.

The simulated field is the field of the Earth at the arena's origin, rotated by the arena's heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.geomagnetism import MagneticField, magnetic_field
from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site
from arena.wire.hil import HilFields

_WITHOUT_ORIGIN = MagneticField(
    north=0.2104, east=0.0, down=0.4314
)  # mid-northern latitudes, declination zero


def _write_hil(values: NDArray[np.float32], sensors: Mapping[str, Array], row: int) -> None:
    """Write a vehicle's HIL_SENSOR values: magnetic field [gauss] [FRD]."""
    values[:] = sensors["mag_b"][row]


class Magnetometer(Sensor):
    """Magnetometers of V vehicles: magnetic field [gauss] [FRD] (V, 3)."""

    stream = 3
    channels = (
        Channel(axes=3, noise="noise_gauss", default_noise=0.002, bias="bias_gauss", default_bias=0.002),
    )
    readings = ("mag_b",)
    on_request = False
    log_columns = ("imu.mag",)
    hil = HilFields(bits=0x1C0, every=3, first=6, count=3, write=_write_hil)

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site, period_s: float) -> None:
        at = site.origin
        field = magnetic_field(at.lat_deg, at.lon_deg, at.alt_m) if at is not None else _WITHOUT_ORIGIN
        c, s = math.cos(site.heading_rad), math.sin(site.heading_rad)
        # from true north to the arena's north
        self._field_n = c * field.north + s * field.east, c * field.east - s * field.north, field.down

    def views(self, values: Array) -> dict[str, Array]:
        """Return the measured magnetic field mag_b [gauss] [FRD] (V, 3)."""
        return {"mag_b": values}

    def measure(self, values: Array, motion: Motion) -> None:
        motion.measured.add_field(values, *self._field_n)
