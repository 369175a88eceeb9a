"""Data of the router about vehicles and clients: addresses, MAVLink senders, receivers of messages, counters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from arena.authority import Role, role_of_tool
from arena.mavlink_router.routing_table import Vehicle
from arena.mavlink_router.vehicle_status import VehicleStatus
from arena.mavlink_router.vehicle_telemetry import VehicleTelemetry
from arena.transport import Address
from arena.wire.mavlink_frame import Buffer, Frame, byte_at

Destinations = tuple[tuple[int, Address], ...]
"""(index in `Router.sockets` to send from, address to send to) of each receiver."""
TO_ALL = 0
"""Target of a message that is addressed to no system."""
MAX_TOOLS = 16
"""Largest number of tools of a vehicle. If another one connects, the tool that has been silent for longest is removed."""
_HEARTBEAT_TYPE, _TYPE_GCS = 4, 6  # payload offset of `type` in HEARTBEAT; MAV_TYPE_GCS
Out = tuple[Buffer, Destinations]
"""A datagram to send, and its receivers. It is usually a part of the received datagram."""


@dataclass(kw_only=True)
class Endpoint:
    """Address of a client, tool or ground station that receives messages from the router.

    The MAVLink senders that have sent from this address are recorded, so that replies to them are sent to it.

    socket: index in `Router.sockets`
    role: role of the senders; None for a tool, whose role follows from its MAVLink system id
    senders: system << 8 | component of every sender that has used this address, oldest first
    last: real time of the last frame, monotonic [s]; only of a tool
    place: socket and address
    """

    socket: int
    address: Address
    role: Role | None = Role.PROGRAM
    senders: dict[int, None] = field(default_factory=dict)
    last: float = 0.0
    place: tuple[int, Address] = field(init=False)

    def __post_init__(self) -> None:
        self.place = self.socket, self.address

    def serves(self, target: int) -> bool:
        """Return whether this client must receive a vehicle's message for the MAVLink address `target`.

        target: system << 8 | component; component 0 means every component of the system
        """
        if target in self.senders:
            return True
        return not target & 0xFF and any(sender >> 8 == target >> 8 for sender in self.senders)


@dataclass(kw_only=True)
class AutopilotLink:
    """Link between the router and one autopilot: its socket, and the stored receivers of messages.

    remote: address of the autopilot's end. socket: index in `Router.sockets`
    number: index among the links of all vehicles, which the shortcut sets
    routes: MAVLink target of a message -> its receivers, kept so that they are searched once; cleared when an endpoint changes
    """

    remote: Address
    socket: int = 0
    number: int = 0
    routes: dict[int, Destinations] = field(default_factory=dict)

    @property
    def up(self) -> Destinations:
        """Destination of messages to the autopilot: ((socket index, address),)."""
        return ((self.socket, self.remote),)


@dataclass(kw_only=True)
class VehicleRoutes:
    """Data of the router about one vehicle: its sockets, status, clients and stored receivers.

    number: index in the routing table
    serve_socket, tool_socket: indices in `Router.sockets`
    sensor_socket: the same for measurements of emulated sensors; None: the vehicle has no such sensors
    links: the router link, then the ground station link if the vehicle has one
    up_and_record: the autopilot's end of the router link, and the recorder
    ground_up_and_record: receivers of a message that a ground station sends to the vehicle
    record: the recorder, for messages from the vehicle
    sensor_receivers: clients, tools and recorder, for measurements of emulated sensors; () if they must be searched again
    tools: clients that have sent to the tool socket, the one that has been silent for longest first
    """

    number: int
    vehicle: Vehicle
    status: VehicleStatus
    telemetry: VehicleTelemetry = field(default_factory=VehicleTelemetry)
    serve_socket: int = 0
    tool_socket: int = 0
    sensor_socket: int | None = None
    links: list[AutopilotLink] = field(default_factory=list)
    up_and_record: Destinations = ()
    record: Destinations = ()
    ground_up_and_record: Destinations = ()
    sensor_receivers: Destinations = ()
    clients: dict[Address, Endpoint] = field(default_factory=dict)
    tools: dict[Address, Endpoint] = field(default_factory=dict)

    @property
    def main(self) -> AutopilotLink:
        """Router link of the vehicle. Only messages on this link update the vehicle's status."""
        return self.links[0]

    @property
    def ground(self) -> AutopilotLink | None:
        """Ground station link of the vehicle, or None if the router link also serves ground stations."""
        return self.links[1] if len(self.links) > 1 else None

    def use_tool(self, sender: Address, now: float) -> tuple[Endpoint, bool]:
        """Return the endpoint of a tool that has just sent a frame, and whether the tool is new.

        now: real time, monotonic [s]
        """
        known = self.tools.pop(sender, None)
        endpoint = known or Endpoint(socket=self.tool_socket, address=sender, role=None)
        if known is None and len(self.tools) >= MAX_TOOLS:
            del self.tools[next(iter(self.tools))]
        self.tools[sender] = endpoint
        endpoint.last = now
        return endpoint, known is None

    def remove_tools(self, silent_since: float) -> bool:
        """Remove the tools that have sent nothing since this time, monotonic [s]. Return whether there were any."""
        silent = [address for address, tool in self.tools.items() if tool.last < silent_since]
        for address in silent:
            del self.tools[address]
        return bool(silent)

    def simulates_operator(self, endpoint: Endpoint, data: Buffer, frame: Frame) -> bool:
        """Return whether a HEARTBEAT must not reach the vehicle: a program sends it as a ground station.

        Libraries such as MAVSDK do so. While the vehicle receives such heartbeats, its failsafe `data_link_loss` does not act.
        It must act when no operator is present, also while a program still runs.
        """
        role = role_of_tool(frame.sysid) if endpoint.role is None else endpoint.role
        is_station = byte_at(data, frame, _HEARTBEAT_TYPE) == _TYPE_GCS
        return self.vehicle.needs_operator and role is Role.PROGRAM and is_station

    def receivers(self, link: AutopilotLink, target: int, stations: Iterable[Endpoint]) -> Destinations:
        """Return the receivers of a message that an autopilot has sent on `link`.

        The recorder receives the streams of the router link only, because those of the ground station link have the same contents.
        It receives the replies on both links.
        target: system << 8 | component; `TO_ALL` for a message to all. stations: all ground stations
        """
        on_ground_link = link is self.ground
        recorder = () if on_ground_link and target == TO_ALL else self.record
        endpoints = [] if on_ground_link else [*self.clients.values(), *self.tools.values()]
        endpoints += stations if on_ground_link or self.ground is None else ()
        places = [e.place for e in endpoints if target == TO_ALL or e.serves(target)]
        return (*recorder, *places)


@dataclass(kw_only=True)
class Counts:
    """Counts of the frames and bytes that the router has received, sent and dropped since its start.

    A frame that is sent to n receivers counts n times. The copies of frames to vehicles, which the recorder receives, count
    only in `bytes_out`.

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
