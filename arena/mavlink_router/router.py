"""Core of the router: finds the receivers of each MAVLink datagram, without sockets and clocks.

Routes:
    vehicle, message to all     its clients, tools and recorder
    sensors of a vehicle        its clients, tools and recorder
    vehicle, message to one     the endpoints that this system and component sends from, and the recorder
    client or tool -> vehicle   its own vehicle, for messages to that vehicle or to all
    ground station -> vehicle   the vehicle that the message names, or all
    vehicle -> ground station   all that the vehicle sends on its ground station link; without such a link, all messages
Both links of a vehicle are under the same authority. The recorder also receives all that is sent to a vehicle. A command of a sender
that must not command the vehicle now is not forwarded (`arena.authority`). A message is never returned to its sender. TIMESYNC replies
are never sent to a vehicle, because they would shift the time stamps of its poses. Frames that are not forwarded are counted by reason
in `counts.dropped`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from arena.authority import MESSAGES, Role
from arena.kernels import INTERPRETED
from arena.kernels.ordinary_datagrams import MAX_SENDERS, OrdinaryDatagrams
from arena.mavlink_router.command_filter import CommandFilter
from arena.mavlink_router.datagrams import NO_TARGET, join_frames
from arena.mavlink_router.endpoints import (
    TO_ALL,
    AutopilotLink,
    Counts,
    Destinations,
    Endpoint,
    Out,
    VehicleRoutes,
)
from arena.mavlink_router.routing_table import Link, Table, Vehicle
from arena.mavlink_router.shortcut import Shortcut
from arena.mavlink_router.socket_table import SocketTable
from arena.mavlink_router.vehicle_sets import VehicleSets
from arena.mavlink_router.vehicle_status import Fact, VehicleStatus
from arena.mavlink_router.vehicle_telemetry import LOCAL_POSITION_NED, STATUSTEXT, SYS_STATUS
from arena.transport import Address, is_loopback
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, parse_frames
from arena.wire.mavlink_ids import SENSORS_COMPONENT as SENSORS
from arena.wire.mavlink_minimal import EXTENDED_SYS_STATE, HEARTBEAT, TIMESYNC
from arena.wire.relative_measurements import DEBUG_FLOAT_ARRAY

TOOL_TIMEOUT_S = 10.0  # a tool's address is removed this long after its last frame, in real time
MAX_ROUTES = 256  # cached routes per vehicle
GCS_TIMEOUT_S = 3.0

_STATUS = (HEARTBEAT, EXTENDED_SYS_STATE)
_TELEMETRY = (LOCAL_POSITION_NED, SYS_STATUS, STATUSTEXT)
_REFUSED = "refused: another has control of the vehicle"


class Router:
    """Router of MAVLink datagrams between vehicles, clients and ground stations, without sockets.

    Pass received datagrams to `on_datagram`, and send the datagrams that it returns. Call `tick` a few times
    a second.
    commands: decides which commands of clients reach the vehicles
    sim_now: returns the simulation time [s]; None without a simulated world
    real_now: returns the real time [s], by which tools send heartbeats; None if the methods get real time, not simulation time
    shortcut: finds the receivers of ordinary datagrams (telemetry to all clients, setpoints, ...) in compiled code
    use_shortcut: whether to use the shortcut; without it the receivers are the same. Default: only if the kernels are compiled,
        because their Python source is slower than the methods of this class
    kernel: class of the shortcut's kernel
    may_have_news: warnings or changed facts may be waiting; the reader sets it to False. Datagrams on the shortcut cause none
    """

    def __init__(
        self,
        table: Table,
        sim_now: Callable[[], float] | None = None,
        *,
        real_now: Callable[[], float] | None = None,
        use_shortcut: bool = INTERPRETED is None,
        kernel: type[OrdinaryDatagrams] = OrdinaryDatagrams,
    ) -> None:
        self.table, self._counts = table, Counts()
        self._real: Callable[[float], float] = (lambda now: now) if real_now is None else lambda _: real_now()
        self.use_shortcut = use_shortcut
        self.commands = CommandFilter(table.vehicles, sim_now)
        self._socket_table = SocketTable()
        self._gcs = self._socket_table.serve(table.gcs_local, self._from_gcs, table.gcs, Role.GROUND_STATION)
        self._gcs_received_at = float("-inf")
        self._changed_facts: dict[str, Fact] = {}
        self.may_have_news = True
        self._vehicles = [self._open(i, vehicle) for i, vehicle in enumerate(table.vehicles)]
        self._ids = frozenset(v.vehicle.id for v in self._vehicles)
        self._sets = VehicleSets(self._vehicles)
        self.shortcut = Shortcut(kernel, self._vehicles, self.commands.setpoint_test)

    @property
    def sockets(self) -> list[Address]:
        """Addresses of the sockets that the caller must open, in the order of their indices."""
        return self._socket_table.addresses

    @property
    def counts(self) -> Counts:
        """Numbers of frames and bytes since the start. The property always returns the same object."""
        self.shortcut.collect(self._counts)
        return self._counts

    @property
    def sensor_sockets(self) -> dict[str, int]:
        """{vehicle name: index in `sockets` of the socket that receives emulated sensor measurements}."""
        return {v.vehicle.name: v.sensor_socket for v in self._vehicles if v.sensor_socket is not None}

    @property
    def links(self) -> dict[str, int]:
        """Router link of each vehicle: {vehicle name: index in `sockets` of the socket for messages of its autopilot}."""
        return {v.vehicle.name: v.main.socket for v in self._vehicles}

    @property
    def ground_links(self) -> dict[str, int]:
        """{vehicle name: index in `sockets` of its ground station link}, for vehicles that have this link."""
        return {v.vehicle.name: v.ground.socket for v in self._vehicles if v.ground is not None}

    def on_datagram(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        """Route a received datagram. Return the datagrams to send.

        socket: index in `sockets` of the socket that received the datagram
        data: the returned datagrams are slices of this buffer
        now: monotonic [s]
        """
        if self.use_shortcut and (out := self.shortcut.route(socket, sender, data, now)) is not None:
            return out
        return self.on_other_datagram(socket, sender, data, now)

    def on_other_datagram(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        """Route a datagram in Python. Needed if the compiled shortcut cannot route the datagram, such as a command."""
        self._counts.bytes_in += len(data)
        self.may_have_news = True
        return self._socket_table.handlers[socket](sender, memoryview(data), now)

    def tick(self, now: float) -> None:
        """Remove tools (such as viewers) that have stopped sending, and mark silent vehicles as not connected.

        A tool is any program on this computer that sends to the `tools` address of a vehicle. now: monotonic [s].
        """
        self.may_have_news = True
        for v in self._vehicles:
            v.status.tick(now)
            if v.remove_tools(self._real(now) - TOOL_TIMEOUT_S):
                self._forget_routes(v)

    def heartbeat(self, frame: bytes, *, operator: bool = True) -> list[Out]:
        """Return the heartbeat `frame` with the addresses to which the router must send it: vehicles and recorder.

        After a ground station was received, the frame is also sent on the ground station links: autopilots send STATUSTEXT only on
        links with heartbeats of a ground station, whose own heartbeats are too rare when a simulation is fast.
        operator: an operator is present. Without one, vehicles that need it for this heartbeat receive none.
        """
        served = [v for v in self._vehicles if operator or not v.vehicle.needs_operator]
        places = tuple(place for v in served for place in v.up_and_record)
        if self._gcs_received_at > float("-inf"):
            places += tuple(place for v in served if v.ground is not None for place in v.ground.up)
        return [(frame, places)] if places else []

    def changed_facts(self) -> dict[str, Fact]:
        """Return the facts (status values) that have changed since the last call, as {"uav1.armed": True}."""
        if not self._changed_facts:
            return {}
        found = dict(self._changed_facts)
        self._changed_facts.clear()
        return found

    def warnings(self) -> list[str]:
        """Return the new warnings of autopilots since the last call, such as `uav1: Failsafe activated: ...`."""
        found = [f"{v.vehicle.name}: {text}" for v in self._vehicles for text in v.telemetry.texts]
        for v in self._vehicles if found else ():
            v.telemetry.texts.clear()
        return found

    def telemetry(self) -> dict[str, dict[str, float | None]]:
        """Return {vehicle: {"height_m": ..., "battery": ...}}: height above the floor [m], remaining charge [%]; None if unknown."""
        for v in self._vehicles:
            self.shortcut.collect_height(v)
        return {v.vehicle.name: v.telemetry.values() for v in self._vehicles}

    def stats(self) -> dict[str, Any]:
        """Return counts of frames and bytes, and the telemetry of the vehicles, for the statistics of the process."""
        dropped = {why: n for why, n in self._counts.dropped.items() if n}
        return {**vars(self.counts), "dropped": dropped, "telemetry": self.telemetry()}

    def armed(self, *, simulated: bool) -> list[str]:
        """Return the names of the armed vehicles: simulated ones if `simulated` is true, else real ones."""
        return [v.vehicle.name for v in self._vehicles if v.status.armed and v.vehicle.simulated == simulated]

    @property
    def all_connected(self) -> bool:
        """True if every simulated vehicle has sent a heartbeat. Real vehicles may be switched on later."""
        return not self.missing

    @property
    def missing(self) -> list[str]:
        """Names of the simulated vehicles that have never sent a heartbeat."""
        return [v.vehicle.name for v in self._vehicles if v.vehicle.simulated and not v.status.ever_connected]

    def gcs_alive(self, now: float) -> bool:
        """Return whether a ground station has sent a frame within `GCS_TIMEOUT_S`."""
        return now - self._gcs_received_at <= GCS_TIMEOUT_S

    def _open(self, number: int, vehicle: Vehicle) -> VehicleRoutes:
        status = VehicleStatus(name=vehicle.name, changed=self._changed_facts)
        v = VehicleRoutes(number=number, vehicle=vehicle, status=status)
        sockets, recorder = self._socket_table, self.table.recorder
        for place in (Link(local=vehicle.local, remote=vehicle.remote), vehicle.ground):
            if place is not None:
                link = AutopilotLink(remote=place.remote)
                link.socket = sockets.add(place.local, partial(self._from_vehicle, v, link))
                v.links.append(link)
        v.tool_socket = sockets.add(vehicle.tools, partial(self._from_tool, v))
        up_record = ((v.tool_socket, recorder),) if recorder is not None else ()
        v.up_and_record, v.ground_up_and_record = v.main.up + up_record, v.links[-1].up + up_record
        v.serve_socket = len(sockets.addresses)
        v.record = ((v.serve_socket, recorder),) if recorder is not None else ()
        v.clients = sockets.serve(vehicle.serve, partial(self._from_client, v), vehicle.clients)
        if vehicle.sensors is not None:
            v.sensor_socket = sockets.add(vehicle.sensors, partial(self._from_sensors, v))
        return v

    # vehicle -> clients

    def _from_vehicle(
        self, v: VehicleRoutes, link: AutopilotLink, sender: Address, data: Buffer, now: float
    ) -> list[Out]:
        if sender != link.remote:
            return self._drop("unknown sender on a vehicle's link")
        frames = self._parse(data)
        self._counts.frames_from_vehicles += len(frames)
        out: list[Out] = []
        for target, start, end, count in join_frames(
            frames, [self._target_of(v, link, data, f, now) for f in frames]
        ):
            destinations = link.routes.get(target) or self._find_route(v, link, target)
            if destinations:
                self._counts.frames_to_clients += count * len(destinations)
                out.append((data[start:end], destinations))
            else:
                self._counts.dropped["no receiver"] += count
        return out

    def _target_of(
        self, v: VehicleRoutes, link: AutopilotLink, data: Buffer, frame: Frame, now: float
    ) -> int:
        """Return the MAVLink target of a frame from a vehicle, as system << 8 | component.

        Also update the vehicle's status and telemetry if the frame contains them and has arrived on the router link.
        """
        _, _, _, _, sysid, compid, msgid, target_sys, target_comp = frame
        if sysid != v.vehicle.id:
            self._counts.dropped["foreign system on a vehicle's link"] += 1
            return NO_TARGET
        if link is v.main and compid == AUTOPILOT and msgid in _STATUS:
            v.status.on_frame(data, frame, now)
            self.shortcut.on_status(link, data, frame)
            if msgid == HEARTBEAT:
                self.commands.on_heartbeat(sysid, v.status.armed, v.status.mode, now)
        elif link is v.main and compid == AUTOPILOT and msgid in _TELEMETRY:
            # first, because the height of the shortcut is older than this frame
            self.shortcut.collect_height(v)
            v.telemetry.on_frame(data, frame, now)
            self.shortcut.on_status(link, data, frame)
        return target_sys << 8 | target_comp if target_sys else TO_ALL

    def _find_route(self, v: VehicleRoutes, link: AutopilotLink, target: int) -> Destinations:
        if len(link.routes) >= MAX_ROUTES:
            link.routes.clear()
        found = link.routes[target] = v.receivers(link, target, self._gcs.values())
        if target == TO_ALL:
            self.shortcut.set_receivers(link, found)
        return found

    def _from_sensors(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        """Return the datagrams that carry emulated sensor measurements to a vehicle's clients and tools.

        Ground stations receive none: a radio could not carry them. A datagram with another frame is dropped: it could look like telemetry.
        """
        if sender != self.table.sensors:
            return self._drop("unknown sender on the sensors' socket")
        frames = self._parse(data)
        wanted = (v.vehicle.id, SENSORS, DEBUG_FLOAT_ARRAY)
        if not frames or any((f.sysid, f.compid, f.msgid) != wanted for f in frames):
            return self._drop("not a measurement of the vehicle's sensors")
        found = v.sensor_receivers = v.sensor_receivers or v.receivers(v.main, TO_ALL, ())
        self._counts.frames_from_vehicles += len(frames)
        self._counts.frames_to_clients += len(frames) * len(found)
        return [(data, found)] if found else []

    # clients -> vehicle

    def _from_client(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = v.clients.get(sender)
        if endpoint is None:
            return self._drop("unknown sender on a client socket")
        return self._up(v, endpoint, self._parse(data), data, now)

    def _from_tool(self, v: VehicleRoutes, sender: Address, data: Buffer, now: float) -> list[Out]:
        if not (is_loopback(sender) or sender[0] == v.vehicle.tools[0]):
            return self._drop("tool on another computer")
        frames = self._parse(data)
        if not frames:
            return []
        endpoint, is_new = v.use_tool(sender, self._real(now))
        if is_new:
            self._forget_routes(v)
        return self._up(v, endpoint, frames, data, now)

    def _from_gcs(self, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = self._gcs.get(self.table.aliases.get(sender, sender))
        if endpoint is None:
            return self._drop("unknown sender on the ground stations' socket")
        frames = self._parse(data)
        if frames:
            self._gcs_received_at = now
        return self._up(None, endpoint, frames, data, now)

    def _up(
        self, v: VehicleRoutes | None, endpoint: Endpoint, frames: list[Frame], data: Buffer, now: float
    ) -> list[Out]:
        """Return the datagrams that forward a client's frames to vehicles, and replies to refused commands.

        v: the only vehicle that the client may command; None for ground stations.
        """
        self._counts.frames_from_clients += len(frames)
        out: list[Out] = []
        for target, start, end, count in join_frames(
            frames, [self._receivers_key(v, endpoint, data, f, now) for f in frames]
        ):
            destinations = self._sets.receivers(target, station=v is None)
            self._counts.frames_to_vehicles += count * len(destinations) // self._sets.copies
            out.append((data[start:end], destinations))
        return out + self.commands.take_replies()

    def _receivers_key(
        self, v: VehicleRoutes | None, endpoint: Endpoint, data: Buffer, frame: Frame, now: float
    ) -> int:
        """Find the vehicles that must receive a client's frame. Return the key of this set of vehicles in `VehicleSets`."""
        _, _, payload, size, sysid, compid, msgid, target, _ = frame
        if compid == AUTOPILOT and sysid in self._ids:
            self._counts.dropped["a vehicle's message, returned by a client"] += 1
            return NO_TARGET
        if (sender := sysid << 8 | compid) not in endpoint.senders:
            self._add_sender(v, endpoint, sender)
        if msgid == TIMESYNC and any(data[payload : payload + min(8, size)]):
            self._counts.dropped["TIMESYNC reply"] += 1
            return NO_TARGET
        if v is not None and msgid == HEARTBEAT and v.simulates_operator(endpoint, data, frame):
            self._counts.dropped["a program's heartbeat as a ground station"] += 1
            return NO_TARGET
        if v is not None and (target in (0, v.vehicle.id)):
            target = v.vehicle.id
        elif v is not None or (target and target not in self._ids):
            self._counts.dropped["target is not a vehicle of this client"] += 1
            return NO_TARGET
        return self._allowed_key(target, endpoint, data, frame, now) if msgid in MESSAGES else target

    def _allowed_key(self, target: int, endpoint: Endpoint, data: Buffer, frame: Frame, now: float) -> int:
        """Find the target vehicles that a client may command now. Return the key of this set in `VehicleSets`.

        target: system id of the command's target, 0 for all vehicles.
        """
        wanted = [target] if target else self._sets.ids
        found = [vehicle for vehicle in wanted if self.commands.allows(vehicle, endpoint, data, frame, now)]
        if found == wanted:
            return target
        self._counts.dropped[_REFUSED] += len(wanted) - len(found)
        return self._sets.key_of(found)

    def _add_sender(self, v: VehicleRoutes | None, endpoint: Endpoint, sender: int) -> None:
        if len(endpoint.senders) >= MAX_SENDERS:
            del endpoint.senders[next(iter(endpoint.senders))]
        endpoint.senders[sender] = None
        for changed in self._vehicles if v is None else (v,):
            self._forget_routes(changed)
        self.shortcut.set_senders(endpoint)

    def _forget_routes(self, v: VehicleRoutes) -> None:
        """Delete the stored receivers of the vehicle's messages, because a client or tool has changed."""
        v.sensor_receivers = ()
        for link in v.links:
            link.routes.clear()
            self.shortcut.set_receivers(link, ())

    # both directions

    def _parse(self, data: Buffer) -> list[Frame]:
        frames, garbage, bad_crc, unknown = parse_frames(data)
        if garbage or unknown:
            self._counts.unknown += unknown
            self._counts.dropped["garbage bytes"] += garbage
            self._counts.dropped["wrong CRC"] += bad_crc
        return frames

    def _drop(self, why: str) -> list[Out]:
        self._counts.dropped[why] += 1
        return []
