"""Gives the state of the vehicles to the kernel `ulog_quantities`, which computes the values in the ULog records."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.control.control_allocator import ControlAllocator
from arena.autopilot.control.controllers import Cascade
from arena.autopilot.control.setpoints import Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.land_detector import LandDetector, TakeoffRamp
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.geometry import EARTH_M
from arena.kernels.arrays import array, integers, view
from arena.kernels.ulog_quantities import INPUTS, UlogQuantities

Array = NDArray[np.float64]
_NO_ORIGIN = (math.nan, math.nan, math.nan, 0.0)
_ROW = struct.Struct(f"{len(INPUTS)}d")  # faster than the assignment of a tuple to a row of an array


class Sources(Protocol):
    """Parts of the built-in autopilots (estimator, setpoints ...) whose values are logged.

    dt: sensor period [s]
    motors: motor commands 0..1 (V, R), always the same array
    consumed_mah: consumed charge [mAh] (V,), always the same array
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
    motors: Array
    consumed_mah: Array


class Quantities:
    """Inputs of the kernel that computes the logged values of V vehicles, such as setpoints and estimates.

    law: the compiled computation. It reads the arrays of the autopilots; the methods copy what is in no such array
    """

    def __init__(self, sources: Sources) -> None:
        s, sp, params = sources, sources.sp, sources.params
        self._vehicles = s.vehicles
        self.law = law = UlogQuantities(
            s.est.validity,
            s.cascade.law,
            s.allocator.law,
            view(s.motors),
            view(s.consumed_mah),
            integers(s.est.reset_counter),
            round(1e6 * s.dt),
            EARTH_M,
        )
        given = (sp.p_n, sp.v_n, sp.a_n, sp.yaw, sp.yaw_rate, sp.yaw_rate_ff)
        law.read_setpoints_from(integers(sp.level), *(view(each) for each in given))
        law.read_landing_from(s.land.landed, s.land.at_rest, s.takeoff.flying)
        names = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR", "EKF2_ABL_LIM")
        law.read_params_from(*(view(params[name]) for name in names))
        self._inputs = law.inputs
        self._mag_b, self._baro_alt = array(law.mag_b), array(law.baro_alt)
        self._battery_v, self._battery_a = array(law.battery_v), array(law.battery_a)
        self._battery = array(law.battery)

    def read_vehicles(self) -> None:
        """Copy arming state, origin and validity of the estimates of all vehicles to the kernel."""
        for i, v in enumerate(self._vehicles):
            s = v.inputs
            valid = (s.aligned, s.xy_valid, s.z_valid, s.yaw_valid)
            _ROW.pack_into(self._inputs, _ROW.size * i, v.commander.armed, *valid, *(v.origin or _NO_ORIGIN))

    def read_sensors(self, sensors: Mapping[str, Array]) -> None:
        """Copy measurements that the estimator does not store to the kernel. sensors: see `Autopilots.step`"""
        self._mag_b[...], self._baro_alt[...] = sensors["mag_b"], sensors["baro_alt_m"]
        self._battery_v[...], self._battery_a[...] = sensors["battery_v"], sensors["battery_current_a"]
        self._battery[...] = sensors["battery_remaining"]
