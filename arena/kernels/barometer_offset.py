"""Offset between barometric altitude and estimated height, for the built-in autopilots.

`arena.autopilot.estimation.estimator` fuses a barometer while external vision gives no height.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.strapdown import Strapdown
    from arena.kernels.vision_fusion import VisionFusion

    Mask = NDArray[np.bool_]

_FRESH_S = 0.2
"""Age limit of a height measured by vision, for the estimate of the offset [s]."""
_OFFSET_S = 1.0
"""Time constant of the offset [s]."""


class BarometerOffset:
    """Offset between the barometric altitude and the estimated height of V vehicles.

    state, vision: estimated state and its fusion with external vision
    altitude: input: barometric altitude, up [m], NaN for a failed sensor (V,)
    after_s: time without a height measured by vision until the barometer is fused [s], infinite for never (V,)
    offset: altitude minus estimated height [m] (V,)
    seen: whether the offset was estimated (V,)
    lost: output: whether the barometer is to be fused now (V,)
    """

    def __init__(self, state: Strapdown, vision: VisionFusion, seen: Mask, lost: Mask) -> None:
        v = len(seen)
        self.state, self.vision, self.seen, self.lost = state, vision, flags(seen), flags(lost)
        self.altitude, self.after_s, self.offset = floats(v), floats(v), floats(v)
        self.updated_at = -1e9

    def update(self, now: float) -> bool:
        """Update the offset of each vehicle while vision gives its height. Return whether a vehicle must use its barometer.

        now: time since boot [s]
        """
        state, vision = self.state, self.vision
        share = min(1.0, (now - self.updated_at) / _OFFSET_S)
        self.updated_at = now
        any_lost = False
        for i in range(len(self.offset)):
            self.lost[i] = False
            if math.isnan(self.altitude[i]):
                continue
            age = now - vision.last_z[i]
            if state.aligned[i] and age < _FRESH_S:
                offset = self.altitude[i] + state.p_n[i, 2]
                self.offset[i] += (share if self.seen[i] else 1.0) * (offset - self.offset[i])
                self.seen[i] = True
            if self.seen[i] and age > self.after_s[i]:
                self.lost[i] = any_lost = True
        return any_lost
