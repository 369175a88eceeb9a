"""Trajectory that holds one position after the other, each for a given time.

Between two positions the reference jumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array
from arena.trajectories.trajectory import Reference


class SetpointList:
    """Trajectory that holds the positions of a list one after the other, each for a given time.

    There is no feed-forward: the autopilot plans the way between the positions.

    setpoints: (position [m] [NED] (3,), yaw [rad], time for which it is held [s]) of each setpoint.
    Raises InputError if the list is empty, a time is not above 0, or a position or yaw is not finite.
    """

    def __init__(self, setpoints: Sequence[tuple[ArrayLike, float, float]]) -> None:
        if not setpoints:
            raise InputError("setpoint list: got no setpoint, expected at least one")
        self._pos: Array = np.array([np.asarray(pos, float).reshape(3) for pos, _, _ in setpoints])
        self._yaw = [float(yaw) for _, yaw, _ in setpoints]
        held = np.array([held_s for _, _, held_s in setpoints], float)
        if not (held > 0.0).all() or not np.isfinite(held).all():
            raise InputError(f"setpoint list: got the times {held.tolist()} s, expected numbers above 0")
        for number, (pos, yaw) in enumerate(zip(self._pos.tolist(), self._yaw, strict=True), start=1):
            if not np.isfinite([*pos, yaw]).all():
                raise InputError(
                    f"setpoint list: setpoint {number} has the position {pos} m and yaw {yaw:g} rad, expected finite numbers"
                )
        self._ends: Array = np.cumsum(held)

    @property
    def duration_s(self) -> float:
        return float(self._ends[-1])

    def at(self, t: float) -> Reference:
        k = min(int(np.searchsorted(self._ends, t, side="right")), len(self._yaw) - 1)
        return Reference(pos=self._pos[k].copy(), yaw=self._yaw[k])
