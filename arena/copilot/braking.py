"""How far a vehicle goes on before it stands, told to hold: reaction, swing, and a stop limited in acceleration and jerk. Pure.

A stop from speed v with |a| <= A and |da/dt| <= J, from and to a = 0, is symmetric in time, so its way is v T / 2:
    v <= A^2 / J:  T = 2 sqrt(v / J)          otherwise:  T = v / A + A / J
Before it the vehicle flies on for the reaction: the age of its pose, the command's way, the change of mode, and the time that the
body needs to swing back from the lean with which it was still speeding up. docs/explanation/copilot.md holds it against flights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACTION_S = 0.22
"""From a pose's arrival to a body that begins to brake: look, command, change of mode, tracking of the new course."""
SWING_S = 0.25
"""How long the acceleration of the moment goes on to add speed while the body swings back."""
LONGER = 1.10
"""The controller's lag behind its own course, as flown: the way is so much longer than the course's."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Of each vehicle, (N,): accel, jerk of a horizontal stop [m/s2], [m/s3]; up, down: of a climb's and a descent's [m/s2]."""

    accel: Array
    jerk: Array
    up: Array
    down: Array


def stop(speed: Array, accel: Array, jerk: Array) -> tuple[Array, Array]:
    """speed, not negative [m/s]; limits [m/s2], [m/s3] -> its way [m] and duration [s] of the shortest stop."""
    short = 2.0 * np.sqrt(speed / jerk)
    took = np.where(speed <= accel * accel / jerk, short, speed / accel + accel / jerk)
    return speed * took / 2.0, took


@dataclass(frozen=True, kw_only=True)
class Stop:
    """N vehicles told to hold now. start [m] [NED] (N, 3); v_n: speed at which each brakes [m/s] [NED] (N, 3).

    react_s (N,): how long it flies on at that; took_s (N, 2): how long it then brakes, horizontally and vertically [s].
    """

    start: Array
    v_n: Array
    react_s: Array
    took_s: Array

    @property
    def way(self) -> Array:
        """From start to standstill [m] [NED] (N, 3)."""
        ways: Array = self.v_n * (self.react_s[:, None] + LONGER * 0.5 * self._took)
        return ways

    @property
    def _took(self) -> Array:
        return self.took_s[:, (0, 0, 1)]

    def path(self, times: Array, later_s: float = 0.0) -> Array:
        """Where each is at these times [s] (K,) when it is told so much later [s] -> [m] [NED] (N, K, 3)."""
        on = np.minimum(times[None, :], self.react_s[:, None] + later_s)[:, :, None]
        left = np.maximum(times[None, :] - self.react_s[:, None] - later_s, 0.0)[:, :, None]
        took = np.maximum(LONGER * self._took, 1e-6)[:, None, :]
        u = np.minimum(left / took, 1.0)
        # the speed's course of such a stop is close to v (1 - u^2 (3 - 2 u)); its integral has the same way, v T / 2
        at: Array = self.start[:, None, :] + self.v_n[:, None, :] * (on + took * (u - u**3 + 0.5 * u**4))
        return at


def stops(p_n: Array, v_n: Array, accel_n: Array, react_s: Array, limits: Limits) -> Stop:
    """p_n [m], v_n [m/s], accel_n: horizontal, as the lean tells [m/s2], all [NED] (N, 3); react_s: beside REACTION_S [s] (N,).

    Only an acceleration along the way counts, and never shortens it.
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
    return Stop(start=p_n, v_n=braking, react_s=react_s + REACTION_S, took_s=np.column_stack([took, took_z]))
