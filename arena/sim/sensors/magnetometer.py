"""Magnetometer. The simulated field is typical of mid-northern latitudes and is rotated by the arena's
heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site
from arena.wire.hil import HilFields

# Mid-northern latitudes: a field of 0.48 gauss that dips 64 degrees; the declination is assumed to be zero.
_FIELD_GAUSS, _DIP_RAD = 0.48, math.radians(64.0)


class Magnetometer(Sensor):
    """Magnetometer: measures the magnetic field [gauss] [FRD] (V, 3)."""

    stream = 1
    channels = (
        Channel(axes=3, noise="noise_gauss", default_noise=0.002, bias="bias_gauss", default_bias=0.002),
    )
    readings = ("mag_b",)
    on_request = False
    log_columns = ("imu.mag",)
    hil = HilFields(bits=0x1C0, every=3, first=6, values=lambda sensors, row: sensors["mag_b"][row].tolist())

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site) -> None:
        level, down = math.cos(_DIP_RAD) * _FIELD_GAUSS, math.sin(_DIP_RAD) * _FIELD_GAUSS
        heading = site.heading_rad
        self._field_n = np.array([level * math.cos(heading), -level * math.sin(heading), down])

    def sample(self, noise: Array, motion: Motion) -> dict[str, Array]:
        """Return mag_b [gauss] [FRD] (V, 3)."""
        noise += self._field_n @ motion.r_nb
        return {"mag_b": noise}
