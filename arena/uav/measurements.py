"""Storage of the newest measurements of a vehicle's emulated relative sensors. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, Self, TypeVar

from arena.wire.relative_measurements import (
    BeaconMeasurement,
    NeighbourMeasurement,
    is_sensor_datagram,
    measurements,
)

M = TypeVar("M", NeighbourMeasurement, BeaconMeasurement)


@dataclass(frozen=True, kw_only=True)
class RelativeSensors:
    """Configuration of a vehicle's emulated relative sensors: which neighbours and beacons they measure.

    neighbours: name of each measured neighbour -> its MAV_SYS_ID.
    beacons: name of each measured beacon -> its number, from 1 in the order of the YAML.
    neighbours_stale_s, beacons_stale_s: age from which on a measurement is too old to be used [s].
    """

    neighbours: Mapping[str, int] = field(default_factory=dict)
    beacons: Mapping[str, int] = field(default_factory=dict)
    neighbours_stale_s: float = 0.5
    beacons_stale_s: float = 0.5


@dataclass(frozen=True, kw_only=True, slots=True)
class Received(Generic[M]):
    """Measurement of a relative sensor, with its time of arrival [s]."""

    received_at: float
    value: M


class Measurements:
    """Newest measurement of each neighbour and beacon of one vehicle.

    sensors: configuration of the vehicle's relative sensors.  system_id: MAV_SYS_ID of the vehicle; measurements for others are ignored.
    neighbours: MAV_SYS_ID of the neighbour -> measurement.  beacons: number of the beacon -> measurement.
    """

    def __init__(self, sensors: RelativeSensors, system_id: int) -> None:
        self.sensors, self._system = sensors, system_id
        self.neighbours: dict[int, Received[NeighbourMeasurement]] = {}
        self.beacons: dict[int, Received[BeaconMeasurement]] = {}

    def on_datagram(self, datagram: bytes, now: float) -> None:
        """Store the relative measurements that a datagram contains.

        now: time of arrival [s].
        """
        if not is_sensor_datagram(datagram):
            return
        for found in measurements(datagram, self._system):
            if isinstance(found, NeighbourMeasurement):
                self.neighbours[found.system_id] = Received(received_at=now, value=found)
            else:
                self.beacons[found.number] = Received(received_at=now, value=found)

    def __copy__(self) -> Self:
        """Return a copy of the present measurements. The copy never changes."""
        made = type(self)(self.sensors, self._system)
        made.neighbours, made.beacons = dict(self.neighbours), dict(self.beacons)
        return made
