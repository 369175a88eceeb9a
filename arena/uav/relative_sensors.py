"""Emulated relative sensors of a vehicle: `uav.sen.neighbours[...]`, `uav.sen.beacons[...]` and `uav.sen.emu`.

The measurements arrive as MAVLink. A value that is too old raises StaleDataError.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from arena.errors import StaleDataError
from arena.geometry import Array
from arena.uav.data_source import Source
from arena.wire.relative_measurements import BeaconMeasurement, NeighbourMeasurement


class Neighbour:
    """Measured position and velocity of one neighbour relative to the vehicle."""

    def __init__(self, source: Source, name: str) -> None:
        self._source, self._name = source, name
        self._number = source.relative.sensors.neighbours[name]

    @property
    def age_s(self) -> float:
        """Age of the measurement [s]. It is infinite before the first measurement."""
        self._source.refresh()
        return self._source.age(self._source.relative.neighbours.get(self._number))

    @property
    def stamp_s(self) -> float:
        """Time of the measurement, by the clock of the sensor [s]: a new value means a new measurement."""
        return self.measurement.time_s

    @property
    def pos(self) -> Array:
        """Position of the neighbour minus that of the vehicle [m] [NED] (3,)."""
        return np.array(self.measurement.pos)

    @property
    def vel(self) -> Array:
        """Velocity of the neighbour minus that of the vehicle [m/s] [NED] (3,)."""
        return np.array(self.measurement.vel)

    @property
    def measurement(self) -> NeighbourMeasurement:
        """Newest measurement of the neighbour, with all its values at the same instant."""
        self._source.refresh()
        found, limit = self._source.relative.neighbours.get(self._number), self._limit_s
        return self._source.fresh(found, f"measurement of neighbour {self._name}", limit).value

    @property
    def _limit_s(self) -> float:
        return max(self._source.stale_s, self._source.relative.sensors.neighbours_stale_s)


class Beacon:
    """Measured distance and direction of one beacon. Angles are in the body axes of the vehicle (FRD)."""

    def __init__(self, source: Source, name: str) -> None:
        self._source, self._name = source, name
        self._number = source.relative.sensors.beacons[name]

    @property
    def age_s(self) -> float:
        """Age of the measurement [s]. It is infinite before the first measurement."""
        self._source.refresh()
        return self._source.age(self._source.relative.beacons.get(self._number))

    @property
    def stamp_s(self) -> float:
        """Time of the measurement, by the clock of the sensor [s]: a new value means a new measurement."""
        return self.measurement.time_s

    @property
    def pos(self) -> Array:
        """Position of the beacon in the arena, as the YAML gives it [m] [NED] (3,)."""
        return np.array(self.measurement.p_n)

    @property
    def range(self) -> float:
        """Distance from the body origin to the beacon [m]."""
        return self.measurement.range_m

    @property
    def azimuth(self) -> float:
        """Angle from forward, in the plane of forward and right, positive to the right [rad] [FRD]."""
        return self.measurement.azimuth

    @property
    def elevation(self) -> float:
        """Angle above the plane of forward and right, positive towards the top of the vehicle [rad] [FRD]."""
        return self.measurement.elevation

    @property
    def direction(self) -> Array:
        """Unit vector from the vehicle to the beacon [-] [FRD] (3,)."""
        m = self.measurement
        level = math.cos(m.elevation)
        return np.array([level * math.cos(m.azimuth), level * math.sin(m.azimuth), -math.sin(m.elevation)])

    @property
    def measurement(self) -> BeaconMeasurement:
        """Newest measurement of the beacon, with all its values at the same instant."""
        self._source.refresh()
        found, limit = self._source.relative.beacons.get(self._number), self._limit_s
        return self._source.fresh(found, f"measurement of beacon {self._name}", limit).value

    @property
    def _limit_s(self) -> float:
        return max(self._source.stale_s, self._source.relative.sensors.beacons_stale_s)


class Neighbours(Mapping[str, Neighbour]):
    """Measured neighbours by name, `uav.sen.neighbours`, in the order of the YAML key `neighbours`."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._items = {name: Neighbour(source, name) for name in source.relative.sensors.neighbours}

    def __getitem__(self, name: str) -> Neighbour:
        if name not in self._items:
            raise _unknown(self._source.ns, name, "neighbour", self._items, "neighbours")
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


class Beacons(Mapping[str, Beacon]):
    """Measured beacons by name, `uav.sen.beacons`, in the order of the YAML key `beacons`."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._items = {name: Beacon(source, name) for name in source.relative.sensors.beacons}

    def __getitem__(self, name: str) -> Beacon:
        if name not in self._items:
            raise _unknown(self._source.ns, name, "beacon", self._items, "beacon_sensor")
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def in_range(self) -> list[Beacon]:
        """Return the beacons whose measurement is not stale. Never raises an error."""
        found = []
        for beacon in self._items.values():
            try:
                _ = beacon.measurement
            except StaleDataError:
                continue
            found.append(beacon)
        return found


class EmulatedSensor:
    """All neighbours' relative positions and velocities as arrays, `uav.sen.emu`.

    Row k belongs to neighbour k of the YAML. It is the sensor of the thesis.
    """

    def __init__(self, source: Source) -> None:
        self._neighbours = Neighbours(source)

    @property
    def age_s(self) -> float:
        """Age of the oldest measurement [s]. It is infinite until every neighbour has been measured."""
        return max((n.age_s for n in self._neighbours.values()), default=math.inf)

    @property
    def rel_pos(self) -> Array:
        """Positions of the neighbours minus the position of the vehicle [m] [NED] (n, 3)."""
        return np.array([n.pos for n in self._neighbours.values()]).reshape(-1, 3)

    @property
    def rel_vel(self) -> Array:
        """Velocities of the neighbours minus the velocity of the vehicle [m/s] [NED] (n, 3)."""
        return np.array([n.vel for n in self._neighbours.values()]).reshape(-1, 3)


def _unknown(ns: str, name: str, what: str, known: Mapping[str, object], key: str) -> KeyError:
    names = ", ".join(known) or "none"
    return KeyError(
        f"{ns}: got {what} {name!r}, expected one of: {names}. Add it to `{key}` of {ns} in the YAML"
    )
