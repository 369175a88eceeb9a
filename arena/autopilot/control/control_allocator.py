"""Control allocation: torques and thrust to motor commands, batched over vehicles. Pure.

The rows are normalised as on PX4, so that its gains have the same effect. For a symmetric quadrotor X: u =
    thrust +- 0.707 roll +- 0.707 pitch +- yaw
When motors saturate, first the thrust is reduced, then roll and pitch by a common factor, then yaw: tilt has
    priority over heading.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def allocation_rows(rotors: Sequence[dict[str, Any]]) -> Array:
    """Return the weights of roll, pitch and yaw for each rotor (R, 3).

    rotors: each with `position_m` [m] [FRD] and `direction`, cw or ccw seen from above
    """
    position = np.array([r["position_m"] for r in rotors], float)
    spin = np.array([1.0 if r["direction"] == "ccw" else -1.0 for r in rotors])
    # Thrust pulls up (-z): torque = r x (0, 0, -T) = (-y, x, 0) T. A rotor turning ccw from above turns the
    # body cw: +yaw.
    effect = np.stack([-position[:, 1], position[:, 0], spin], axis=-1)
    inverse = np.linalg.pinv(np.column_stack([effect, np.ones(len(effect))]).T)[:, :3]
    count = max(int((np.abs(inverse[:, 0]) > 1e-6).sum()), 1)
    tilt_scale = max(float(np.sqrt((inverse[:, a] ** 2).sum() / (count / 2.0))) for a in (0, 1))
    scale = np.array([tilt_scale, tilt_scale, float(np.abs(inverse[:, 2]).max())])
    return np.asarray(inverse / np.maximum(scale, 1e-9))


class ControlAllocator:
    """Control allocation of V vehicles.

    rows: weights from `allocation_rows`, zero for rotors that a vehicle does not have (V, R, 3)
    present: which rotors exist (V, R)
    """

    def __init__(self, rows: Array, present: NDArray[np.bool_]) -> None:
        self.rows, self.present = rows, present
        self._tilt_rows, self._yaw_rows = rows[:, :, :2].copy(), rows[:, :, 2].copy()

    def allocate(self, torque: Array, thrust: Array) -> tuple[Array, Array]:
        """Return the motor commands 0..1 (V, R), and the signs of the torque that was not delivered (V, 3).

        torque: normalised roll, pitch, yaw torque [-] [FRD] (V, 3)
        thrust: collective 0..1 (V,)
        """
        tilt = (self._tilt_rows @ torque[:, :2, None])[:, :, 0]
        high, low = tilt.max(1), tilt.min(1)
        fit = np.minimum(1.0, 1.0 / np.maximum(high - low, 1e-9))
        tilt = tilt * fit[:, None]
        lift = np.minimum(thrust, 1.0 - high * fit)  # reduce the thrust, never raise it
        # Without airmode a low thrust reduces roll and pitch; it is not raised for them.
        room = np.minimum(1.0, np.maximum(lift, 0.0) / np.maximum(-low * fit, 1e-9))
        base = np.maximum(lift, 0.0)[:, None] + tilt * room[:, None]
        yaw = self._yaw_rows * torque[:, 2:]
        # A rotor without a share in yaw has size 0 and does not limit the yaw.
        size = np.abs(yaw)
        left = np.where(size > 0, np.where(yaw > 0, 1.0 - base, base), np.inf) / np.maximum(size, 1e-9)
        yaw_fit = np.maximum(left.min(1, initial=1.0), 0.0)
        u = np.minimum(np.maximum(base + yaw * yaw_fit[:, None], 0.0), 1.0) * self.present
        kept = np.empty_like(torque)
        kept[:, 0] = kept[:, 1] = fit * room
        kept[:, 2] = yaw_fit
        return u, np.sign(torque) * (kept < 0.999)
