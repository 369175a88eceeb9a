"""MAVLink router of the fused arena, in which all parts of a simulated arena run in one process.

Built-in autopilots and the recorder are in the same process. PX4 and other clients use sockets.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

from arena.closed_ports import ClosedPorts
from arena.datagrams import read_datagrams
from arena.fault_injection import FaultReceiver
from arena.fused.memory_links import Inbox, RecorderLink, address
from arena.kernels.held_telemetry import HeldTelemetry, ProgramPlace
from arena.kernels.ordinary_datagrams import address_number
from arena.kernels.telemetry_delivery import TelemetryDelivery, TelemetryPath
from arena.mavlink_router.datagrams import MAX_DATAGRAM_BYTES
from arena.mavlink_router.endpoints import Destinations, Out
from arena.mavlink_router.ground_station import GroundStation
from arena.mavlink_router.link_impairment import ImpairedRouter
from arena.mavlink_router.reports import report_changes, report_ready
from arena.mavlink_router.router import Router
from arena.mavlink_router.routing_table import Table
from arena.process_context import ProcessContext
from arena.transport import Address, listen_udp
from arena.wire.mavlink_frame import Buffer

Place = tuple[int, Address]
"""(index of the router's socket that sends, address of the receiver)."""
_TICK_S, _SECOND_S = 0.25, 1.0
_MAX_DATAGRAMS = 2000  # read from one socket in one step: a flood must not stop the world
_MAX_PATHS = 1024  # sets of receivers that are kept


class _Paths(NamedTuple):
    """Ways to the receivers of a datagram.

    destinations: all receivers. While the tuple is kept here, no other object has its `id`.
    closed: the closed ports for which this was computed.
    links: (index of the vehicle, name of the link) of built-in autopilots.  records: sockets from which the recorder gets a copy.
    places: (socket, address) of each other receiver with an open port, and its `ProgramPlace`; None if it is not a program that sleeps.
    """

    destinations: Destinations
    closed: frozenset[Address]
    links: list[tuple[int, str]]
    records: list[int]
    places: list[tuple[Place, ProgramPlace | None]]


class FusedRouter:
    """MAVLink router that exchanges datagrams with built-in autopilots in memory, without sockets.

    All times are simulation time [s], except that of silent tools.

    in_memory: indices, in the world, of the vehicles with such links. The links of the other vehicles are sockets.
    inbox: receives the datagrams for the built-in autopilots.
    sockets: addresses of the router's sockets, in their order.
    closed: SDK ports and ground stations at whose ports no program listens; nothing is sent to them.
    held: telemetry for programs that sleep. Without `hold_for_sleepers` nothing is held.
    faults: socket of the injected faults.
    """

    def __init__(
        self,
        process: ProcessContext,
        now: Callable[[], float],
        in_memory: Collection[int],
        inbox: Inbox,
    ) -> None:
        self._process, self._inbox = process, inbox
        table = Table.from_slice(process.settings)
        self._router = Router(table, now, real_now=time.monotonic)
        self._counts = self._router.counts
        self.sockets = self._router.sockets
        self._recorder = table.recorder
        self._record_link: RecorderLink | None = None
        self._on_copy: Callable[[int, bytes], None] | None = None
        self._impaired = ImpairedRouter(self._router, int(process.settings["seed"]))
        self.faults = FaultReceiver(process.settings.get("faults"))
        self._station = GroundStation()
        links, ground = self._router.links, self._router.ground_links
        self._ends = {(i, "router"): (links[v.name], v.remote) for i, v in enumerate(table.vehicles)}
        self._ends |= {
            (i, "ground"): (ground[v.name], v.ground.remote)
            for i, v in enumerate(table.vehicles)
            if v.ground is not None
        }
        self._sensor_keys, self._sensors = self._router.sensor_sockets, table.sensors
        self._in_calls = frozenset(self._sensor_keys.values())
        self._link_of = {key: link for link, (key, _) in self._ends.items() if link[0] in in_memory}
        self._sockets = {
            key: listen_udp(at, "the router")
            for key, at in enumerate(self._router.sockets)
            if key not in self._link_of and key not in self._in_calls
        }
        self._paths: dict[int, _Paths] = {}  # id of `destinations` -> the ways to them
        self._key_of = {s.fileno(): key for key, s in self._sockets.items()}
        self._poll = select.epoll()
        for fd in self._key_of:
            self._poll.register(fd, select.EPOLLIN)
        self._next_tick = self._next_second = 0.0
        self._began, self._ready = time.monotonic(), False
        self.held = HeldTelemetry({}, (), self._send_to_socket, MAX_DATAGRAM_BYTES)
        self._delivery: TelemetryDelivery | None = None
        self.closed = ClosedPorts((*table.gcs, *self._clients("sdk").values()))

    def hold_for_sleepers(self, programs: Mapping[str, str], asleep: Collection[str]) -> None:
        """Join the telemetry for programs while they sleep on the simulation clock.

        Call `held.before_wake` before each wake-up.
        programs: vehicle name -> name of its program as a client of the clock.  asleep: names of the clients that sleep now
        """
        serve = {v.name: self.sockets.index(v.serve) for v in self._router.table.vehicles}
        ports = self._clients("program")
        named = {(serve[v], ports[v]): client for v, client in programs.items() if v in ports}
        self.held = HeldTelemetry(named, asleep, self._send_to_socket, MAX_DATAGRAM_BYTES)
        self._paths.clear()
        self._open_delivery()

    def record_in(self, link: RecorderLink, on_copy: Callable[[int, bytes], None] | None = None) -> None:
        """Send copies of all routed datagrams to the recorder.

        on_copy: function that also gets each copy, with the index of the socket from which it is sent. With it, telemetry is not
            delivered in compiled code.
        """
        self._record_link, self._on_copy = link, on_copy
        self._open_delivery()

    def _open_delivery(self) -> None:
        """Make the compiled delivery of telemetry, when the recorder and the held telemetry are known."""
        link = self._record_link
        if not self._router.use_shortcut or link is None or self._on_copy is not None:
            return
        vehicles = range(len(self._router.table.vehicles))
        self._delivery = TelemetryDelivery(
            self._router.shortcut.ordinary,
            {name: [self._autopilot_end(i, name) for i in vehicles] for name in ("router", "ground")},
            self.held,
            link.copies,
            self._telemetry_path,
        )

    def _autopilot_end(self, vehicle: int, link: str) -> tuple[int, int]:
        """Return (socket of a link, number of its autopilot's address); (-1, -1) if the autopilot is not in this process."""
        socket, remote = self._ends.get((vehicle, link), (-1, ("", 0)))
        return (socket, address_number(*remote)) if socket in self._link_of else (-1, -1)

    def _clients(self, name: str) -> dict[str, Address]:
        """Return {vehicle name: address of its client with this name}, such as `program`."""
        vehicles = self._process.settings["vehicles"]
        found = ((v["name"], client) for v in vehicles for client in v["clients"])
        return {vehicle: address(client, "address") for vehicle, client in found if client["name"] == name}

    def deliver(self, messages: list[tuple[int, str, bytes]], begin: int, now: float) -> int:
        """Deliver the ordinary telemetry of the autopilots in this process, in compiled code.

        Return the index of the first message that the caller must route, or `len(messages)`. After routing it, the caller calls again.
        messages: (vehicle, name of the link, datagram) of each.  begin: index of the first message to deliver.
        """
        if self._delivery is None or self._impaired.active:
            return begin
        return self._delivery.deliver(messages, begin, self.closed.now, now)

    def from_vehicle(self, vehicle: int, data: bytes, now: float, link: str = "router") -> None:
        """Route a datagram that an autopilot in this process has sent.

        vehicle: index in the world. link: `router` or `ground`
        """
        if end := self._ends.get((vehicle, link)):
            self._route(*end, data, now)

    def from_sensors(self, vehicle: str, data: bytes, now: float) -> None:
        """Route a datagram with measurements of a vehicle's emulated sensors.

        vehicle: name of the vehicle.
        """
        assert self._sensors is not None  # a vehicle has sensors
        self._route(self._sensor_keys[vehicle], self._sensors, data, now)

    def drain(self, now: float) -> None:
        """Read and route all datagrams that wait in the router's sockets.

        The order of the sockets is fixed.
        """
        if ready := self._poll.poll(0):
            for key in sorted(self._key_of[fd] for fd, _ in ready):
                self._read(key, now)

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a datagram has arrived for the router."""
        return self._poll.fileno()

    def step(self, now: float, *, faults: bool = True) -> None:
        """Do the periodic work of the router, such as heartbeats. Call this once per simulation step.

        Apply injected faults, send delayed datagrams and heartbeats, and report warnings and events to the supervisor.
        faults: read the socket of the injected faults.
        """
        for text in self.faults.apply(self._impaired.apply) if faults else ():
            self._process.event(text)
        if self._impaired.active:
            self._send(self._impaired.release(now, now), now, join=False)
        self.held.step(now)
        report_changes(self._process, self._router)
        if now >= self._next_tick:
            self._next_tick = now + _TICK_S
            self._tick(now)

    def on_request(self, request: Mapping[str, Any], now: float) -> None:
        """Process a request of the supervisor, such as `release`, after which programs may command a vehicle again."""
        self._router.commands.on_request(request, now)

    def stats(self) -> dict[str, Any]:
        found = self._router.stats()
        if self._delivery is not None:
            found["bytes_out"] += self._delivery.bytes_out
        return found

    def close(self) -> None:
        self.held.close()
        self._poll.close()
        self.faults.close()
        for s in self._sockets.values():
            s.close()

    def _read(self, key: int, now: float) -> None:
        for data, sender in read_datagrams(self._sockets[key], _MAX_DATAGRAMS):
            if sender in self.closed.now:  # it has just been opened, and waits for replies
                self.closed.search()
            self._route(key, sender, data, now)

    def _route(self, key: int, sender: Address, data: Buffer, now: float) -> None:
        if self._impaired.active:
            self._send(self._impaired.on_datagram(key, sender, data, now, now), now, join=False)
        else:
            # A program reads measurements from datagrams of their own, so they are not joined with telemetry.
            self._send(self._router.on_datagram(key, sender, data, now), now, join=key not in self._in_calls)

    def _send(self, out: list[Out], now: float, *, join: bool = True) -> None:
        for data, destinations in out:
            paths = self._paths.get(id(destinations))
            if paths is None or paths.closed is not self.closed.now:
                paths = self._find_paths(destinations)
            self._counts.bytes_out += len(data) * len(destinations)
            if paths.links or paths.records:
                copy = bytes(data)
                for vehicle, link in paths.links:
                    self._inbox.append((vehicle, link, copy))
                for key in paths.records:
                    self._record(key, copy)
            for place, program in paths.places:
                if program is None or not self.held.hold(program, data, now, join):
                    self._send_to_socket(place[0], data, place[1])

    def _record(self, key: int, data: bytes) -> None:
        if self._record_link is not None:
            self._record_link.add(key, data)
        if self._on_copy is not None:
            self._on_copy(key, data)

    def _find_paths(self, destinations: Destinations) -> _Paths:
        """Sort the receivers of a datagram by the way to them, and keep the result. Receivers with a closed port are left out."""
        if len(self._paths) >= _MAX_PATHS:
            self._paths.clear()
        closed, links, records, places = self.closed.now, [], [], []
        for key, to in destinations:
            if (link := self._link_of.get(key)) is not None:
                links.append(link)
            elif to == self._recorder:
                records.append(key)
            elif to not in closed:
                places.append(((key, to), self.held.place(key, to)))
        found = self._paths[id(destinations)] = _Paths(destinations, closed, links, records, places)
        return found

    def _telemetry_path(self, destinations: Destinations) -> TelemetryPath:
        """Return the receivers of telemetry in the form that the compiled delivery needs."""
        paths = self._find_paths(destinations)
        owners = [self._record_link.owner(key) for key in paths.records] if self._record_link else []
        vehicle = next((owner[0] for owner in owners if owner is not None), None)
        return TelemetryPath(destinations, paths.closed, vehicle, paths.places)

    def _send_to_socket(self, key: int, data: Buffer, to: Address) -> None:
        try:
            self._sockets[key].sendto(data, to)
        except OSError:  # full queue or no network: the next message is newer
            self._counts.dropped["not sent"] += 1

    def _tick(self, now: float) -> None:
        self.closed.refresh(time.monotonic())
        self._router.tick(now)
        self._process.audit(self._router.commands.take_audit())
        if not self._ready:  # in wall time, so that the other vehicles start even if a PX4 never does
            self._ready = report_ready(self._process, self._router, time.monotonic() - self._began)
        if now >= self._next_second:
            self._next_second = now + _SECOND_S
            if self._router.table.heartbeat and not self._impaired.muted:
                frame = self._station.heartbeat()
                self._send(self._impaired.outgoing(self._router.heartbeat(frame), now), now)
            self._process.stats(self.stats())
