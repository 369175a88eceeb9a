"""Sensors of a whole fleet: what the vehicle would measure, drawn on a copy of the truth. Pure, batched,
seeded.

Every vehicle draws from streams of its own, seeded by the arena's seed and its id: one more vehicle changes
nobody's noise. White noise on each sample, a bias drawn once; a GPS receiver's position wanders. The arena's
heading turns the magnetometer and the global position, nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.geometry import globe_from_local
from arena.sim.vehicle_arrays import Fleet

Array = NDArray[np.float64]

# Mid-northern latitudes: field 0.48 gauss, dipping 64 degrees, declination taken as nought.
_FIELD_GAUSS, _DIP_RAD = 0.48, math.radians(64.0)
_BLOCK = 256
# A receiver's position wanders: its error is a Gauss-Markov process. Source: the simulators that PX4 is flown in take 60 s.
_GPS_WANDERS_S, _GPS_RATE_HZ = 60.0, 10.0


@dataclass(frozen=True, kw_only=True)
class _Channel:
    """A group of a profile, and standard deviations of one sample and of the bias. The last is the range,
    symmetric.
    """

    group: str
    noise: str
    bias: str
    axes: int
    default_noise: float
    default_bias: float
    range: str = ""
    default_range: float = math.inf


_CHANNELS = (
    _Channel(
        group="imu",
        noise="accel_noise_m_s2",
        bias="accel_bias_m_s2",
        axes=3,
        default_noise=0.05,
        default_bias=0.03,
        range="accel_range_m_s2",
        default_range=156.9,
    ),
    _Channel(
        group="imu",
        noise="gyro_noise_rad_s",
        bias="gyro_bias_rad_s",
        axes=3,
        default_noise=0.003,
        default_bias=0.002,
        range="gyro_range_rad_s",
        default_range=34.9,
    ),
    _Channel(
        group="mag", noise="noise_gauss", bias="bias_gauss", axes=3, default_noise=0.002, default_bias=0.002
    ),
    _Channel(group="baro", noise="noise_m", bias="bias_m", axes=1, default_noise=0.05, default_bias=0.2),
)
_WIDTH = sum(c.axes for c in _CHANNELS)


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where on Earth the arena's origin is [deg] [deg] [m above mean sea level]."""

    lat_deg: float
    lon_deg: float
    alt_m: float


class Sensors:
    """Accelerometer, gyroscope, magnetometer and barometer in one row of ten numbers per vehicle, and GPS
    when asked.
    """

    def __init__(self, fleet: Fleet, *, seed: int, heading_rad: float, origin: Origin | None) -> None:
        self._origin, self._heading = origin, heading_rad
        self._sigma, self._range = _rows(fleet, "noise"), _rows(fleet, "range")
        self._streams = [np.random.default_rng([seed, vehicle, 1]) for vehicle in fleet.ids]
        self._gps_streams = [np.random.default_rng([seed, vehicle, 2]) for vehicle in fleet.ids]
        self._gps_sigma = np.array([_gps_sigma(p) for p in fleet.profiles])
        self._gps_keep = np.exp(
            -1.0 / (_GPS_WANDERS_S * np.array([_gps_rate_hz(p) for p in fleet.profiles]))
        )[:, None]
        self._gps_error: Array | None = None  # of position [sigma] (V, 3)
        drawn = np.array([stream.standard_normal(_WIDTH) for stream in self._streams])
        self.bias: Array = drawn * _rows(fleet, "bias")
        self._next = _BLOCK
        level, down = math.cos(_DIP_RAD) * _FIELD_GAUSS, math.sin(_DIP_RAD) * _FIELD_GAUSS
        self._field_n = np.array([level * math.cos(heading_rad), -level * math.sin(heading_rad), down])
        self._altitude = origin.alt_m if origin else 0.0

    def sense(self, *, accel_b: Array, omega_b: Array, r_nb: Array, p_n: Array) -> dict[str, Array]:
        """accel_b: specific force [m/s2] [FRD] (V, 3); omega_b [rad/s] [FRD] (V, 3); r_nb: body to NED (V,
        3, 3); p_n [m] (V, 3).

        Returns accel_b [m/s2] [FRD] (V, 3), gyro_b [rad/s] [FRD] (V, 3), mag_b [gauss] [FRD] (V, 3) and
        baro_alt_m, above mean sea level [m] (V,).
        """
        row = self._draw()
        row[:, 0:3] += accel_b
        row[:, 3:6] += omega_b
        row[:, 6:9] += self._field_n @ r_nb
        row[:, 9] += self._altitude - p_n[:, 2]
        np.minimum(row, self._range, out=row)
        np.maximum(row, -self._range, out=row)
        return {"accel_b": row[:, 0:3], "gyro_b": row[:, 3:6], "mag_b": row[:, 6:9], "baro_alt_m": row[:, 9]}

    def gps(self, *, p_n: Array, v_n: Array) -> dict[str, Array]:
        """p_n [m] [NED] (V, 3), v_n [m/s] [NED] (V, 3) -> lat_deg, lon_deg, alt_m (V,), v_true_n: velocity,
        true north [m/s] (V, 3).

        One fix of each receiver at its own rate. Without an origin there is no GPS: an empty dict.
        """
        if self._origin is None:
            return {}
        drawn = np.array([stream.standard_normal(6) for stream in self._gps_streams])
        keep, before = self._gps_keep, self._gps_error
        self._gps_error = (
            drawn[:, :3] if before is None else keep * before + np.sqrt(1.0 - keep**2) * drawn[:, :3]
        )
        noise = np.concatenate([self._gps_error, drawn[:, 3:]], axis=1) * self._gps_sigma
        position, velocity = self._true_north(p_n) + noise[:, :3], self._true_north(v_n) + noise[:, 3:]
        lat, lon = globe_from_local(
            self._origin.lat_deg, self._origin.lon_deg, position[:, 0], position[:, 1]
        )
        return {
            "lat_deg": lat,
            "lon_deg": lon,
            "alt_m": self._origin.alt_m - position[:, 2],
            "v_true_n": velocity,
        }

    def _true_north(self, v_n: Array) -> Array:
        """The arena's north lies `heading` clockwise of true north: turn vectors back to the map's axes (V,
        3).
        """
        c, s = math.cos(self._heading), math.sin(self._heading)
        return np.stack([c * v_n[:, 0] - s * v_n[:, 1], s * v_n[:, 0] + c * v_n[:, 1], v_n[:, 2]], axis=-1)

    def _draw(self) -> Array:
        """Noise plus bias of one sample (V, _WIDTH). Drawn in blocks: numpy's cost is per call."""
        if self._next == _BLOCK:
            drawn = np.stack([stream.standard_normal((_BLOCK, _WIDTH)) for stream in self._streams], axis=1)
            self._block, self._next = drawn * self._sigma + self.bias, 0
        self._next += 1
        return np.array(self._block[self._next - 1])


def _rows(fleet: Fleet, what: str) -> Array:
    """One figure of every channel, per vehicle (V, _WIDTH)."""
    return np.array([[x for c in _CHANNELS for x in _figure(p, c, what)] for p in fleet.profiles])


def _figure(profile: Mapping[str, Any], channel: _Channel, what: str) -> list[float]:
    found = (
        profile.get("sensors", {})
        .get(channel.group, {})
        .get(getattr(channel, what), getattr(channel, f"default_{what}"))
    )
    return [float(found)] * channel.axes


def _gps_sigma(profile: Mapping[str, Any]) -> list[float]:
    gps = profile.get("sensors", {}).get("gps", {})
    level, up, speed = (
        float(gps.get(k, d))
        for k, d in (("horizontal_noise_m", 0.8), ("vertical_noise_m", 1.8), ("velocity_noise_m_s", 0.1))
    )
    return [level, level, up, speed, speed, speed]


def _gps_rate_hz(profile: Mapping[str, Any]) -> float:
    return float(profile.get("sensors", {}).get("gps", {}).get("rate_hz", _GPS_RATE_HZ))
