"""Core of the router: determines the receivers of each datagram, from the table of clients and from the
MAVLink target of the message. It opens no sockets and reads no clocks.

Routes:
    vehicle, message to all     its clients, tools and logger, and all ground stations
    vehicle, message to one     the endpoints that this system and component sends from, and the logger
    client or tool -> vehicle   its own vehicle, for messages to that vehicle or to all
    ground station -> vehicle   the vehicle that the message names, or all
A message is never returned to its sender. TIMESYNC replies are never sent to a vehicle, because they would
shift the time stamps of its poses. Frames that are not forwarded are counted by reason in `counts.dropped`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

from arena.mavlink_router.routing_table import Table, Vehicle
from arena.mavlink_router.vehicle_status import Fact, VehicleStatus
from arena.mavlink_router.vehicle_telemetry import (
    LOCAL_POSITION_NED,
    STATUSTEXT,
    SYS_STATUS,
    VehicleTelemetry,
)
from arena.transport import Address
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, parse_frames
from arena.wire.mavlink_minimal import EXTENDED_SYS_STATE, HEARTBEAT

TOOL_TIMEOUT_S = 10.0  # a tool's address is removed this long after its last frame
MAX_TOOLS = 16  # per vehicle: one more removes the tool that has been silent for longest
MAX_SENDERS = 32  # (system, component) pairs that are remembered per endpoint
MAX_ROUTES = 256  # cached routes per vehicle
GCS_TIMEOUT_S = 3.0
MAX_DATAGRAM_BYTES = 1472  # adjoining frames leave as one datagram that fits an Ethernet frame

_TIMESYNC = 111
_ANY_ADDRESS = ("0.0.0.0", 0)
_STATUS = (HEARTBEAT, EXTENDED_SYS_STATE)
_TELEMETRY = (LOCAL_POSITION_NED, SYS_STATUS, STATUSTEXT)
_TO_ALL = 0
_TO_NONE = -1


Destinations = tuple[tuple[int, Address], ...]
"""(index in `Router.sockets` to send from, address to send to) of each receiver."""
Out = tuple[Buffer, Destinations]
"""A datagram to send, which is a part of the received datagram, and its receivers."""
Handler = Callable[[Address, Buffer, float], list[Out]]


@dataclass(kw_only=True)
class Endpoint:
    """A receiver of messages (client, tool or ground station): its address, and the MAVLink senders that use
    this address.

    socket: index in `Router.sockets`
    senders: system << 8 | component of every sender that has used this address, oldest first
    last: time of the last frame, monotonic [s]
    """

    socket: int
    address: Address
    senders: dict[int, None] = field(default_factory=dict)
    last: float = 0.0

    def serves(self, target: int) -> bool:
        """Return whether this client must receive a message to `target`.

        target: system << 8 | component; component 0 means every component of the system
        """
        if target in self.senders:
            return True
        return not target & 0xFF and any(sender >> 8 == target >> 8 for sender in self.senders)


@dataclass(kw_only=True)
class VehicleRoutes:
    """Data that the router keeps about one vehicle: its sockets, status, clients and cached routes.

    serve_socket, tool_socket: indices in `Router.sockets`
    up: the autopilot's end of the router link
    tools: clients that have sent to the tool socket
    routes: target -> receivers; cleared whenever an endpoint changes
    """

    vehicle: Vehicle
    status: VehicleStatus
    telemetry: VehicleTelemetry = field(default_factory=VehicleTelemetry)
    serve_socket: int = 0
    tool_socket: int = 0
    up: Destinations = ()
    clients: dict[Address, Endpoint] = field(default_factory=dict)
    tools: dict[Address, Endpoint] = field(default_factory=dict)
    routes: dict[int, Destinations] = field(default_factory=dict)


@dataclass(kw_only=True)
class Counts:
    """Number of frames and bytes since the start. A frame that is sent to n receivers counts n times."""

    frames_from_vehicles: int = 0
    frames_from_clients: int = 0
    frames_to_vehicles: int = 0
    frames_to_clients: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    unknown: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


class Router:
    """Routes datagrams between vehicles, clients and ground stations.

    Pass received datagrams to `on_datagram`, and send the datagrams that it returns. Call `tick` a few times
    a second.
    sockets: the addresses to bind, in the order of their indices
    """

    def __init__(self, table: Table) -> None:
        self.table, self.counts = table, Counts()
        self.sockets: list[Address] = []
        self._handlers: list[Handler] = []
        self._gcs = self._serve(table.gcs_local, self._from_gcs, table.gcs)
        self._gcs_received_at = float("-inf")
        self._changed_facts: dict[str, Fact] = {}
        self._vehicles = [self._open(vehicle) for vehicle in table.vehicles]
        self._ids = frozenset(v.vehicle.id for v in self._vehicles)
        self._up_routes = {v.vehicle.id: v.up for v in self._vehicles}
        self._up_routes[_TO_ALL] = tuple(address for v in self._vehicles for address in v.up)

    @property
    def links(self) -> dict[str, int]:
        """Return vehicle name -> index in `sockets` of the socket for the link to this vehicle's autopilot."""
        return {v.vehicle.name: v.up[0][0] for v in self._vehicles}

    def on_datagram(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        """Route a received datagram. Return the datagrams to send.

        socket: index in `sockets` of the socket that received the datagram
        data: the returned datagrams are slices of this buffer
        now: monotonic [s]
        """
        self.counts.bytes_in += len(data)
        return self._handlers[socket](sender, memoryview(data), now)

    def tick(self, now: float) -> None:
        """Remove programs that have sent nothing to a tools port for `TOOL_TIMEOUT_S`, and mark vehicles
        without heartbeat as not connected. now: monotonic [s].
        """
        for v in self._vehicles:
            v.status.tick(now)
            silent = [address for address, tool in v.tools.items() if now - tool.last > TOOL_TIMEOUT_S]
            for address in silent:
                del v.tools[address]
                v.routes.clear()

    def heartbeat(self, frame: bytes) -> list[Out]:
        """Return the datagrams that send the heartbeat `frame` to every vehicle."""
        return [(frame, self._up_routes[_TO_ALL])]

    def changed_facts(self) -> dict[str, Fact]:
        """Return the values of the vehicles' status (connected, armed, mode, ...) that have changed since the
        last call, such as {"uav1.armed": True}.
        """
        if not self._changed_facts:
            return {}
        found = dict(self._changed_facts)
        self._changed_facts.clear()
        return found

    def warnings(self) -> list[str]:
        """Return the warnings that autopilots have sent since the last call, such as `uav1: Failsafe
        activated: ...`.
        """
        found = [f"{v.vehicle.name}: {text}" for v in self._vehicles for text in v.telemetry.texts]
        for v in self._vehicles if found else ():
            v.telemetry.texts.clear()
        return found

    def telemetry(self) -> dict[str, dict[str, float | None]]:
        """Return {vehicle: {"height_m": ..., "battery": ...}}: height above the floor [m] and remaining
        charge [%]. A value is None if it is unknown.
        """
        return {
            v.vehicle.name: {
                "height_m": None if v.telemetry.height_m is None else round(v.telemetry.height_m, 2),
                "battery": v.telemetry.battery,
            }
            for v in self._vehicles
        }

    def any_armed(self, *, simulated: bool) -> bool:
        """Return whether a vehicle is armed. Only simulated vehicles count if `simulated` is true, else only
        real vehicles.
        """
        return any(v.status.armed for v in self._vehicles if v.vehicle.simulated == simulated)

    @property
    def all_connected(self) -> bool:
        """True when every simulated vehicle has sent a heartbeat. Real vehicles are not included, because
        they may be switched on later.
        """
        return not self.missing

    @property
    def missing(self) -> list[str]:
        """Names of the simulated vehicles that have never sent a heartbeat."""
        return [v.vehicle.name for v in self._vehicles if v.vehicle.simulated and not v.status.ever_connected]

    def gcs_alive(self, now: float) -> bool:
        """Return whether a ground station has sent a frame within `GCS_TIMEOUT_S`."""
        return now - self._gcs_received_at <= GCS_TIMEOUT_S

    def _open(self, vehicle: Vehicle) -> VehicleRoutes:
        v = VehicleRoutes(
            vehicle=vehicle, status=VehicleStatus(name=vehicle.name, changed=self._changed_facts)
        )
        v.up = ((self._add(vehicle.local, partial(self._from_vehicle, v)), vehicle.remote),)
        v.tool_socket = self._add(vehicle.tools, partial(self._from_tool, v))
        v.serve_socket = len(self.sockets)
        v.clients = self._serve(vehicle.serve, partial(self._from_client, v), vehicle.clients)
        return v

    def _serve(self, local: Address, handler: Handler, clients: Iterable[Address]) -> dict[Address, Endpoint]:
        """Add the socket that exchanges messages with `clients`, and a second socket if some clients are on
        other computers. Return the endpoint of each client.

        A socket that is bound to loopback cannot send to other computers.
        """
        near = self._add(local, handler)
        far = {c for c in clients if _is_loopback(local) and not _is_loopback(c)}
        wide = self._add(_ANY_ADDRESS, handler) if far else near
        return {c: Endpoint(socket=wide if c in far else near, address=c) for c in clients}

    def _add(self, local: Address, handler: Handler) -> int:
        self.sockets.append(local)
        self._handlers.append(handler)
        return len(self.sockets) - 1

    # vehicle -> clients

    def _from_vehicle(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        if sender != v.vehicle.remote:
            return self._drop("unknown sender on a vehicle's link")
        frames = self._parse(data)
        self.counts.frames_from_vehicles += len(frames)
        out: list[Out] = []
        for target, start, end, count in _runs(frames, [self._target_of(v, data, f, now) for f in frames]):
            destinations = v.routes.get(target) or self._find_route(v, target)
            if destinations:
                self.counts.frames_to_clients += count * len(destinations)
                out.append((data[start:end], destinations))
            else:
                self.counts.dropped["no receiver"] += count
        return out

    def _target_of(self, v: VehicleRoutes, data: Buffer, frame: Frame, now: float) -> int:
        """Return the MAVLink target of a frame from a vehicle, as system << 8 | component. Also read the
        vehicle's status and telemetry from the frame.
        """
        _, _, _, _, sysid, compid, msgid, target_sys, target_comp = frame
        if sysid != v.vehicle.id:
            self.counts.dropped["foreign system on a vehicle's link"] += 1
            return _TO_NONE
        if msgid in _STATUS and compid == AUTOPILOT:
            v.status.on_frame(data, frame, now)
        elif msgid in _TELEMETRY and compid == AUTOPILOT:
            v.telemetry.on_frame(data, frame, now)
        return target_sys << 8 | target_comp if target_sys else _TO_ALL

    def _find_route(self, v: VehicleRoutes, target: int) -> Destinations:
        if len(v.routes) >= MAX_ROUTES:
            v.routes.clear()
        found = v.routes[target] = tuple(self._receivers(v, target))
        return found

    def _receivers(self, v: VehicleRoutes, target: int) -> Iterable[tuple[int, Address]]:
        if v.vehicle.logger is not None:
            yield v.serve_socket, v.vehicle.logger
        for endpoints in (v.clients, v.tools, self._gcs):
            for endpoint in endpoints.values():
                if target == _TO_ALL or endpoint.serves(target):
                    yield endpoint.socket, endpoint.address

    # clients -> vehicle

    def _from_client(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = v.clients.get(sender)
        if endpoint is None:
            return self._drop("unknown sender on a client socket")
        return self._up(v, endpoint, self._parse(data), data)

    def _from_tool(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        if not (_is_loopback(sender) or sender[0] == v.vehicle.tools[0]):
            return self._drop("tool on another computer")
        frames = self._parse(data)
        if not frames:
            return []
        endpoint = v.tools.pop(sender, None)
        if endpoint is None:
            endpoint = Endpoint(socket=v.tool_socket, address=sender)
            v.routes.clear()
            if len(v.tools) >= MAX_TOOLS:
                del v.tools[next(iter(v.tools))]
        v.tools[sender] = endpoint
        endpoint.last = now
        return self._up(v, endpoint, frames, data)

    def _from_gcs(self, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = self._gcs.get(sender)
        if endpoint is None:
            return self._drop("unknown sender on the ground stations' socket")
        frames = self._parse(data)
        if frames:
            self._gcs_received_at = now
        return self._up(None, endpoint, frames, data)

    def _up(
        self, v: VehicleRoutes | None, endpoint: Endpoint, frames: list[Frame], data: Buffer
    ) -> list[Out]:
        """Return the datagrams that forward a client's frames to vehicles.

        v: the only vehicle that the client may command; None for ground stations.
        """
        self.counts.frames_from_clients += len(frames)
        out: list[Out] = []
        for target, start, end, count in _runs(
            frames, [self._vehicle_of(v, endpoint, data, f) for f in frames]
        ):
            destinations = self._up_routes[target]
            self.counts.frames_to_vehicles += count * len(destinations)
            out.append((data[start:end], destinations))
        return out

    def _vehicle_of(self, v: VehicleRoutes | None, endpoint: Endpoint, data: Buffer, frame: Frame) -> int:
        """Return the system id of the vehicle to which a client's frame must be sent."""
        _, _, payload, size, sysid, compid, msgid, target, _ = frame
        if compid == AUTOPILOT and sysid in self._ids:
            self.counts.dropped["a vehicle's message, returned by a client"] += 1
            return _TO_NONE
        if (sender := sysid << 8 | compid) not in endpoint.senders:
            self._add_sender(v, endpoint, sender)
        if msgid == _TIMESYNC and any(data[payload : payload + min(8, size)]):
            self.counts.dropped["TIMESYNC reply"] += 1
            return _TO_NONE
        if v is not None and (target in (0, v.vehicle.id)):
            return v.vehicle.id
        if v is None and (target == 0 or target in self._ids):
            return target
        self.counts.dropped["target is not a vehicle of this client"] += 1
        return _TO_NONE

    def _add_sender(self, v: VehicleRoutes | None, endpoint: Endpoint, sender: int) -> None:
        if len(endpoint.senders) >= MAX_SENDERS:
            del endpoint.senders[next(iter(endpoint.senders))]
        endpoint.senders[sender] = None
        for changed in self._vehicles if v is None else (v,):
            changed.routes.clear()

    # both directions

    def _parse(self, data: Buffer) -> list[Frame]:
        frames, garbage, bad_crc, unknown = parse_frames(data)
        if garbage or unknown:
            self.counts.unknown += unknown
            self.counts.dropped["garbage bytes"] += garbage
            self.counts.dropped["wrong CRC"] += bad_crc
        return frames

    def _drop(self, why: str) -> list[Out]:
        self.counts.dropped[why] += 1
        return []


def _is_loopback(address: Address) -> bool:
    return address[0].startswith("127.")


def _runs(frames: list[Frame], targets: list[int]) -> list[tuple[int, int, int, int]]:
    """Join adjacent frames with the same target, so that they are sent as one datagram. Return a list of
    (target, first byte, end byte, number of frames). Frames with target `_TO_NONE` are omitted.
    """
    if len(frames) == 1:
        return [(targets[0], frames[0][0], frames[0][1], 1)] if targets[0] != _TO_NONE else []
    runs: list[tuple[int, int, int, int]] = []
    target, start, end, count = _TO_NONE, 0, 0, 0
    for frame, own in zip(frames, targets, strict=True):
        if own == target and frame.start == end and frame.end - start <= MAX_DATAGRAM_BYTES:
            end, count = frame.end, count + 1
            continue
        if target != _TO_NONE:
            runs.append((target, start, end, count))
        target, start, end, count = own, frame.start, frame.end, 1
    if target != _TO_NONE:
        runs.append((target, start, end, count))
    return runs
