"""State of all vehicles at one step, for telemetry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]


class TelemetryState:
    """State of V vehicles at one step, from which telemetry messages are made.

    The state is valid until the next step. A vehicle has at most R rotors.

    now_s, us: time since boot [s], [us]
    ms: time since boot [ms], modulo 2^32
    est: estimator (not a copy)
    sensors: sensor readings of the step
    thrust: collective thrust 0..1 (V,)
    motors: motor commands 0..1 (V, R)
    gyro_b, accel_b, mag_b: body rates [rad/s], specific force [m/s2], magnetic field [gauss] [FRD] (V, 3)
    baro_alt_m: barometric altitude [m] (V,)
    battery_v, battery_a: voltage [V] and current [A] (V,)
    battery: remaining charge 0..1 (V,)
    consumed_mah: consumed charge [mAh] (V,)
    setpoint_n, setpoint_v_n, setpoint_yaw: setpoint of position [m] (V, 3), velocity [m/s] (V, 3) [NED] and heading [rad] (V,), NaN
        if not controlled
    boot_unix_us: time of the boot, Unix time [us]
    """

    def __init__(
        self,
        now_s: float,
        est: Estimator,
        sensors: Mapping[str, Array],
        *,
        thrust: Array,
        motors: Array,
        consumed_mah: Array,
        sp: Setpoints,
        boot_unix_us: int,
    ) -> None:
        self.sensors = sensors
        self.now_s, self.est, self.thrust, self.motors = now_s, est, thrust, motors
        self.gyro_b, self.accel_b, self.mag_b = sensors["gyro_b"], sensors["accel_b"], sensors["mag_b"]
        self.baro_alt_m, self.battery_v = sensors["baro_alt_m"], sensors["battery_v"]
        self.battery_a, self.battery = sensors["battery_current_a"], sensors["battery_remaining"]
        self.consumed_mah, self.boot_unix_us = consumed_mah, boot_unix_us
        self.setpoint_n, self.setpoint_v_n, self.setpoint_yaw = sp.p_n, sp.v_n, sp.yaw
        self.ms, self.us = boot_ms(now_s), int(now_s * 1e6)
        self._xy_valid: list[bool] | None = None

    @property
    def xy_valid(self) -> list[bool]:
        """Validity of the horizontal position estimate of each vehicle: True or False (V,).

        Computed at the first use.
        """
        if self._xy_valid is None:
            self._xy_valid = self.est.xy_valid(self.now_s).tolist()
        return self._xy_valid

    @property
    def z_valid(self) -> list[bool]:
        """Validity of the height estimate of each vehicle: True or False (V,)."""
        valid: list[bool] = self.est.z_valid(self.now_s).tolist()
        return valid

    @property
    def variance(self) -> Array:
        """Variances of position [m2], velocity [m2/s2] and attitude [rad2] (V, 9)."""
        return np.asarray(np.diagonal(self.est.cov, axis1=1, axis2=2)[:, :9])


def boot_ms(now_s: float) -> int:
    """Return the time since boot [ms] as messages contain it, modulo 2^32. now_s: the same time [s]."""
    return int(now_s * 1e3) & 0xFFFFFFFF
