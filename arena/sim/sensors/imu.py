"""Inertial measurement unit: accelerometer and gyroscope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site
from arena.sim.sensors.vibration import Vibration
from arena.wire.hil import HilFields


def _write_hil(values: NDArray[np.float32], sensors: Mapping[str, Array], row: int) -> None:
    """Write a vehicle's HIL_SENSOR values: specific force [m/s2] and body rates [rad/s] [FRD]."""
    values[:3], values[3:] = sensors["accel_b"][row], sensors["gyro_b"][row]


class Imu(Sensor):
    """Inertial measurement units of V vehicles: specific force [m/s2] and body rates [rad/s] [FRD] (V, 3)."""

    stream = 1
    channels = (
        Channel(
            axes=3,
            noise="accel_noise_m_s2",
            default_noise=0.05,
            bias="accel_bias_m_s2",
            default_bias=0.03,
            walk="accel_bias_walk_m_s2_per_sqrt_s",
            range="accel_range_m_s2",
            default_range=156.9,
        ),
        Channel(
            axes=3,
            noise="gyro_noise_rad_s",
            default_noise=0.003,
            bias="gyro_bias_rad_s",
            default_bias=0.002,
            walk="gyro_bias_walk_rad_s_per_sqrt_s",
            range="gyro_range_rad_s",
            default_range=34.9,
        ),
    )
    readings = ("accel_b", "gyro_b")
    on_request = False
    log_columns = ("imu.acc_body", "imu.ang_vel")
    hil = HilFields(
        bits=0x03F,
        every=1,
        first=0,
        count=6,
        write=_write_hil,
    )

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site, period_s: float) -> None:
        self._vibration = Vibration(profiles, period_s)

    def views(self, values: Array) -> dict[str, Array]:
        """Return the specific force accel_b [m/s2] and the body rates gyro_b [rad/s], both [FRD] (V, 3)."""
        return {"accel_b": values[:, 0:3], "gyro_b": values[:, 3:6]}

    def measure(self, values: Array, motion: Motion) -> None:
        motion.measured.add_inertial(values)
        if self._vibration.on:
            values += self._vibration.sample(motion.spin, motion.hover)
