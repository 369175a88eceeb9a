"""Motor tests on request of a client (MAV_CMD_ACTUATOR_TEST), only while the vehicle is disarmed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
_LONGEST_S = 3.0  # as in PX4
_MOTORS, _SERVOS = range(1, 13), range(33, 41)  # values of ACTUATOR_OUTPUT_FUNCTION
_PX4_FUNCTION, _PX4_MOTOR_1 = 1000, 101  # clients send 1000 + the number of PX4's own output function


@dataclass(slots=True)
class ActuatorTests:
    """Motor tests that run at present on one vehicle.

    running: motor, from 0 -> (command 0..1, time of the end [s])
    """

    running: dict[int, tuple[float, float]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.running)

    def request(self, p: Sequence[float], now: float, rotors: int, *, armed: bool) -> int:
        """Start or stop the test of one motor and return the MAV_RESULT.

        p: parameters of the command: value (NaN stops the test), duration [s], unused, unused, output function
        now: time since boot [s].  rotors: number of rotors.  armed: True for an armed vehicle, which refuses the test
        """
        if armed:
            return DENIED
        function = int(p[4] + 0.5) if math.isfinite(p[4]) else 0
        if function < _PX4_FUNCTION and function not in (*_MOTORS, *_SERVOS):
            return UNSUPPORTED
        if not (math.isnan(p[0]) or -1.0 <= p[0] <= 1.0) or not math.isfinite(p[1]):
            return DENIED
        motor = function - (_PX4_FUNCTION + _PX4_MOTOR_1 if function >= _PX4_FUNCTION else 1)
        if not 0 <= motor < rotors:  # PX4 accepts tests of outputs that do not exist
            return ACCEPTED
        if math.isnan(p[0]) or p[1] <= 0.0:
            self.running.pop(motor, None)
        else:
            self.running[motor] = (max(p[0], 0.0), now + min(p[1], _LONGEST_S))
        return ACCEPTED

    def stop(self) -> None:
        """Stop all motor tests of the vehicle."""
        self.running.clear()

    def apply(self, motors: NDArray[np.float64], now: float) -> None:
        """Replace the commands of the tested motors by the values of their tests.

        Tests that have ended are removed.

        motors: motor commands 0..1 (R,), changed for the tested motors
        now: time since boot [s]
        """
        for motor, (value, until) in list(self.running.items()):
            if now >= until:
                del self.running[motor]
            else:
                motors[motor] = value
