"""Vehicles that fly steadily in OFFBOARD: their commanders decide five times a second instead of 50 times.

In most steps a decision changes nothing, and it takes more time than the estimator and the controllers of the vehicle together.
A vehicle is *steady* if it flies in OFFBOARD, no failsafe acts or waits, and the inputs of its commander can change the decision
only by what the kernel `steady_flight` checks in each step. All other causes of a decision call `wake`: received messages (also
those that change parameters) and requests of the supervisor. So all decisions are the same as without this module, at the same
times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import Mode
from arena.autopilot.vehicle import Vehicle
from arena.kernels.arrays import view
from arena.kernels.offboard_setpoints import OffboardSetpoints
from arena.kernels.steady_flight import SteadyFlight

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LONGEST_PAUSE_S = 0.2
"""Longest time between two decisions of a vehicle [s]. If a cause of a decision is missing in this module, the decision is late
by this time at most."""


class SteadyFlights:
    """Selection of the vehicles that need a decision now.

    landed: True if on the ground (V,).  flying: True if the take-off is complete (V,)
    """

    def __init__(self, est: Estimator, offboard: OffboardSetpoints, landed: Mask, flying: Mask) -> None:
        self._law = SteadyFlight(offboard, est.validity, landed, flying)
        self._steady = np.asarray(self._law.steady)

    def rows_to_decide(self, now: float, battery: Array) -> list[int]:
        """Return the rows of the vehicles that need a decision now. All others only follow their newest setpoint.

        now: time since boot [s].  battery: remaining charge 0..1 (V,)
        """
        return self._law.rows_to_decide(now, view(battery))

    def wake(self, row: int) -> None:
        """Make a vehicle decide in the next decision step."""
        self._law.steady[row] = False

    def wake_all(self) -> None:
        """Make all vehicles decide in the next decision step."""
        self._steady[:] = False

    def update(self, v: Vehicle, now: float) -> None:
        """Update whether a vehicle is steady, after its decision. now: time since boot [s]"""
        law, row = self._law, v.row
        if _may_be_steady(v):
            p = v.commander_params
            law.decide_at[row] = now + _LONGEST_PAUSE_S
            law.max_tilt[row], law.max_setpoint_age[row] = p.fd_fail_rad, p.com_of_loss_t
            law.min_battery[row] = max(p.bat_low_thr, p.bat_crit_thr, p.bat_emergen_thr)
            law.set_steady(row, now, v.inputs.battery)


def _may_be_steady(v: Vehicle) -> bool:
    """Return whether the vehicle may fly steadily. The kernel `steady_flight` checks the other conditions."""
    c, s = v.commander, v.inputs
    return (
        c.mode is Mode.OFFBOARD
        and c.armed
        and c.took_off
        and not c.failsafe
        and not c.had_manual_control
        and not v.commander_params.nav_dll_act
        and not s.has_fence
    )
