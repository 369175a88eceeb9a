"""Release of the motors of a built-in autopilot: they idle after arming, and follow the controllers from take-off on.

While an armed vehicle stands on the ground without a climb setpoint, its motors ignore the controllers.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats, Integers
    from arena.kernels.land_detection import RampLaw
    from arena.kernels.motor_outputs import MotorOutputs

    Mask = NDArray[np.bool_]

_NONE = 0  # level of a setpoint, as in `cascade`
_IDLE = 0.1  # motor command of an armed vehicle on the ground


class MotorRelease:
    """Motor release of V vehicles: the motors idle until the take-off ramp begins, then follow the controllers.

    outputs, ramp: motor commands and take-off ramp
    level: input: controller that receives the setpoint, 0 for none (V,)
    armed, armed_since: input: whether armed, and since when [s] (V,)
    still: input: whether the land detector finds the vehicle at rest (V,)
    spoolup_s: COM_SPOOLUP_TIME [s] (V,).  tilt_landed: MPC_TILTMAX_LND [rad] (V,)
    at_rest: output: whether the vehicle stands on the ground with idle motors (V,)
    """

    def __init__(
        self,
        outputs: MotorOutputs,
        ramp: RampLaw,
        level: Integers,
        armed: Mask,
        armed_since: Floats,
        still: Mask,
        at_rest: Mask,
    ) -> None:
        v, self.outputs, self.ramp = len(armed), outputs, ramp
        self.level, self.armed_since = level, armed_since
        self.armed, self.still, self.at_rest = flags(armed), flags(still), flags(at_rest)
        self.spoolup_s, self.tilt_landed = floats(v), floats(v)

    def update(self) -> None:
        """Decide for each vehicle whether its motors idle or follow the controllers.

        Before the take-off ramp begins, the integrals of the controllers are cleared.
        """
        outputs, ramp = self.outputs, self.ramp
        cascade = outputs.cascade
        for i in range(len(self.spoolup_s)):
            started = ramp.flying[i] != 0 or math.isfinite(ramp.begun[i])
            cascade.position.tilt_max[i] = math.inf if ramp.flying[i] else self.tilt_landed[i]
            if not started:
                self._clear(i)
            on = self.armed[i] != 0 and self.level[i] != _NONE
            outputs.up_from[i] = self.armed_since[i] + self.spoolup_s[i] if on and started else math.inf
            for k in range(outputs.rotors):
                outputs.idle[i, k] = _IDLE if on and outputs.allocation.present[i, k] else 0.0
            self.at_rest[i] = self.armed[i] != 0 and not (on and started) and self.still[i] != 0

    def _clear(self, i: int) -> None:
        """Clear the integrals and filters of the controllers of vehicle i."""
        position, rate = self.outputs.cascade.position, self.outputs.cascade.rate
        for axis in range(3):
            position.integral[i, axis] = position.v_dot[i, axis] = rate.integral[i, axis] = 0.0
        rate.yaw_torque[i] = 0.0
