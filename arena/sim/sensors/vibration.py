"""Vibration of the inertial measurement unit, caused by the imbalance of the rotors.

A rotating imbalance pulls with a force proportional to the square of the rotor speed, once per revolution (W. T. Thomson,
"Theory of Vibration with Applications", section "Rotating unbalance"). The model has one frequency for all rotors, and
the same amplitude on each axis with another phase. The sensor does not filter it, so a frequency above half the sensor
rate appears at a lower one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.portable_math import sin

Array = NDArray[np.float64]

_PHASES = 2.0 * math.pi * np.array([0.0, 0.25, 0.6, 0.4, 0.85, 0.1])  # of the six axes, so that they differ


class Vibration:
    """Vibration of the inertial measurement units of V vehicles.

    profiles: profiles of the vehicles, with the keys under `sensors: imu:`
    period_s: period of the sensor steps [s]
    on: whether any vehicle vibrates
    """

    def __init__(self, profiles: Sequence[Mapping[str, Any]], period_s: float) -> None:
        keys = [profile.get("sensors", {}).get("imu", {}) for profile in profiles]
        names = ("accel_vibration_m_s2", "gyro_vibration_rad_s")
        rms = np.array([[imu.get(name, 0.0) for name in names] for imu in keys], float)
        self._amplitude = math.sqrt(2.0) * rms.repeat(3, axis=1)
        hz = np.array([imu.get("vibration_hz", 0.0) for imu in keys], float)
        self._turn = 2.0 * math.pi * hz * period_s  # angle of one step in hover [rad]
        self._angle = np.zeros(len(keys))
        self.on = bool(self._amplitude.any())

    def sample(self, spin: Array, hover: Array) -> Array:
        """Advance by one step. Return the vibration of specific force [m/s2] and body rates [rad/s] [FRD] (V, 6).

        spin: rotor state 0..1, about proportional to the rotor speed; zero for a rotor that is not there [-] (V, R)
        hover: rotor state in hover [-] (V,)
        """
        turning = np.maximum((spin > 0.0).sum(1), 1)
        speed = spin.sum(1) / turning / hover  # mean of the rotors that turn; 1 in hover
        self._angle = (self._angle + self._turn * speed) % (2.0 * math.pi)
        swing = sin(self._angle[:, None] + _PHASES)
        return np.asarray(self._amplitude * (speed * speed)[:, None] * swing)
