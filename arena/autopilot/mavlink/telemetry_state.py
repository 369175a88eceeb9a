"""State of all vehicles at one step, for telemetry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator

Array = NDArray[np.float64]


class TelemetryState:
    """State of V vehicles at one step, from which telemetry messages are made.

    The state is valid until the next step. A vehicle has at most R rotors.

    now_s, us: time since boot [s], [us]
    ms: time since boot [ms], modulo 2^32
    est: estimator (not a copy)
    sensors: sensor readings of the step
    motors: motor commands 0..1 (V, R)
    gyro_b, accel_b, mag_b: body rates [rad/s], specific force [m/s2], magnetic field [gauss] [FRD] (V, 3)
    setpoint_n, setpoint_v_n, setpoint_yaw: setpoint of position [m] (V, 3), velocity [m/s] (V, 3) [NED] and heading [rad] (V,), NaN
        if not controlled
    """

    def __init__(
        self,
        now_s: float,
        est: Estimator,
        sensors: Mapping[str, Array],
        *,
        motors: Array,
        sp: Setpoints,
    ) -> None:
        self.sensors = sensors
        self.now_s, self.est, self.motors = now_s, est, motors
        self.gyro_b, self.accel_b, self.mag_b = sensors["gyro_b"], sensors["accel_b"], sensors["mag_b"]
        self.setpoint_n, self.setpoint_v_n, self.setpoint_yaw = sp.p_n, sp.v_n, sp.yaw
        self.ms, self.us = boot_ms(now_s), int(now_s * 1e6)


def boot_ms(now_s: float) -> int:
    """Return the time since boot [ms] as messages contain it, modulo 2^32. now_s: the same time [s]."""
    return int(now_s * 1e3) & 0xFFFFFFFF
