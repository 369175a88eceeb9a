"""All sensors of a fleet with seeded noise, biases and ranges. One call samples all of them.

Every sensor of every vehicle has its own random stream, seeded by the arena's seed, the vehicle's id and the number of
the sensor. Adding a vehicle or a sensor therefore does not change the noise of the existing ones. Each sample has white noise, whose
density does not depend on the sensor rate. Biases are drawn once per flight, and can walk.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from arena.kernels.sensor_readings import ReadingLimits
from arena.sim.sensors.sensor import NOISE_HZ, Array, Channel, Motion, Sensor, Site

_WALK = 1  # purpose of the random streams of walking biases
_BLOCK = 256  # samples drawn at once: the cost of a draw is per call


class SensorSuite:
    """Simulation of all sensors of V vehicles. It adds noise and biases to the true motion.

    table: key under the profiles' `sensors:` -> class of the sensor
    profiles, ids: profiles and system ids of the vehicles
    seed: seed of the arena
    period_s: period of the sensor steps [s]
    """

    def __init__(
        self,
        table: Mapping[str, type[Sensor]],
        profiles: Sequence[Mapping[str, Any]],
        ids: Sequence[int],
        *,
        seed: int,
        site: Site,
        period_s: float,
    ) -> None:
        def group(names: list[str]) -> _Group:
            chosen = {name: table[name] for name in names}
            return _Group(chosen, profiles, ids, seed=seed, site=site, period_s=period_s)

        always = [name for name, sensor in table.items() if not sensor.on_request]
        self._every_step = [group(always)] if always else []
        self._on_request = {name: group([name]) for name in table if name not in always}

    def sample(self, motion: Motion, requested: Collection[str] = ()) -> dict[str, Array]:
        """Return one sample of every sensor: name of the quantity -> values (V,) or (V, axes).

        Call this once per step. The next call overwrites the arrays.

        motion: true motion of the vehicles
        requested: names of the sensors to sample in addition, which are sampled on request only
        """
        found: dict[str, Array] = {}
        for group in self._every_step:
            found |= group.sample(motion)
        if requested:
            for name in requested:
                found |= self._on_request[name].sample(motion)
        return found

    def biases(self) -> dict[str, Array]:
        """Return sensor name -> biases (V, width), one column per axis of the sensor."""
        groups = (*self._every_step, *self._on_request.values())
        return {name: bias for group in groups for name, bias in group.biases().items()}


class _Group:
    """Group of sensors that are sampled in one call.

    It contains all sensors of every step, or one sensor that is sampled on request.

    The arrays of a group have one column per axis of each sensor. Their number is called `width`.
    """

    def __init__(
        self,
        table: Mapping[str, type[Sensor]],
        profiles: Sequence[Mapping[str, Any]],
        ids: Sequence[int],
        *,
        seed: int,
        site: Site,
        period_s: float,
    ) -> None:
        self._sensors: list[tuple[str, Sensor, slice]] = []
        begin = 0
        for name, make in table.items():
            width = sum(channel.axes for channel in make.channels)
            self._sensors.append((name, make(profiles, site, period_s), slice(begin, begin + width)))
            begin += width
        self._noise = _RandomStreams(table, ids, seed)
        on_request = any(sensor.on_request for sensor in table.values())
        self._sigma = _profile_values(table, profiles, "noise") * (
            1.0 if on_request else _noise_ratio(period_s)
        )
        self._walk = _profile_values(table, profiles, "walk") * math.sqrt(period_s)
        self._walk_noise = _RandomStreams(table, ids, seed, _WALK) if self._walk.any() else None
        most, self._width = _profile_values(table, profiles, "range"), begin
        self._limits = ReadingLimits(most) if np.isfinite(most).any() else None
        self._bias: Array = self._noise.draw(1)[0] * _profile_values(table, profiles, "bias")
        self._block: Array = np.zeros((_BLOCK, len(profiles), begin))
        self._values: Array = np.zeros((len(profiles), begin))  # of one sample: noise and bias, then readings
        self._parts = [(sensor, self._values[:, columns]) for _, sensor, columns in self._sensors]
        self._readings: dict[str, Array] = {}
        for sensor, values in self._parts:
            self._readings |= sensor.views(values)
        self._next = _BLOCK

    def sample(self, motion: Motion) -> dict[str, Array]:
        if self._next == _BLOCK:
            self._draw()
        self._values[...] = self._block[self._next]
        self._next += 1
        for sensor, values in self._parts:
            sensor.measure(values, motion)
        if self._limits is not None:
            self._limits.limit(self._values, self._width)
        return self._readings

    def biases(self) -> dict[str, Array]:
        return {name: self._bias[:, columns] for name, _, columns in self._sensors}

    def _next_biases(self, count: int) -> Array:
        """Return the biases of the next `count` samples (count, V, width), or (V, width) if they are constant."""
        if self._walk_noise is None:
            return self._bias
        biases: Array = self._bias + np.cumsum(self._walk_noise.draw(count) * self._walk, axis=0)
        self._bias = biases[-1]
        return biases

    def _draw(self) -> None:
        """Draw noise plus bias for the next samples."""
        self._block, self._next = self._noise.draw(_BLOCK) * self._sigma + self._next_biases(_BLOCK), 0


class _RandomStreams:
    """Random generators of standard normal numbers, one for each vehicle and sensor.

    purpose: numbers that distinguish several streams of one sensor
    """

    def __init__(
        self, table: Mapping[str, type[Sensor]], ids: Sequence[int], seed: int, *purpose: int
    ) -> None:
        widths = [(sensor.stream, sum(c.axes for c in sensor.channels)) for sensor in table.values()]
        self._streams = [
            [(np.random.default_rng([seed, vehicle, stream, *purpose]), width) for stream, width in widths]
            for vehicle in ids
        ]

    def draw(self, count: int) -> Array:
        """Return the next `count` random numbers for all axes (count, V, axes).

        axes: number of axes of all sensors.
        """
        rows = [
            np.concatenate([rng.standard_normal((count, width)) for rng, width in each], axis=1)
            for each in self._streams
        ]
        return np.stack(rows, axis=1)


def _noise_ratio(period_s: float) -> float:
    """Return the factor from a sensor's noise at NOISE_HZ to its noise at a sample period [-].

    The noise is white, so its standard deviation grows with the root of the sample rate.
    """
    return math.sqrt(1.0 / (NOISE_HZ * period_s))


def _profile_values(
    table: Mapping[str, type[Sensor]], profiles: Sequence[Mapping[str, Any]], what: str
) -> Array:
    """Return one property of every sensor axis, such as the noise, from the profile of each vehicle (V, axes).

    what: name of the property: noise, bias, walk or range
    """
    rows = [
        [
            x
            for name, sensor in table.items()
            for channel in sensor.channels
            for x in [_figure(profile.get("sensors", {}).get(name, {}), channel, what)] * channel.axes
        ]
        for profile in profiles
    ]
    return np.array(rows, float)


def _figure(keys: Mapping[str, Any], channel: Channel, what: str) -> float:
    key, default = getattr(channel, what), getattr(channel, f"default_{what}", 0.0)
    return float(keys.get(key, default)) if key else (math.inf if what == "range" else 0.0)
