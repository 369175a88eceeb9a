"""Control allocation: computes motor commands from torques and thrust.

When motors saturate, the thrust is reduced first, then roll and pitch by a common factor, then yaw, because tilt has
priority over heading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels import limits
from arena.kernels.arrays import flags, floats, view

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Array

YAW_MARGIN = 0.15
"""Share of the motor range by which the yaw torque may reduce the thrust [-], the value of PX4 v1.16."""


class ControlAllocation:
    """Control allocation of V vehicles with at most R rotors each.

    weights: roll, pitch and yaw weight of each rotor, zero for rotors that a vehicle does not have [-] (V, R, 3)
    present: True for each rotor that exists (V, R)
    torque: input: normalised roll, pitch, yaw torque [-] [FRD] (V, 3)
    thrust: input: collective thrust 0..1 (V,)
    motors: output: motor commands 0..1 (V, R)
    saturated: output: for each torque axis whether the motors cannot deliver the torque: the sign of the requested
        torque, 0 for axes with their full torque. The rate controller needs these signs to stop its integrals (V, 3)
    """

    def __init__(self, weights: Array, present: NDArray[np.bool_]) -> None:
        vehicles, rotors = present.shape
        self.weights, self.present = view(weights), flags(present)
        self.torque, self.thrust = floats(vehicles, 3), floats(vehicles)
        self.motors, self.saturated = floats(vehicles, rotors), floats(vehicles, 3)
        self._tilt, self._yaw = floats(rotors), floats(rotors)

    def step(self) -> None:
        """Compute the motor commands of all vehicles."""
        for i in range(len(self.thrust)):
            self._allocate(i)

    def _allocate(self, i: int) -> None:
        tilt, rotors = self._tilt, len(self._tilt)
        high = low = 0.0
        for k in range(rotors):
            tilt[k] = self.weights[i, k, 0] * self.torque[i, 0] + self.weights[i, k, 1] * self.torque[i, 1]
            high = tilt[k] if k == 0 else max(high, tilt[k])
            low = tilt[k] if k == 0 else min(low, tilt[k])
        fit = min(1.0, 1.0 / max(high - low, 1e-9))
        lift = max(min(self.thrust[i], 1.0 - high * fit), 0.0)  # reduce the thrust, never raise it
        # Without airmode a low thrust reduces roll and pitch; it is not raised for them.
        room = min(1.0, lift / max(-low * fit, 1e-9))
        for k in range(rotors):
            tilt[k] = lift + tilt[k] * fit * room
        yaw_fit = self._add_yaw(i)
        self._limit(i)
        for axis in range(3):
            kept = yaw_fit if axis == 2 else fit * room
            torque = self.torque[i, axis] if kept < 0.999 else 0.0
            self.saturated[i, axis] = (1.0 if torque > 0.0 else -1.0) if torque != 0.0 else 0.0

    def _add_yaw(self, i: int) -> float:
        """Add the yaw torque to the motor commands of vehicle i. Return the share of this torque that fits, 0..1."""
        base, yaw, rotors = self._tilt, self._yaw, len(self._tilt)
        fastest, slowest = 0.0, 1.0
        for k in range(rotors):
            yaw[k] = self.weights[i, k, 2] * self.torque[i, 2]
            if yaw[k] > 0.0:
                fastest = max(fastest, base[k])
            elif yaw[k] < 0.0:
                slowest = min(slowest, base[k])
        # The motors that yaw speeds up and slows down get the same room: thrust is reduced by half the difference.
        less = min(max(0.5 * (fastest + slowest - 1.0), 0.0), YAW_MARGIN)
        share = 1.0
        for k in range(rotors):
            # A rotor without a share in yaw does not limit the yaw.
            if yaw[k] > 0.0:
                share = min(share, (1.0 + less - base[k]) / max(yaw[k], 1e-9))
            elif yaw[k] < 0.0:
                share = min(share, (base[k] - less) / max(-yaw[k], 1e-9))
        share = max(share, 0.0)
        for k in range(rotors):
            base[k] += yaw[k] * share
        return share

    def _limit(self, i: int) -> None:
        """Limit the motor commands of vehicle i to 0..1.

        First the same number is subtracted from all commands, so that none exceeds 1.
        """
        commands, most = self._tilt, 1.0
        for k in range(len(commands)):
            most = max(most, commands[k])
        for k in range(len(commands)):
            command = limits.within(commands[k] - (most - 1.0), 0.0, 1.0)
            self.motors[i, k] = command if self.present[i, k] else 0.0
