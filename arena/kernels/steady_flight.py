"""Recognises the vehicles that fly steadily in OFFBOARD, for which a decision of the commander would change nothing. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arena.kernels.arrays import flags, floats, new_flags

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from arena.kernels.arrays import Flags, Floats
    from arena.kernels.estimate_validity import EstimateValidity
    from arena.kernels.offboard_setpoints import OffboardSetpoints

    Mask = NDArray[np.bool_]


class SteadyFlight:
    """Search for the vehicles that need a decision, among V vehicles.

    steady: True for a vehicle whose last decision found nothing to do, and which flies in OFFBOARD; False makes it decide (V,)
    decide_at: input: time from which a vehicle needs a decision in any case [s] (V,)
    max_tilt: input: tilt above which a vehicle needs a decision [rad] (V,)
    min_battery: input: charge at or below which a vehicle needs a decision 0..1 (V,)
    max_setpoint_age: input: age of the setpoint above which a vehicle needs a decision [s] (V,)
    """

    def __init__(
        self, offboard: OffboardSetpoints, validity: EstimateValidity, landed: Mask, flying: Mask
    ) -> None:
        """Create the search.

        offboard: newest setpoints
        validity: whether the estimates are valid, and the tilt
        landed, flying: input: whether a vehicle is on the ground, and whether its take-off is complete (V,)
        """
        v = len(landed)
        self.offboard, self.validity = offboard, validity
        self.landed, self.flying = flags(landed), flags(flying)
        self.steady: Flags = new_flags(v)
        self.decide_at, self.max_tilt = floats(v), floats(v)
        self.min_battery, self.max_setpoint_age = floats(v), floats(v)

    def rows_to_decide(self, now: float, battery: Floats) -> list[int]:
        """Return the rows of the vehicles that need a decision now. For all others, copy the newest setpoint to the controllers.

        now: time since boot [s].  battery: remaining charge 0..1 (V,)
        """
        rows = []
        for i in range(len(self.steady)):
            if self.steady[i] and self._holds(i, now, battery[i]):
                self.offboard.copy(i)
            else:
                self.steady[i] = False
                rows.append(i)
        return rows

    def set_steady(self, i: int, now: float, battery: float) -> None:
        """Set whether vehicle i is steady: whether all conditions of a steady flight hold now.

        The caller sets the time and the limits of the vehicle before.
        """
        self.steady[i] = self._holds(i, now, battery)

    def _holds(self, i: int, now: float, battery: float) -> bool:
        """Return whether all conditions of a steady flight hold for vehicle i. NaN fulfils no condition."""
        validity = self.validity
        return (
            now < self.decide_at[i]
            and now - self.offboard.received_at[i] <= self.max_setpoint_age[i]
            and validity.xy[i] != 0
            and validity.z[i] != 0
            and validity.yaw[i] != 0
            and validity.state.aligned[i] != 0
            and validity.tilt[i] <= self.max_tilt[i]
            and battery > self.min_battery[i]
            and self.landed[i] == 0
            and self.flying[i] != 0
        )
