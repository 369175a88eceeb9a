"""Interface of simulated sensors. A class with this interface adds a kind of sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from arena.kernels.sensor_readings import TrueMotion
from arena.wire.hil import HilOutput

Array = NDArray[np.float64]

NOISE_HZ = 250.0
"""Sensor rate at which the profiles give the noise of one sample [Hz]. The density of white noise is the noise divided by the
square root of this rate. At another rate the noise of a sample is larger by the square root of the ratio."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Error model of a group of sensor axes: noise, bias and range.

    It names the keys of the profile that set the errors, and the default values.

    axes: number of axes
    noise: key of the standard deviation of one sample: at NOISE_HZ for a sensor that is sampled at every step, at the
        sensor's own rate for one on request
    bias: key of the standard deviation of the bias, drawn once per flight; "" for no bias
    walk: key of the random walk of the bias: standard deviation after one second; "" for none. The default is zero
    range: key of the largest absolute value that can be measured; "" for no limit
    """

    axes: int
    noise: str
    default_noise: float
    bias: str = ""
    default_bias: float = 0.0
    walk: str = ""
    range: str = ""
    default_range: float = math.inf


@dataclass(frozen=True, kw_only=True)
class GlobalOrigin:
    """Position of the arena's origin on Earth: latitude, longitude [deg], altitude above mean sea level [m]."""

    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, kw_only=True)
class Site:
    """Place and heading of the arena on Earth.

    heading_rad: direction of the arena's north, clockwise from true north [rad]
    origin: global origin, None if the YAML gives none
    """

    heading_rad: float
    origin: GlobalOrigin | None


@dataclass(frozen=True, kw_only=True)
class Motion:
    """True motion of V vehicles at one instant.

    accel_b: specific force [m/s2] [FRD] (V, 3)
    omega_b: angular velocity [rad/s] [FRD] (V, 3)
    r_nb: rotation from body to NED [-] (V, 3, 3)
    p_n: position of the body origin [m] [NED] (V, 3)
    v_n: velocity [m/s] [NED] (V, 3)
    spin: rotor state, about proportional to the rotor speed, 0..1 [-] (V, R)
    hover: rotor state in hover [-] (V,)
    """

    accel_b: Array
    omega_b: Array
    r_nb: Array
    p_n: Array
    v_n: Array
    spin: Array
    hover: Array

    @cached_property
    def measured(self) -> TrueMotion:
        """The compiled functions that add this motion to the noise of sensors."""
        return TrueMotion(self.accel_b, self.omega_b, self.r_nb, self.p_n)


class Sensor(Protocol):
    """Interface of one kind of sensor, such as the barometer, simulated for all V vehicles at once.

    stream: number of its random streams, one for each vehicle. Each sensor has another number.
    channels: its errors and their profile keys
    readings: names of the arrays of `views`
    on_request: True if it is sampled only when an autopilot requests it, else it is sampled at every step
    hil: data that it adds to PX4's simulator API
    log_columns: columns of the vehicle's CSV log in which the autopilot's report of its readings appears
    """

    stream: ClassVar[int]
    channels: ClassVar[tuple[Channel, ...]]
    readings: ClassVar[tuple[str, ...]]
    on_request: ClassVar[bool]
    hil: ClassVar[HilOutput]
    log_columns: ClassVar[tuple[str, ...]]

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site, period_s: float) -> None:
        """Read the sensor's parameters from the profile of each vehicle.

        profiles: of the vehicles; the keys are under `sensors:` and the sensor's name in the table
        period_s: period of the sensor steps [s]
        """
        ...

    def views(self, values: Array) -> dict[str, Array]:
        """Return the arrays of the readings: name -> (V,) or (V, axes). {} if nothing can be measured.

        values: one column per axis of the channels (V, width). The readings can be views of it.
        """
        ...

    def measure(self, values: Array, motion: Motion) -> None:
        """Measure once, and write the new values to the arrays that `views` returned.

        values: the array that was passed to `views`, with new noise plus bias. The sensor may add the true values to it in
            place; the suite then limits them to the ranges of the channels.
        motion: true motion of the vehicles
        """
        ...
