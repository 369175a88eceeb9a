"""Data of the router about its vehicles and clients: addresses, MAVLink senders, receivers that were found, and counters."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from arena.authority import Role
from arena.mavlink_router.routing_table import Vehicle
from arena.mavlink_router.vehicle_status import VehicleStatus
from arena.mavlink_router.vehicle_telemetry import VehicleTelemetry
from arena.transport import Address
from arena.wire.mavlink_frame import Buffer

Destinations = tuple[tuple[int, Address], ...]
"""(index in `Router.sockets` to send from, address to send to) of each receiver."""
Out = tuple[Buffer, Destinations]
"""A datagram to send, and its receivers. It is usually a part of the received datagram."""


@dataclass(kw_only=True)
class Endpoint:
    """Address of a client, tool or ground station, to which the router sends messages.

    The MAVLink senders that have sent from this address are recorded, so that replies to them are sent to it.

    socket: index in `Router.sockets`
    role: role of the senders; None for a tool, whose role follows from its MAVLink system id
    senders: system << 8 | component of every sender that has used this address, oldest first
    last: time of the last frame, monotonic [s]
    """

    socket: int
    address: Address
    role: Role | None = Role.PROGRAM
    senders: dict[int, None] = field(default_factory=dict)
    last: float = 0.0

    def serves(self, target: int) -> bool:
        """Return whether this client must receive a vehicle's message that is addressed to `target`.

        target: system << 8 | component; component 0 means every component of the system
        """
        if target in self.senders:
            return True
        return not target & 0xFF and any(sender >> 8 == target >> 8 for sender in self.senders)


@dataclass(kw_only=True)
class VehicleRoutes:
    """Data that the router keeps about one vehicle: its sockets, status, clients and the receivers of its messages.

    number: index in the routing table
    serve_socket, tool_socket: indices in `Router.sockets`
    sensor_socket: the same for measurements of emulated sensors; None: the vehicle has no such sensors
    up: the autopilot's end of the router link
    up_and_record: the same, and the recorder. record: the recorder, for messages from the vehicle
    tools: clients that have sent to the tool socket
    routes: MAVLink target of a message -> its receivers, kept so that they are searched once; cleared when an endpoint changes
    """

    number: int
    vehicle: Vehicle
    status: VehicleStatus
    telemetry: VehicleTelemetry = field(default_factory=VehicleTelemetry)
    serve_socket: int = 0
    tool_socket: int = 0
    sensor_socket: int | None = None
    up: Destinations = ()
    up_and_record: Destinations = ()
    record: Destinations = ()
    clients: dict[Address, Endpoint] = field(default_factory=dict)
    tools: dict[Address, Endpoint] = field(default_factory=dict)
    routes: dict[int, Destinations] = field(default_factory=dict)


@dataclass(kw_only=True)
class Counts:
    """Number of frames and bytes since the start. A frame that is sent to n receivers counts n times. The copies of frames to
    vehicles, which the recorder receives, count only in `bytes_out`.

    unknown: frames of messages that are not in the table of CRC seeds
    dropped: reason -> number of frames that were not forwarded
    """

    frames_from_vehicles: int = 0
    frames_from_clients: int = 0
    frames_to_vehicles: int = 0
    frames_to_clients: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    unknown: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


def is_loopback(address: Address) -> bool:
    """Return whether an address is on this computer's loopback network."""
    return address[0].startswith("127.")
