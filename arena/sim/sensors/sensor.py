"""The plug point of simulated sensors: what one kind of sensor must provide."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from arena.wire.hil import HilOutput

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A group of equal axes of a sensor: the profile keys of its errors, and their defaults.

    axes: how many numbers it measures
    noise: key of the standard deviation of one sample
    bias: key of the standard deviation of the bias, drawn once per flight; "" for none
    range: key of the largest value it measures, either sign; "" for none
    """

    axes: int
    noise: str
    default_noise: float
    bias: str = ""
    default_bias: float = 0.0
    range: str = ""
    default_range: float = math.inf


@dataclass(frozen=True, kw_only=True)
class GlobalOrigin:
    """The arena's origin on Earth [deg] [deg] [m above mean sea level]."""

    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, kw_only=True)
class Site:
    """The place of the arena on Earth.

    heading_rad: its north, clockwise from true north [rad]
    origin: None when the YAML gives none
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
    """

    accel_b: Array
    omega_b: Array
    r_nb: Array
    p_n: Array
    v_n: Array


class Sensor(Protocol):
    """A kind of sensor, on all V vehicles at once.

    stream: number of the random stream it draws from. Sensors that share a stream take turns in it, so a new sensor
        takes a number of its own: then no other sensor's noise changes.
    channels: its errors and their profile keys
    readings: names of the arrays that `sample` returns
    on_request: sampled only when an autopilot requests it, else at every step
    hil: what it adds to PX4's simulator API
    log_columns: columns of the vehicle's CSV log in which its readings appear, as the autopilot reports them
    """

    stream: ClassVar[int]
    channels: ClassVar[tuple[Channel, ...]]
    readings: ClassVar[tuple[str, ...]]
    on_request: ClassVar[bool]
    hil: ClassVar[HilOutput]
    log_columns: ClassVar[tuple[str, ...]]

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site) -> None:
        """Read each profile's keys, which are under `sensors:` and the sensor's name in the table."""
        ...

    def sample(self, noise: Array, motion: Motion) -> dict[str, Array]:
        """Return one sample of each reading, name -> values (V,) or (V, axes); {} when there is nothing to measure.

        noise: noise plus bias, one column per axis of the channels (V, width). The sensor may add the true values to
            it in place and return views: the suite then limits them to the channels' ranges.
        """
        ...
