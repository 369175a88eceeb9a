"""All sensors of a fleet: seeded noise, biases and ranges. One call per step samples all of them.

Every vehicle has its own random streams, seeded by the arena's seed and the vehicle's id. So adding a vehicle
does not change the noise of the others. Each sample has white noise; biases are drawn once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site

_BLOCK = 256  # samples drawn at once: the cost of a draw is per call


class SensorSuite:
    """Simulation of all sensors of V vehicles: adds noise and biases to the true motion.

    table: key under the profiles' `sensors:` -> class of the sensor
    profiles, ids: profiles and system ids of the vehicles
    seed: seed of the arena
    """

    def __init__(
        self,
        table: Mapping[str, type[Sensor]],
        profiles: Sequence[Mapping[str, Any]],
        ids: Sequence[int],
        *,
        seed: int,
        site: Site,
    ) -> None:
        groups: dict[tuple[int, bool], list[str]] = {}
        for name, sensor in table.items():
            groups.setdefault((sensor.stream, sensor.on_request), []).append(name)
        self._every_step: list[_Group] = []
        self._on_request: dict[str, _Group] = {}
        for (_, on_request), names in groups.items():
            group = _Group({n: table[n] for n in names}, profiles, ids, seed=seed, site=site)
            if on_request:
                self._on_request |= dict.fromkeys(names, group)
            else:
                self._every_step.append(group)

    def sample(self, motion: Motion, requested: Collection[str] = ()) -> dict[str, Array]:
        """Return one sample of every sensor, as measured quantity -> values (V,) or (V, axes). Call this once
        per step.

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
    """Sensors whose noise is drawn together, from one random generator per vehicle. Its arrays have one column per sensor axis."""

    def __init__(
        self,
        table: Mapping[str, type[Sensor]],
        profiles: Sequence[Mapping[str, Any]],
        ids: Sequence[int],
        *,
        seed: int,
        site: Site,
    ) -> None:
        self._sensors: list[tuple[str, Sensor, slice]] = []
        begin = 0
        for name, make in table.items():
            width = sum(channel.axes for channel in make.channels)
            self._sensors.append((name, make(profiles, site), slice(begin, begin + width)))
            begin += width
        self._width = begin
        stream = next(iter(table.values())).stream
        self._streams = [np.random.default_rng([seed, vehicle, stream]) for vehicle in ids]
        self._sigma = _figures(table, profiles, "noise")
        self._range = _figures(table, profiles, "range")
        self._limited = bool(np.isfinite(self._range).any())
        self._bias: Array = np.zeros((len(ids), self._width))
        if any(channel.bias for sensor in table.values() for channel in sensor.channels):
            drawn = np.array([stream.standard_normal(self._width) for stream in self._streams])
            self._bias = drawn * _figures(table, profiles, "bias")
        self._next = _BLOCK

    def sample(self, motion: Motion) -> dict[str, Array]:
        row = self._draw()
        found: dict[str, Array] = {}
        for _, sensor, columns in self._sensors:
            found |= sensor.sample(row[:, columns], motion)
        if self._limited:
            np.minimum(row, self._range, out=row)
            np.maximum(row, -self._range, out=row)
        return found

    def biases(self) -> dict[str, Array]:
        return {name: self._bias[:, columns] for name, _, columns in self._sensors}

    def _draw(self) -> Array:
        """Return noise plus bias for the next sample (V, width)."""
        if self._next == _BLOCK:
            drawn = np.stack([s.standard_normal((_BLOCK, self._width)) for s in self._streams], axis=1)
            self._block, self._next = drawn * self._sigma + self._bias, 0
        self._next += 1
        return np.array(self._block[self._next - 1])


def _figures(table: Mapping[str, type[Sensor]], profiles: Sequence[Mapping[str, Any]], what: str) -> Array:
    """Return one property of every sensor axis, such as the noise, from the profiles of the vehicles (V, width).

    what: name of the property: noise, bias or range
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
    key, default = getattr(channel, what), getattr(channel, f"default_{what}")
    return float(keys.get(key, default)) if key else (math.inf if what == "range" else 0.0)
