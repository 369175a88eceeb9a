"""Stopping distance after a hold command, from a model with limited acceleration and jerk. Pure.

A stop from speed v with |a| <= A and |da/dt| <= J, which starts and ends with a = 0, is symmetric in time. So
its distance is v T / 2:
    v <= A^2 / J:  T = 2 sqrt(v / J)          otherwise:  T = v / A + A / J
Before the braking the vehicle flies on during the reaction time. This time is the sum of the age of the pose,
the transmission of the command, the change of mode, and the time in which the body swings back from an
accelerating tilt. docs/explanation/copilot.md compares the model with flights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACTION_S = 0.22
"""Time from the arrival of a pose to the beginning of the braking [s]: step, command, change of mode, control delay."""
SWING_S = 0.25
"""Time during which the present acceleration adds speed while the body swings back [s]."""
DISTANCE_FACTOR = 1.10
"""Measured ratio of the flown to the planned stopping distance [-]: above 1, because the controller lags behind."""


@dataclass(frozen=True, kw_only=True)
class BrakingLimits:
    """Limits of the deceleration and jerk with which N vehicles can stop, as arrays (N,).

    accel, jerk: limits of a horizontal stop [m/s2], [m/s3].
    up, down: deceleration when a climb or a descent is stopped [m/s2].
    """

    accel: Array
    jerk: Array
    up: Array
    down: Array


def stop(speed: Array, accel: Array, jerk: Array) -> tuple[Array, Array]:
    """Return the distance [m] and the duration [s] of the shortest stop from a speed.

    speed: not negative [m/s]. accel: limit [m/s2]. jerk: limit [m/s3].
    """
    short = 2.0 * np.sqrt(speed / jerk)
    took = np.where(speed <= accel * accel / jerk, short, speed / accel + accel / jerk)
    return speed * took / 2.0, took


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Prediction of how N vehicles stop if they are commanded to hold now.

    start: position now [m] [NED] (N, 3).
    v_n: velocity at the beginning of the braking [m/s] [NED] (N, 3).
    react_s: time before the braking [s] (N,).
    took_s: duration of the braking along north, east and down [s] (N, 3).
    """

    start: Array
    v_n: Array
    react_s: Array
    took_s: Array

    @property
    def way(self) -> Array:
        """Predicted displacement of N stopping vehicles from `start` to standstill [m] [NED] (N, 3)."""
        ways: Array = self.v_n * (self.react_s[:, None] + DISTANCE_FACTOR * 0.5 * self.took_s)
        return ways

    def path(self, times: Array, later_s: float = 0.0) -> Array:
        """Return the predicted positions of N stopping vehicles at K times [m] [NED] (N, K, 3).

        times: time since now [s] (K,). later_s: time from now to the hold command [s].
        """
        on = np.minimum(times[None, :], self.react_s[:, None] + later_s)[:, :, None]
        left = np.maximum(times[None, :] - self.react_s[:, None] - later_s, 0.0)[:, :, None]
        took = np.maximum(DISTANCE_FACTOR * self.took_s, 1e-6)[:, None, :]
        u = np.minimum(left / took, 1.0)
        # the speed's course of such a stop is close to v (1 - u^2 (3 - 2 u)); its integral has the same way, v T / 2
        at: Array = self.start[:, None, :] + self.v_n[:, None, :] * (
            on + took * (u - u * u * u * (1.0 - 0.5 * u))
        )
        return at


def predict_stops(p_n: Array, v_n: Array, accel_n: Array, react_s: Array, limits: BrakingLimits) -> Stop:
    """Return the predicted stops of all vehicles if they are commanded to hold now.

    p_n: positions [m] [NED] (N, 3). v_n: velocities [m/s] [NED] (N, 3).
    accel_n: horizontal acceleration, computed from the tilt [m/s2] [NED] (N, 3).
    react_s: delay in addition to REACTION_S [s] (N,).
    Only acceleration along the velocity is used, and only if it makes the stop longer.
    """
    flat = v_n[:, :2]
    speed = np.hypot(flat[:, 0], flat[:, 1])
    along = flat / np.maximum(speed, 1e-9)[:, None]
    gained = SWING_S * np.maximum((accel_n[:, :2] * along).sum(1), 0.0)
    fastest = speed + gained
    _, took = stop(fastest, limits.accel, limits.jerk)
    climb = v_n[:, 2]
    _, took_z = stop(np.abs(climb), np.where(climb < 0.0, limits.up, limits.down), limits.jerk)
    braking = np.column_stack([along * fastest[:, None], climb])
    return Stop(
        start=p_n, v_n=braking, react_s=react_s + REACTION_S, took_s=np.column_stack([took, took, took_z])
    )
