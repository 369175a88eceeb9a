"""Control allocation: computes motor commands from torques and thrust, batched over vehicles. Pure.

The weights come from the vehicle's class (`arena.vehicle_models`). When motors saturate, the thrust is
reduced first, then roll and pitch by a common factor, then yaw, because tilt has priority over heading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

YAW_MARGIN = 0.15
"""Share of the motor range by which the yaw torque may reduce the thrust [-], the value of PX4 v1.16."""


class ControlAllocator:
    """Control allocation of V vehicles with at most R rotors each.

    rows: weights from `VehicleModel.allocation`, zero for rotors that a vehicle does not have (V, R, 3)
    present: True for each rotor that exists (V, R)
    """

    def __init__(self, rows: Array, present: NDArray[np.bool_]) -> None:
        self.rows, self.present = rows, present
        self._tilt_rows, self._yaw_rows = rows[:, :, :2].copy(), rows[:, :, 2].copy()

    def allocate(self, torque: Array, thrust: Array) -> tuple[Array, Array]:
        """Return the motor commands 0..1 (V, R), and for each torque axis whether the motors cannot deliver the torque (V, 3).

        An axis with less torque than requested has the sign of the requested torque; other axes have 0. The rate
        controller needs these signs to stop its integrals.

        torque: normalised roll, pitch, yaw torque [-] [FRD] (V, 3)
        thrust: collective thrust 0..1 (V,)
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
        u = base + yaw
        yaw_fit: Array | float = 1.0
        if u.min() < 0.0 or u.max() > 1.0:
            fit_yaw = self._yaw_fit(base, yaw)
            yaw_fit, u = fit_yaw, base + yaw * fit_yaw[:, None]
            u -= np.maximum(u.max(1, keepdims=True) - 1.0, 0.0)
            u = np.minimum(np.maximum(u, 0.0), 1.0)
        u *= self.present
        kept = np.empty_like(torque)
        kept[:, 0] = kept[:, 1] = fit * room
        kept[:, 2] = yaw_fit
        return u, np.sign(torque) * (kept < 0.999)

    def _yaw_fit(self, base: Array, yaw: Array) -> Array:
        """Return the share of the yaw torque that the motors can deliver 0..1 (V,).

        base, yaw: motor commands without yaw, and their change for yaw [-] (V, R)
        """
        rises = yaw > 0
        # The motors that yaw speeds up and slows down get the same room: thrust is reduced by half the difference.
        fastest = np.where(rises, base, 0.0).max(1)
        slowest = np.where(yaw < 0, base, 1.0).min(1)
        less = np.minimum(np.maximum(0.5 * (fastest + slowest - 1.0), 0.0), YAW_MARGIN)[:, None]
        # A rotor without a share in yaw has size 0 and does not limit the yaw.
        size = np.abs(yaw)
        left = np.where(size > 0, np.where(rises, 1.0 + less - base, base - less), np.inf)
        return np.asarray(np.maximum((left / np.maximum(size, 1e-9)).min(1, initial=1.0), 0.0))
