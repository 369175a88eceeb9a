"""Quantities in the ULog records of the built-in autopilots, such as position and setpoints: computes those of one vehicle.

A quantity is one or several numbers. `arena.autopilot.ulog.topics` says which quantity each field of a log contains.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import estimate_validity, global_coordinates, rotations, standard_atmosphere
from arena.kernels.arrays import array, flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats, Integers
    from arena.kernels.cascade import CascadeLaw
    from arena.kernels.control_allocation import ControlAllocation
    from arena.kernels.estimate_validity import EstimateValidity

    Mask = NDArray[np.bool_]

MOTORS = 12
"""Number of motors in `actuator_motors`."""
ORIGIN = ("lat0", "lon0", "alt0", "frame_heading")
INPUTS = ("armed", "attitude_valid", "xy_valid", "z_valid", "yaw_valid", *ORIGIN)
"""Inputs of a vehicle, each one number. lat0, lon0 [deg], alt0 [m]: origin of the local frame, NaN if it is not set.
frame_heading: direction of the frame's north, clockwise from true north [rad]; 0 if the origin is not set."""
GROUPS: dict[str, dict[str, int]] = {
    "time": {"now": 1, "period_us": 1},
    "imu": {"gyro_b": 3, "accel_b": 3},
    "rates": {
        **{"omega_b": 3, "omega_dot_b": 3, "torque": 3, "thrust_z": 1, "torque_achieved": 1},
        **dict.fromkeys(("omega_sp_x", "omega_sp_y", "omega_sp_z"), 1),
        **dict.fromkeys(("integral_x", "integral_y", "integral_z"), 1),
    },
    "attitude": {"q_nb": 4, "q_sp": 4, "yaw_rate_ff": 1, "force_b": 3, "resets": 1},
    "position": {
        **dict.fromkeys(("north", "east", "down", "v_north", "v_east", "v_down"), 1),
        **dict.fromkeys(("a_north", "a_east", "a_down", "heading", "heading_var", "tilt_var"), 1),
    },
    "accuracy": dict.fromkeys(("eph", "epv", "evh", "evv"), 1),
    "setpoint": {
        **dict.fromkeys(("sp_north", "sp_east", "sp_down", "v_sp_north", "v_sp_east", "v_sp_down"), 1),
        **{"a_sp_n": 3, "thrust_n": 3, "yaw_held": 1, "yaw_rate_sp": 1},
        **{"p_sp": 3, "v_sp": 3, "a_sp": 3, "yaw_sp": 1},
    },
    "motors": {"control": MOTORS},
    "vehicle": dict.fromkeys(("xy_valid", "z_valid", "yaw_valid", "lat0", "lon0", "alt0", "has_origin"), 1),
    "globe": dict.fromkeys(("lat", "lon", "alt", "globe_valid"), 1),
    "air": {"baro_alt": 1, "pressure_pa": 1, "air_density": 1, "mag_b": 3},
    "battery": dict.fromkeys(("voltage", "current", "remaining", "discharged_mah", "battery_warning"), 1),
    "estimator": {
        **dict.fromkeys(("test_ratio_position", "test_ratio_yaw", "rejects_position", "rejects_yaw"), 1),
        **dict.fromkeys(("aligned", "in_air", "fuses_baro", "fuses_xy", "fuses_yaw", "fuses_z"), 1),
        **dict.fromkeys(("at_rest", "control_flags", "solution_flags"), 1),
    },
    "innovations": {
        **{"innovation_xy": 2, "innovation_z": 1, "innovation_yaw": 1},
        **{"variance_xy": 2, "variance_z": 1, "variance_yaw": 1},
        **{"ratio_xy": 2, "ratio_z": 1, "ratio_yaw": 1},
    },
    "states": {"states": 25, "covariances": 24},
    "biases": {
        **{"gyro_bias": 3, "gyro_bias_variance": 3},
        **{"accel_bias": 3, "accel_bias_variance": 3, "accel_bias_limit": 1},
    },
}
"""Group of quantities that are computed together -> quantity -> number of its values. The groups from "vehicle" on are rare."""
SIZES = {name: size for group in GROUPS.values() for name, size in group.items()}
"""Quantity -> number of its values."""
COLUMNS = {name: sum(list(SIZES.values())[:k]) for k, name in enumerate(SIZES)}
"""Quantity -> position of its first value."""
BITS = {name: 1 << k for k, name in enumerate(GROUPS)}
"""Group -> its bit in the argument of `UlogQuantities.compute`."""
USE_VEHICLES = BITS["motors"] | BITS["vehicle"] | BITS["globe"] | BITS["estimator"]
USE_SENSORS = BITS["air"] | BITS["battery"]
"""Groups that are computed from `inputs`, and from the measurements that the caller copies."""

_IMU, _RATES, _ATTITUDE, _POSITION = BITS["imu"], BITS["rates"], BITS["attitude"], BITS["position"]
_ACCURACY, _SETPOINT, _MOTORS, _VEHICLE = BITS["accuracy"], BITS["setpoint"], BITS["motors"], BITS["vehicle"]
_GLOBE, _AIR, _BATTERY, _ESTIMATOR = BITS["globe"], BITS["air"], BITS["battery"], BITS["estimator"]
_INNOVATIONS, _STATES, _BIASES = BITS["innovations"], BITS["states"], BITS["biases"]
_NOW, _PERIOD, _GYRO, _ACCEL = COLUMNS["now"], COLUMNS["period_us"], COLUMNS["gyro_b"], COLUMNS["accel_b"]
_OMEGA, _OMEGA_DOT, _OMEGA_SP = COLUMNS["omega_b"], COLUMNS["omega_dot_b"], COLUMNS["omega_sp_x"]
_TORQUE, _THRUST_Z, _ACHIEVED = COLUMNS["torque"], COLUMNS["thrust_z"], COLUMNS["torque_achieved"]
_INTEGRAL, _Q, _Q_SP = COLUMNS["integral_x"], COLUMNS["q_nb"], COLUMNS["q_sp"]
_YAW_RATE_FF, _FORCE, _RESETS = COLUMNS["yaw_rate_ff"], COLUMNS["force_b"], COLUMNS["resets"]
_P, _V, _A = COLUMNS["north"], COLUMNS["v_north"], COLUMNS["a_north"]
_HEADING, _EPH = COLUMNS["heading"], COLUMNS["eph"]
_P_HELD, _V_HELD, _A_HELD = COLUMNS["sp_north"], COLUMNS["v_sp_north"], COLUMNS["a_sp_n"]
_THRUST_N, _YAW_HELD, _YAW_RATE = COLUMNS["thrust_n"], COLUMNS["yaw_held"], COLUMNS["yaw_rate_sp"]
_P_SP, _V_SP, _A_SP, _YAW_SP = COLUMNS["p_sp"], COLUMNS["v_sp"], COLUMNS["a_sp"], COLUMNS["yaw_sp"]
_CONTROL, _XY_VALID, _HAS_ORIGIN = COLUMNS["control"], COLUMNS["xy_valid"], COLUMNS["has_origin"]
_LAT, _BARO_ALT, _MAG, _VOLTAGE = COLUMNS["lat"], COLUMNS["baro_alt"], COLUMNS["mag_b"], COLUMNS["voltage"]
_TEST_RATIO, _REJECTS = COLUMNS["test_ratio_position"], COLUMNS["rejects_position"]
_ALIGNED, _FUSES_BARO, _CONTROL_FLAGS = COLUMNS["aligned"], COLUMNS["fuses_baro"], COLUMNS["control_flags"]
_INNOVATION, _VARIANCE, _RATIO = COLUMNS["innovation_xy"], COLUMNS["variance_xy"], COLUMNS["ratio_xy"]
_STATE, _COVARIANCE = COLUMNS["states"], COLUMNS["covariances"]
_GYRO_BIAS, _GYRO_VARIANCE = COLUMNS["gyro_bias"], COLUMNS["gyro_bias_variance"]
_ACCEL_BIAS, _ACCEL_VARIANCE = COLUMNS["accel_bias"], COLUMNS["accel_bias_variance"]
_BIAS_LIMIT = COLUMNS["accel_bias_limit"]
_ARMED, _ATTITUDE_VALID, _IN_XY_VALID, _LAT0 = (
    INPUTS.index(name) for name in ("armed", "attitude_valid", "xy_valid", "lat0")
)
_CONTROL_BITS = (0b11, 1 << 7, 1 << 9, 1 << 12, 1 << 13, 1 << 14, 1 << 26)
"""Bits of `estimator_status.control_mode_flags` for the quantities from "aligned" to "at_rest"."""
_LEVEL_POSITION = 3  # level of a setpoint, as in `cascade`
_NAN, _INF = float("nan"), float("inf")
_RECENTLY_S = 0.2  # a measurement counts as fused for this time
_GAS_DENSITY = 287.05 * 288.15  # gas constant of dry air [J/(kg K)], standard temperature at sea level [K]


class UlogQuantities:
    """Computes the quantities in the ULog records of V vehicles with at most R rotors each.

    inputs: input: `INPUTS` (V, 9)
    mag_b: input: magnetic field [gauss] [FRD] (V, 3)
    baro_alt: input: barometric altitude [m] (V,)
    battery_v, battery_a, battery: input: voltage [V], current [A] and remaining charge 0..1 (V,)
    values: the quantities of one vehicle
    """

    def __init__(
        self,
        validity: EstimateValidity,
        cascade: CascadeLaw,
        allocation: ControlAllocation,
        motors: Floats,
        consumed_mah: Floats,
        resets: Integers,
        period_us: float,
        earth_m: float,
    ) -> None:
        """Store the arrays of estimator and controllers, from which `compute` reads.

        motors: motor commands 0..1 (V, R)
        consumed_mah: consumed charge [mAh] (V,)
        resets: number of realignments of the estimator (V,)
        period_us: sensor period [us]
        earth_m: radius of the Earth [m]
        """
        self.validity, self.cascade, self.allocation = validity, cascade, allocation
        self.state, self.vision, self.cov = validity.state, validity.vision, validity.cov
        self.motors, self.consumed_mah, self.resets, self.earth_m = motors, consumed_mah, resets, earth_m
        vehicles, self.now = len(consumed_mah), 0.0
        self.rotors = min(MOTORS, array(motors).shape[1])
        self.values = floats(sum(SIZES.values()))
        self.values[_PERIOD] = period_us
        for k in range(MOTORS):
            self.values[_CONTROL + k] = _NAN
        self._bits = floats(len(_CONTROL_BITS))
        for k, bits in enumerate(_CONTROL_BITS):
            self._bits[k] = bits
        self.inputs, self.mag_b, self.baro_alt = (
            floats(vehicles, len(INPUTS)),
            floats(vehicles, 3),
            floats(vehicles),
        )
        self.battery_v, self.battery_a, self.battery = floats(vehicles), floats(vehicles), floats(vehicles)

    def read_setpoints_from(
        self,
        level: Integers,
        p_n: Floats,
        v_n: Floats,
        a_n: Floats,
        yaw: Floats,
        yaw_rate: Floats,
        yaw_rate_ff: Floats,
    ) -> None:
        """Store the arrays from which `compute` reads the setpoints."""
        self.level, self.sp_p_n, self.sp_v_n, self.sp_a_n = level, p_n, v_n, a_n
        self.sp_yaw, self.sp_yaw_rate, self.yaw_rate_ff = yaw, yaw_rate, yaw_rate_ff

    def read_landing_from(self, landed: Mask, at_rest: Mask, flying: Mask) -> None:
        """Store the arrays of land detector and take-off ramp (V,)."""
        self.landed, self.at_rest, self.flying = flags(landed), flags(at_rest), flags(flying)

    def read_params_from(self, low: Floats, critical: Floats, emergency: Floats, bias_limit: Floats) -> None:
        """Store the arrays of parameters that are logged or compared (V,).

        low, critical, emergency: BAT_LOW_THR, BAT_CRIT_THR and BAT_EMERGEN_THR 0..1
        bias_limit: EKF2_ABL_LIM [m/s2]
        """
        self.low, self.critical, self.emergency, self.bias_limit = low, critical, emergency, bias_limit

    def set_time(self, now: float, time_us: float) -> None:
        """Set the time of the quantities that are computed next: time since boot [s], and as an integer [us]."""
        self.now, self.values[_NOW] = now, time_us

    def compute(self, i: int, groups: int) -> None:
        """Compute the quantities of vehicle i that are in the given groups. groups: sum of `BITS`"""
        if groups & _IMU:
            self._compute_imu(i)
        if groups & _RATES:
            self._compute_rates(i)
        if groups & _ATTITUDE:
            self._compute_attitude(i)
        if groups & _POSITION:
            self._compute_position(i)
        if groups & _ACCURACY:
            self._compute_accuracy(i)
        if groups & _SETPOINT:
            self._compute_setpoint(i)
        if groups & _MOTORS:
            self._compute_motors(i)
        if groups >= _VEHICLE:
            self._compute_rare(i, groups)

    def _compute_rare(self, i: int, groups: int) -> None:
        if groups & _VEHICLE:
            self._copy_vehicle(i)
        if groups & _GLOBE:
            self._compute_globe(i)
        if groups & _AIR:
            self._compute_air(i)
        if groups & _BATTERY:
            self._compute_battery(i)
        if groups & _ESTIMATOR:
            self._compute_estimator(i)
        if groups & _INNOVATIONS:
            self._compute_innovations(i)
        if groups & _STATES:
            self._compute_states(i)
        if groups & _BIASES:
            self._compute_biases(i)

    def _compute_imu(self, i: int) -> None:
        for k in range(3):
            self.values[_GYRO + k] = self.state.sensed_gyro_b[i, k]
            self.values[_ACCEL + k] = self.state.sensed_accel_b[i, k]

    def _compute_rates(self, i: int) -> None:
        """Compute body rates, torques and thrust, with their setpoints."""
        out, rate, achieved = self.values, self.cascade.rate, 1.0
        for k in range(3):
            out[_OMEGA + k], out[_OMEGA_DOT + k] = self.state.omega_b[i, k], rate.accel[i, k]
            out[_OMEGA_SP + k], out[_INTEGRAL + k] = rate.omega_sp[i, k], rate.integral[i, k]
            out[_TORQUE + k] = self.allocation.torque[i, k]
            if rate.saturated[i, k] != 0.0:
                achieved = 0.0
        out[_THRUST_Z], out[_ACHIEVED] = -self.allocation.thrust[i], achieved

    def _compute_attitude(self, i: int) -> None:
        out, state, q_sp = self.values, self.state, self.cascade.attitude.q_sp
        for k in range(4):
            out[_Q + k], out[_Q_SP + k] = state.q_nb[i, k], q_sp[i, k]
        for k in range(3):
            out[_FORCE + k] = state.force_b[i, k]
        out[_YAW_RATE_FF], out[_RESETS] = self.yaw_rate_ff[i], self.resets[i] % 256

    def _compute_position(self, i: int) -> None:
        out, state, cov = self.values, self.state, self.cov
        for k in range(3):
            out[_P + k], out[_V + k], out[_A + k] = state.p_n[i, k], state.v_n[i, k], state.a_n[i, k]
        out[_HEADING] = math.atan2(state.r_nb[i, 1, 0], state.r_nb[i, 0, 0])
        out[_HEADING + 1], out[_HEADING + 2] = cov[i, 8, 8], cov[i, 6, 6] + cov[i, 7, 7]

    def _compute_accuracy(self, i: int) -> None:
        """Compute the horizontal and vertical accuracies of position [m] and velocity [m/s] from the variances."""
        out, cov = self.values, self.cov
        out[_EPH], out[_EPH + 1] = math.sqrt(cov[i, 0, 0] + cov[i, 1, 1]), math.sqrt(cov[i, 2, 2])
        out[_EPH + 2], out[_EPH + 3] = math.sqrt(cov[i, 3, 3] + cov[i, 4, 4]), math.sqrt(cov[i, 5, 5])

    def _compute_setpoint(self, i: int) -> None:
        """Compute the setpoints. The outputs of the position controller are NaN while it does not run."""
        out, position, by_position = self.values, self.cascade.position, self.level[i] == _LEVEL_POSITION
        for k in range(3):
            out[_P_HELD + k] = out[_P_SP + k] = self.sp_p_n[i, k]
            out[_V_SP + k], out[_A_SP + k] = self.sp_v_n[i, k], self.sp_a_n[i, k]
            out[_V_HELD + k] = position.v_sp_n[i, k] if by_position else _NAN
            out[_A_HELD + k] = position.a_sp_n[i, k] if by_position else _NAN
            out[_THRUST_N + k] = position.thrust_n[i, k]
        out[_YAW_SP] = out[_YAW_HELD] = self.sp_yaw[i]
        out[_YAW_RATE] = self.sp_yaw_rate[i]
        if math.isnan(self.sp_yaw[i]):
            q_sp = self.cascade.attitude.q_sp
            held = rotations.yaw((q_sp[i, 0], q_sp[i, 1], q_sp[i, 2], q_sp[i, 3]))
            out[_YAW_HELD] = held if by_position else _NAN

    def _compute_motors(self, i: int) -> None:
        """Copy the motor commands to the quantities.

        They are NaN for missing rotors, and for all motors of a disarmed vehicle, as in PX4.
        """
        armed = self.inputs[i, _ARMED] != 0.0
        for k in range(self.rotors):
            shown = armed and self.allocation.present[i, k] != 0
            self.values[_CONTROL + k] = self.motors[i, k] if shown else _NAN

    def _copy_vehicle(self, i: int) -> None:
        for k in range(_HAS_ORIGIN - _XY_VALID):
            self.values[_XY_VALID + k] = self.inputs[i, _IN_XY_VALID + k]
        self.values[_HAS_ORIGIN] = self._has_origin(i)

    def _has_origin(self, i: int) -> bool:
        return math.isfinite(self.inputs[i, _LAT0])

    def _compute_globe(self, i: int) -> None:
        out, given, p_n = self.values, self.inputs, self.state.p_n
        out[_LAT], out[_LAT + 1] = global_coordinates.latitude_longitude(
            p_n[i, 0], p_n[i, 1], given[i, _LAT0 + 3], given[i, _LAT0], given[i, _LAT0 + 1], self.earth_m
        )
        out[_LAT + 2] = given[i, _LAT0 + 2] - p_n[i, 2]
        out[_LAT + 3] = self._has_origin(i) and given[i, _IN_XY_VALID] != 0.0

    def _compute_air(self, i: int) -> None:
        out = self.values
        out[_BARO_ALT] = self.baro_alt[i]
        out[_BARO_ALT + 1] = 100.0 * standard_atmosphere.pressure_hpa(self.baro_alt[i])
        out[_BARO_ALT + 2] = out[_BARO_ALT + 1] / _GAS_DENSITY
        for k in range(3):
            out[_MAG + k] = self.mag_b[i, k]

    def _compute_battery(self, i: int) -> None:
        out, left = self.values, self.battery[i]
        out[_VOLTAGE], out[_VOLTAGE + 1], out[_VOLTAGE + 2] = self.battery_v[i], self.battery_a[i], left
        out[_VOLTAGE + 3], warning = self.consumed_mah[i], 0.0
        if left <= self.low[i]:
            warning += 1.0
        if left <= self.critical[i]:
            warning += 1.0
        if left <= self.emergency[i]:
            warning += 1.0
        out[_VOLTAGE + 4] = warning

    def _compute_estimator(self, i: int) -> None:
        """Compute what the estimator fuses and rejects, with the flags of PX4's `estimator_status`."""
        out, vision, aligned = self.values, self.vision, self.state.aligned[i] != 0
        for k in range(2):
            out[_TEST_RATIO + k] = vision.test_ratio[i, k]
            out[_REJECTS + k] = vision.test_ratio[i, k] > 1.0
        out[_ALIGNED] = aligned
        out[_ALIGNED + 1] = self.flying[i] != 0 and self.landed[i] == 0
        out[_FUSES_BARO] = aligned and self.now - self.validity.last_baro[i] < _RECENTLY_S
        out[_FUSES_BARO + 1] = aligned and self.now - vision.last_xy[i] < _RECENTLY_S
        out[_FUSES_BARO + 2] = aligned and self.now - vision.last_yaw[i] < _RECENTLY_S
        out[_FUSES_BARO + 3] = aligned and self.now - vision.last_z[i] < _RECENTLY_S
        out[_FUSES_BARO + 4], found = self.at_rest[i] != 0, 0.0
        for k in range(len(self._bits)):
            found += self._bits[k] * out[_ALIGNED + k]
        out[_CONTROL_FLAGS] = found
        given = self.inputs
        out[_CONTROL_FLAGS + 1] = estimate_validity.status_flags(
            given[i, _ATTITUDE_VALID] != 0.0,
            given[i, _IN_XY_VALID] != 0.0,
            given[i, _IN_XY_VALID + 1] != 0.0,
            self._has_origin(i),
        )

    def _compute_innovations(self, i: int) -> None:
        """Compute the innovations, with PX4's sign (estimate minus measurement), their variances and test ratios.

        test ratio = innovation^2 / (variance * gate^2)
        """
        out, vision = self.values, self.vision
        for k in range(4):
            innovation, variance = vision.innovation[i, k], vision.innovation_var[i, k]
            out[_INNOVATION + k], out[_VARIANCE + k] = -innovation, variance
            limit = min(variance, vision.gate_var[i, k]) * vision.gate_squared[i, k // 3]
            square = innovation * innovation
            out[_RATIO + k] = square / limit if limit != 0.0 else square * _INF

    def _compute_states(self, i: int) -> None:
        """Copy the estimated states and their variances in PX4's order: attitude, velocity, position, biases."""
        out, state, cov = self.values, self.state, self.cov
        for k in range(4):
            out[_STATE + k] = state.q_nb[i, k]
        for k in range(3):
            out[_STATE + 4 + k], out[_STATE + 7 + k] = state.v_n[i, k], state.p_n[i, k]
            out[_STATE + 10 + k], out[_STATE + 13 + k] = state.gyro_bias[i, k], state.accel_bias[i, k]
            out[_COVARIANCE + k], out[_COVARIANCE + 3 + k] = cov[i, 6 + k, 6 + k], cov[i, 3 + k, 3 + k]
            out[_COVARIANCE + 6 + k], out[_COVARIANCE + 9 + k] = cov[i, k, k], cov[i, 9 + k, 9 + k]
            out[_COVARIANCE + 12 + k] = cov[i, 12 + k, 12 + k]

    def _compute_biases(self, i: int) -> None:
        out, state, cov = self.values, self.state, self.cov
        for k in range(3):
            out[_GYRO_BIAS + k], out[_ACCEL_BIAS + k] = state.gyro_bias[i, k], state.accel_bias[i, k]
            out[_GYRO_VARIANCE + k], out[_ACCEL_VARIANCE + k] = cov[i, 9 + k, 9 + k], cov[i, 12 + k, 12 + k]
        out[_BIAS_LIMIT] = self.bias_limit[i]
