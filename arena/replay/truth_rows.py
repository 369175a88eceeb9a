"""True states of all replayed vehicles, in the form that the truth page and the recorder need. Pure."""

from __future__ import annotations

import numpy as np

from arena.constants import MAX_ROTORS
from arena.replay.script import TrueState
from arena.wire.truth_page import Truth


class TruthRows:
    """Table of the newest recorded true state of each vehicle. Row i belongs to vehicle i.

    vehicles: number of vehicles; row i is vehicle i.

    Specific force and rotor outputs are not recorded: they are 0.
    """

    def __init__(self, vehicles: int) -> None:
        self._p_n, self._v_n, self._omega_b = (np.zeros((vehicles, 3)) for _ in range(3))
        self._q_nb = np.tile([1.0, 0.0, 0.0, 0.0], (vehicles, 1))
        self._accel_b, self._motors = np.zeros((vehicles, 3)), np.zeros((vehicles, MAX_ROTORS))
        self.fresh: set[int] = set()

    def set(self, vehicle: int, state: TrueState) -> None:
        """Store the true state of one vehicle.

        vehicle: its index.
        """
        self._p_n[vehicle], self._v_n[vehicle] = state.p_n, state.v_n
        self._q_nb[vehicle], self._omega_b[vehicle] = state.q_nb, state.omega_b
        self.fresh.add(vehicle)

    def take(self, time_s: float) -> Truth:
        """Return the newest true states of all vehicles, stamped with a time of the replay's clock [s]."""
        self.fresh.clear()
        return Truth(
            time_s=time_s,
            p_n=self._p_n,
            q_nb=self._q_nb,
            v_n=self._v_n,
            omega_b=self._omega_b,
            accel_b=self._accel_b,
            motors=self._motors,
        )
