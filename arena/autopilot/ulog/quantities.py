"""Values for the fields of the ULog records, as arrays over all vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from arena.atmosphere import pressure_hpa
from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import LandDetector, TakeoffRamp
from arena.autopilot.navigation.mission_items import Origin
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.geometry import globe_from_local, yaw_from_quat
from arena.kernels.arrays import array
from arena.portable_math import arctan2

Array = NDArray[np.float64]
_GAS_CONSTANT, _TEMPERATURE_K = (
    287.05,
    288.15,
)  # of dry air [J/(kg K)]; of the standard atmosphere at sea level
_MOTORS = 12  # fields of `actuator_motors`
_STATES, _VARIANCES = 25, 24  # fields of `estimator_states`
_ATTITUDE, _RELATIVE, _ABSOLUTE = 1, 8 | 256, 16  # bits of ESTIMATOR_STATUS_FLAGS
_HORIZONTAL, _VERTICAL = 2, 4 | 32
_CONTROL_BITS = {
    "aligned": 0b11,
    "in_air": 1 << 7,
    "fuses_baro": 1 << 9,
    "fuses_xy": 1 << 12,
    "fuses_yaw": 1 << 13,
    "fuses_z": 1 << 14,
    "at_rest": 1 << 26,
}
"""Quantity -> its bits in `estimator_status.control_mode_flags`."""
_BITS = np.array(list(_CONTROL_BITS.values()), float)
_NUMBERS = (
    "thrust_z heading tilt_var lat0 lon0 alt0 lat lon alt yaw_held v_sp_north v_sp_east v_sp_down baro_alt pressure_pa"
    " air_density voltage current remaining discharged_mah battery_warning torque_achieved ratio_yaw ratio_position ratio_z"
    " accel_bias_limit xy_valid z_valid yaw_valid has_origin globe_valid rejects_position rejects_yaw control_flags"
    " solution_flags"
)
"""Computed quantities of one number."""
_RECENTLY_S = 0.2  # a measurement counts as fused for this time


class Sources(Protocol):
    """Parts of the built-in autopilots (estimator, setpoints ...) whose values are logged.

    dt: sensor period [s]
    """

    dt: float
    vehicles: list[Vehicle]
    params: Params
    est: Estimator
    sp: Setpoints
    cascade: Cascade
    allocator: ControlAllocator
    land: LandDetector
    takeoff: TakeoffRamp


class Quantities:
    """Logged values of V vehicles, such as setpoints and estimates.

    `begin` sets the time. A method that is named in `topics` computes the values of its group.

    values: quantity -> array (V,) or (V, n), always the same array, so that records can be made from it
    """

    def __init__(self, sources: Sources) -> None:
        self._s = s = sources
        count = len(s.vehicles)
        self._now = 0.0
        self._sensors: Mapping[str, Array] = {}
        self._motors = s.allocator.rows[:, :, 0]
        self._consumed_mah = np.zeros(count)
        self._time_us = np.zeros((), np.uint64)
        self._variance = np.einsum("vii->vi", s.est.cov)  # a view of the diagonals
        self._accuracies, self._flags = np.zeros((count, 4)), np.zeros((count, len(_CONTROL_BITS)))
        self._origins: list[Origin | None] = []
        self._headings = np.zeros(count)
        rate = s.cascade.rate
        self.values: dict[str, NDArray[Any]] = {
            "now": self._time_us,
            "period_us": np.array(round(1e6 * s.dt), np.uint32),
            "gyro_b": s.est.sensed_gyro_b,
            "accel_b": s.est.sensed_accel_b,
            "omega_b": s.est.omega_b,
            "omega_dot_b": array(rate.law.accel),
            "q_nb": s.est.q_nb,
            "force_b": s.est.force_b,
            "torque": s.allocator.torque,
            "q_sp": s.cascade.q_sp,
            "yaw_rate_ff": s.sp.yaw_rate_ff,
            "p_sp": s.sp.p_n,
            "v_sp": s.sp.v_n,
            "a_sp": s.sp.a_n,
            "yaw_sp": s.sp.yaw,
            "yaw_rate_sp": s.sp.yaw_rate,
            "thrust_n": s.cascade.position.thrust_n,
            "heading_var": self._variance[:, 8],
            "gyro_bias_variance": self._variance[:, 9:12],
            "accel_bias_variance": self._variance[:, 12:15],
            "gyro_bias": s.est.gyro_bias,
            "accel_bias": s.est.accel_bias,
            "resets": s.est.reset_counter,
        }
        for axis, letter in enumerate("xyz"):
            self.values[f"omega_sp_{letter}"] = s.cascade.omega_sp[:, axis]
            self.values[f"integral_{letter}"] = rate.integral[:, axis]
        for axis, name in enumerate(("north", "east", "down")):
            self.values[name] = s.est.p_n[:, axis]
            self.values[f"v_{name}"], self.values[f"a_{name}"] = s.est.v_n[:, axis], s.est.a_n[:, axis]
            self.values[f"sp_{name}"] = s.sp.p_n[:, axis]
        self.values |= {name: np.zeros(count) for name in _NUMBERS.split()}
        self.values |= {name: np.zeros((count, 3)) for name in ("a_sp_n", "mag_b")}
        for kind in ("innovation", "variance", "ratio"):
            self.values |= {f"{kind}_xy": np.zeros((count, 2)), f"{kind}_z": np.zeros(count)}
            self.values |= {f"{kind}_yaw": np.zeros(count)}
        for columns, names in (
            (self._accuracies, ("eph", "epv", "evh", "evv")),
            (self._flags, _CONTROL_BITS),
        ):
            self.values |= {name: columns[:, k] for k, name in enumerate(names)}
        self.values["control"] = np.full((count, _MOTORS), np.nan)
        self.values["states"] = np.zeros((count, _STATES))
        self.values["covariances"] = np.zeros((count, _VARIANCES))

    def begin(self, now: float, sensors: Mapping[str, Array], motors: Array, consumed_mah: Array) -> None:
        """Store time, sensor values and motor commands of this step for the log records.

        now: time since boot [s]
        sensors: see `Autopilots.step`
        motors: motor commands 0..1 (V, R)
        consumed_mah: consumed charge [mAh] (V,)
        """
        self._now, self._sensors, self._motors, self._consumed_mah = now, sensors, motors, consumed_mah
        self._time_us[...] = round(1e6 * now)

    # -- groups ----------------------------------------------------------------------------------------------

    def thrust(self) -> None:
        np.negative(self._s.allocator.thrust, out=self.values["thrust_z"])

    def motors(self) -> None:
        """Copy the motor commands to the logged values.

        NaN is logged for missing rotors, and for all motors of a disarmed vehicle, as in PX4.
        """
        allocator = self._s.allocator
        armed = np.array([v.commander.armed for v in self._s.vehicles])
        rotors = min(_MOTORS, allocator.present.shape[1])
        shown = (allocator.present & armed[:, None])[:, :rotors]
        self.values["control"][:, :rotors] = np.where(shown, self._motors[:, :rotors], np.nan)

    def position(self) -> None:
        to, r, variance = self.values, self._s.est.r_nb, self._variance
        to["heading"][:] = arctan2(r[:, 1, 0], r[:, 0, 0])
        np.add(variance[:, 6], variance[:, 7], out=to["tilt_var"])
        self._set_accuracies()
        inputs = [v.inputs for v in self._s.vehicles]
        to["xy_valid"][:] = [each.xy_valid for each in inputs]
        to["z_valid"][:] = [each.z_valid for each in inputs]
        to["yaw_valid"][:] = [each.yaw_valid for each in inputs]
        self._set_origins()

    def _set_accuracies(self) -> None:
        """Compute the horizontal and vertical accuracies of position and velocity from the variances."""
        variance, found = self._variance, self._accuracies
        np.add(variance[:, 0:4:3], variance[:, 1:5:3], out=found[:, 0::2])  # north and east, of both
        found[:, 1::2] = variance[:, 2:6:3]
        np.sqrt(found, out=found)

    def _set_origins(self) -> None:
        """Read the origins of the local frames again if they have changed."""
        origins = [v.origin for v in self._s.vehicles]
        if origins == self._origins:
            return
        self._origins, to = origins, self.values
        known = np.array([each or (np.nan, np.nan, np.nan, 0.0) for each in origins])
        to["lat0"][:], to["lon0"][:], to["alt0"][:], self._headings = known.T
        to["has_origin"][:] = np.isfinite(to["lat0"])

    def globe(self) -> None:
        s, to = self._s, self.values
        self._set_origins()
        self._set_accuracies()
        north, east = s.est.p_n[:, 0], s.est.p_n[:, 1]
        to["lat"][:], to["lon"][:] = globe_from_local(to["lat0"], to["lon0"], north, east, self._headings)
        to["alt"][:] = to["alt0"] - s.est.p_n[:, 2]
        to["globe_valid"][:] = [v.origin is not None and v.inputs.xy_valid for v in s.vehicles]

    def setpoint(self) -> None:
        """Copy the setpoints of the position controllers to the logged values.

        They are NaN for vehicles whose position controller does not run.
        """
        s, to = self._s, self.values
        runs = s.sp.has_level(Level.POSITION)
        velocity = np.where(runs[:, None], s.cascade.position.v_sp_n, np.nan)
        to["v_sp_north"][:], to["v_sp_east"][:], to["v_sp_down"][:] = velocity.T
        to["a_sp_n"][:] = np.where(runs[:, None], s.cascade.position.a_sp_n, np.nan)
        held = np.where(runs, yaw_from_quat(s.cascade.q_sp), np.nan)
        to["yaw_held"][:] = np.where(np.isnan(s.sp.yaw), held, s.sp.yaw)

    def air(self) -> None:
        to = self.values
        to["baro_alt"][:] = self._sensors["baro_alt_m"]
        to["pressure_pa"][:] = 100.0 * pressure_hpa(to["baro_alt"])
        to["air_density"][:] = to["pressure_pa"] / (_GAS_CONSTANT * _TEMPERATURE_K)

    def magnetometer(self) -> None:
        self.values["mag_b"][:] = self._sensors["mag_b"]

    def battery(self) -> None:
        to = self.values
        to["voltage"][:], to["current"][:] = self._sensors["battery_v"], self._sensors["battery_current_a"]
        to["remaining"][:] = self._sensors["battery_remaining"]
        to["discharged_mah"][:] = self._consumed_mah
        limits = self._s.params.columns("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")
        to["battery_warning"][:] = (to["remaining"][:, None] <= limits).sum(1)

    def allocation(self) -> None:
        self.values["torque_achieved"][:] = ~self._s.cascade.saturated.any(1)

    def estimator(self) -> None:
        s, to, now, est = self._s, self.values, self._now, self._s.est
        self._set_accuracies()
        to["ratio_position"][:], to["ratio_yaw"][:] = est.test_ratio.T
        to["ratio_z"][:] = est.test_ratios()[:, 2]
        np.greater(to["ratio_position"], 1.0, out=to["rejects_position"])
        np.greater(to["ratio_yaw"], 1.0, out=to["rejects_yaw"])
        np.logical_and(s.takeoff.flying, ~s.land.landed, out=to["in_air"])
        to["at_rest"][:], to["aligned"][:] = s.land.at_rest, est.aligned
        lasts = (est.last_xy, est.last_z, est.last_yaw, est.last_baro)
        for name, last in zip(("fuses_xy", "fuses_z", "fuses_yaw", "fuses_baro"), lasts, strict=True):
            to[name][:] = (now - last < _RECENTLY_S) & est.aligned
        np.sum(self._flags * _BITS, axis=1, out=to["control_flags"])
        inputs = [v.inputs for v in s.vehicles]
        to["solution_flags"][:] = [
            _ATTITUDE * each.aligned
            + (_HORIZONTAL | _RELATIVE | _ABSOLUTE * (v.origin is not None)) * each.xy_valid
            + _VERTICAL * each.z_valid
            for v, each in zip(s.vehicles, inputs, strict=True)
        ]

    def innovations(self) -> None:
        """Copy the innovations of the estimator to the logged values, with PX4's sign: estimate minus measurement."""
        est = self._s.est
        found = {"innovation": -est.innovation, "variance": est.innovation_var, "ratio": est.test_ratios()}
        for kind, values in found.items():
            self.values[f"{kind}_xy"][:], self.values[f"{kind}_z"][:] = values[:, :2], values[:, 2]
            self.values[f"{kind}_yaw"][:] = values[:, 3]

    def states(self) -> None:
        """Copy the estimated states and their variances in PX4's order: attitude, velocity, position, biases."""
        est, states, variances = self._s.est, self.values["states"], self.values["covariances"]
        parts = (est.q_nb, est.v_n, est.p_n, est.gyro_bias, est.accel_bias)
        states[:, :16] = np.concatenate(parts, axis=1)
        variances[:, :15] = self._variance[:, (6, 7, 8, 3, 4, 5, 0, 1, 2, 9, 10, 11, 12, 13, 14)]

    def biases(self) -> None:
        self.values["aligned"][:] = self._s.est.aligned
        self.values["accel_bias_limit"][:] = self._s.params["EKF2_ABL_LIM"]
