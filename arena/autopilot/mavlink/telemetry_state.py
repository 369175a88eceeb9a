"""State of all vehicles at one step, for telemetry. Derived values are computed when first used."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.geometry import euler_from_matrix, yaw_from_quat

Array = NDArray[np.float64]
Bool = NDArray[np.bool_]


class TelemetryState:
    """State of V vehicles with at most R rotors each, from which telemetry messages are made. Valid until the next step.

    now_s: time since boot [s]
    est, sp, cascade: estimator, setpoints and controllers (not copies)
    thrust: collective thrust 0..1 (V,)
    motors: motor commands 0..1 (V, R)
    gyro_b, accel_b, mag_b: body rates [rad/s], specific force [m/s2], magnetic field [gauss] [FRD] (V, 3)
    baro_alt_m: barometric altitude [m] (V,)
    battery_v, battery_a: voltage [V] and current [A] (V,)
    battery: remaining charge 0..1 (V,)
    consumed_mah: consumed charge [mAh] (V,)
    """

    def __init__(
        self,
        now_s: float,
        est: Estimator,
        sp: Setpoints,
        cascade: Cascade,
        sensors: Mapping[str, Array],
        *,
        thrust: Array,
        motors: Array,
        consumed_mah: Array,
    ) -> None:
        self.now_s, self.est, self.sp, self.cascade, self.thrust, self.motors = (
            now_s,
            est,
            sp,
            cascade,
            thrust,
            motors,
        )
        self.gyro_b, self.accel_b, self.mag_b = sensors["gyro_b"], sensors["accel_b"], sensors["mag_b"]
        self.baro_alt_m, self.battery_v = sensors["baro_alt_m"], sensors["battery_v"]
        self.battery_a, self.battery = sensors["battery_current_a"], sensors["battery_remaining"]
        self.consumed_mah = consumed_mah

    @cached_property
    def ms(self) -> int:
        """Time since boot [ms], modulo 2^32."""
        return int(self.now_s * 1e3) & 0xFFFFFFFF

    @cached_property
    def us(self) -> int:
        """Time since boot [us]."""
        return int(self.now_s * 1e6)

    @property
    def p_n(self) -> Array:
        """Position [m] [NED] (V, 3)."""
        return self.est.p_n

    @property
    def v_n(self) -> Array:
        """Velocity [m/s] [NED] (V, 3)."""
        return self.est.v_n

    @cached_property
    def rpy(self) -> Array:
        """Roll, pitch, yaw [rad] (V, 3)."""
        return euler_from_matrix(self.est.r_nb)

    @cached_property
    def xy_valid(self) -> list[bool]:
        """True if the horizontal position is valid (V,)."""
        valid: list[bool] = self.est.xy_valid(self.now_s).tolist()
        return valid

    @cached_property
    def z_valid(self) -> list[bool]:
        """True if the height is valid (V,)."""
        valid: list[bool] = self.est.z_valid(self.now_s).tolist()
        return valid

    @cached_property
    def variance(self) -> Array:
        """Variances of position [m2], velocity [m2/s2] and attitude [rad2] (V, 9)."""
        return np.asarray(np.diagonal(self.est.cov, axis1=1, axis2=2)[:, :9])

    @cached_property
    def setpoint(self) -> Array:
        """Setpoint (V, 11): p_n, v_n, a_n [NED], yaw [rad], yaw rate [rad/s]. NaN if not controlled."""
        sp, position = self.sp, self.cascade.position
        by_position = sp.at(Level.POSITION)[:, None]
        found = np.empty((len(sp.level), 11))
        found[:, 0:3] = sp.p_n
        found[:, 3:6] = np.where(by_position, position.v_sp_n, np.nan)
        found[:, 6:9] = np.where(by_position, position.a_sp_n, np.nan)
        keeps_yaw = by_position[:, 0] & np.isnan(sp.yaw)  # report the heading that is held
        found[:, 9] = np.where(keeps_yaw, yaw_from_quat(self.cascade.q_sp), sp.yaw)
        found[:, 10] = sp.yaw_rate
        return found
