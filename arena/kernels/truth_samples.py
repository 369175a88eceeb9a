"""Writes the true states of all vehicles into the truth page, whose layout is in `arena.wire.truth_rows`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats


class TruthSamples:
    """Writer of the true states of V vehicles, which it reads from the same arrays each time.

    page: numbers of the truth page
    per_vehicle: numbers of one vehicle in a row
    rotors: R
    p_n, q_nb, v_n, omega_b, accel_b, motors: as in `arena.wire.truth_page.Truth` (V, 3), q_nb (V, 4), motors (V, R)
    """

    def __init__(
        self,
        page: Floats,
        per_vehicle: int,
        rotors: int,
        p_n: Floats,
        q_nb: Floats,
        v_n: Floats,
        omega_b: Floats,
        accel_b: Floats,
        motors: Floats,
    ) -> None:
        self.page, self.per_vehicle, self.rotors = page, per_vehicle, rotors
        self.p_n, self.q_nb, self.v_n, self.omega_b, self.accel_b = p_n, q_nb, v_n, omega_b, accel_b
        self.motors = motors

    def write(self, begin: int, time_s: float) -> None:
        """Write the present states to a row of the page. Columns of missing rotors are not changed.

        begin: place of the row.  time_s: simulation time [s]
        """
        page = self.page
        page[begin] = time_s
        for i in range(len(self.p_n)):
            at = begin + 1 + i * self.per_vehicle
            for k in range(3):
                page[at + k] = self.p_n[i, k]
                page[at + 7 + k] = self.v_n[i, k]
                page[at + 10 + k] = self.omega_b[i, k]
                page[at + 13 + k] = self.accel_b[i, k]
            for k in range(4):
                page[at + 3 + k] = self.q_nb[i, k]
            for k in range(self.rotors):
                page[at + 16 + k] = self.motors[i, k]
