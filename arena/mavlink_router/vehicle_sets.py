"""Receivers of messages that clients or ground stations send to one, several or all vehicles."""

from __future__ import annotations

from collections.abc import Sequence

from arena.mavlink_router.datagrams import NO_TARGET
from arena.mavlink_router.endpoints import TO_ALL, Destinations, VehicleRoutes


class VehicleSets:
    """Receivers of a message to one or several vehicles, by an integer key for each set of vehicles.

    The key is the system id of one vehicle, `TO_ALL`, `NO_TARGET`, or a number below `NO_TARGET` for several
    vehicles.

    Messages of ground stations are sent on the ground station link of a vehicle, all others on its router link. The recorder receives a
    copy of both.
    ids: MAVLink system ids of all vehicles
    copies: number of receivers of a message to one vehicle: its autopilot, and the recorder
    """

    def __init__(self, vehicles: Sequence[VehicleRoutes]) -> None:
        self.ids = [v.vehicle.id for v in vehicles]
        self.copies = len(vehicles[0].up_and_record) if vehicles else 1
        self._of_clients = {v.vehicle.id: v.up_and_record for v in vehicles}
        self._of_stations = {v.vehicle.id: v.ground_up_and_record for v in vehicles}
        self._of_stations[TO_ALL] = self._joined(self.ids)

    def receivers(self, key: int, *, station: bool) -> Destinations:
        """Return the receivers of a message to the set of vehicles that a key stands for.

        station: the sender is a ground station. Only ground stations can send to several vehicles.
        """
        return (self._of_stations if station else self._of_clients)[key]

    def key_of(self, found: Sequence[int]) -> int:
        """Return the key of the set of the vehicles with these MAVLink system ids."""
        key = NO_TARGET - sum(1 << vehicle for vehicle in found)
        if found:
            self._of_stations[key] = self._joined(found)
        return key

    def _joined(self, vehicles: Sequence[int]) -> Destinations:
        return tuple(place for vehicle in vehicles for place in self._of_stations[vehicle])
