"""Control allocation of the built-in autopilot: computes motor commands from torques and thrust. Pure.

The weights come from the vehicle's class (`arena.vehicle_models`). The formulas are in `arena.kernels.control_allocation`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import array
from arena.kernels.control_allocation import ControlAllocation
from arena.vehicle_models import vehicle_model

Array = NDArray[np.float64]


class ControlAllocator:
    """Control allocation of V vehicles (at most R rotors each): computes motor commands from torques and thrust.

    rows: weights from `VehicleModel.allocation`, zero for rotors that a vehicle does not have (V, R, 3)
    present: True for each rotor that exists (V, R)
    torque, thrust: last arguments of `allocate` (V, 3) and (V,)
    law: the compiled control allocation
    """

    def __init__(self, rows: Array, present: NDArray[np.bool_]) -> None:
        self.rows, self.present = rows, present
        self.law = law = ControlAllocation(rows, present)
        self.torque, self.thrust = array(law.torque), array(law.thrust)
        self._motors, self._saturated = array(law.motors), array(law.saturated)

    @classmethod
    def of(cls, profiles: Sequence[Mapping[str, Any]]) -> ControlAllocator:
        """Create the control allocation of all vehicles from their profiles, which describe the rotors."""
        most = max((len(p["rotors"]) for p in profiles), default=4)
        rows, present = np.zeros((len(profiles), most, 3)), np.zeros((len(profiles), most), bool)
        for i, p in enumerate(profiles):
            count = len(p["rotors"])
            rows[i, :count], present[i, :count] = vehicle_model(p).allocation(p["rotors"]), True
        return cls(rows, present)

    def allocate(self, torque: Array, thrust: Array) -> tuple[Array, Array]:
        """Return the motor commands 0..1 (V, R), and which torques the motors cannot deliver (V, 3).

        The next call changes both arrays. An axis with less torque than requested has the sign of the requested
        torque; other axes have 0. The rate controller needs these signs to stop its integrals.

        torque: normalised roll, pitch, yaw torque [-] [FRD] (V, 3)
        thrust: collective thrust 0..1 (V,)
        """
        self.torque[...], self.thrust[...] = torque, thrust
        self.law.step()
        return self._motors, self._saturated
