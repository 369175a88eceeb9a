"""Finds the bodies that are too far from everything else to collide within the next sensor period.

Each body is a sphere about its origin. The room consists of a floor at height 0 and of boxes along the axes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.arrays import flags, floats, view

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Array, Floats

_MARGIN_M = 0.05
"""Smallest distance of a free body to anything else [m]. Contacts act up to 0.02 m (pybullet)."""
_RETURN_M = 0.1
"""A body that was not free needs this distance [m]."""
_SPEED_CHANGE = 1.0
"""Change of the speed within a period for which the check allows [m/s]."""


class Clearance:
    """Finder of the bodies, out of V, that have enough free space to touch nothing within the next period.

    The distances are those between spheres around the bodies, boxes and the floor.

    period_s: time between two checks [s]
    free: output: True for each body that nothing can touch (V,)
    place_w, speed_w: input: position [m] and velocity [m/s] of the bodies in a world with z up (V, 3)
    radius: radius of the sphere around each body [m] (V,)
    boxes: centre and half size of each box in the same world [m] (B, 6)
    """

    def __init__(
        self,
        free: NDArray[np.bool_],
        place_w: Floats,
        speed_w: Floats,
        radius: Array,
        boxes: Array,
        period_s: float,
    ) -> None:
        self.free, self.place_w, self.speed_w, self.period_s = flags(free), place_w, speed_w, period_s
        self.radius, self.boxes, self._reach = view(radius), view(boxes), floats(len(free))
        self._need, self._spare = floats(len(free)), 0.0

    def reset(self) -> None:
        """Make the next `check` measure all distances again.

        Call this after a body was placed elsewhere.
        """
        self._spare = 0.0

    def check(self) -> bool:
        """Decide which bodies cannot touch anything in the next period (`free`). Return True if `free` was updated.

        The distances are measured only if the bodies may have moved so far that the smallest spare distance is used up.
        """
        most = 0.0
        for i in range(len(self.free)):
            v = self.speed_w
            speed = math.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
            self._reach[i] = (speed + _SPEED_CHANGE) * self.period_s
            most = max(most, self._reach[i])
        self._spare -= 2.0 * most
        if self._spare > 0.0:
            return False
        self._measure()
        return True

    def _measure(self) -> None:
        """Measure the distances of all bodies to each other, to boxes and to the floor.

        Update `free`, which marks the bodies with enough space around them, and `_spare`.

        `_spare` is the smallest distance minus the space that its bodies need.
        """
        count = len(self.free)
        for i in range(count):
            self._need[i] = (_MARGIN_M if self.free[i] else _RETURN_M) + self.radius[i] + self._reach[i]
            self.free[i] = True
        self._spare = math.inf
        for i in range(count):
            self._use(i, self._room(i) - self._need[i])
            for j in range(i):
                spare = self._apart(i, j) - self._need[i] - self._need[j]
                self._use(i, spare)
                if not spare > 0.0:  # NaN is not free either
                    self.free[j] = False

    def _use(self, i: int, spare: float) -> None:
        """Process one measured distance of body i: if it is too small for free flight, mark the body as not free.

        Also keep the smallest spare distance in `_spare`.

        spare: the distance minus the space that its bodies need [m]
        """
        self._spare = min(self._spare, spare)
        if not spare > 0.0:  # NaN is not free either
            self.free[i] = False

    def _apart(self, i: int, j: int) -> float:
        """Return the distance between the origins of two bodies [m]."""
        p = self.place_w
        x, y, z = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
        return math.sqrt(x * x + y * y + z * z)

    def _room(self, i: int) -> float:
        """Return a lower limit of the distance from the origin of body i to the floor and to all boxes [m]."""
        p, boxes = self.place_w, self.boxes
        least = p[i, 2]
        for b in range(len(boxes)):
            gap = abs(p[i, 0] - boxes[b, 0]) - boxes[b, 3]
            gap = max(gap, abs(p[i, 1] - boxes[b, 1]) - boxes[b, 4])
            gap = max(gap, abs(p[i, 2] - boxes[b, 2]) - boxes[b, 5])
            least = min(least, gap)
        return least
