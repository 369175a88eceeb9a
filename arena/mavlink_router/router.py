"""The router's core: datagrams in, datagrams out, by table and target. No sockets, no clocks, no decoding.

What goes where:
    vehicle -> everybody      its clients, tools and logger, and all ground stations
    vehicle -> one target     where that system and component has been heard, and the logger
    client, tool -> vehicle   its own vehicle's link, when meant for it or for everybody
    ground station -> vehicle the vehicle it names, or all
Never back to the sender, and never TIMESYNC replies towards a vehicle: they would move the stamps of the poses.
What is not forwarded is counted by reason in `dropped`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

from arena.mavlink_router.routing_table import Address, Table, Vehicle
from arena.mavlink_router.vehicle_status import AUTOPILOT, EXTENDED_SYS_STATE, HEARTBEAT, Fact, Seen
from arena.mavlink_router.vehicle_telemetry import (
    LOCAL_POSITION_NED,
    STATUSTEXT,
    SYS_STATUS,
    VehicleTelemetry,
)
from arena.wire.mavlink_frame import Buffer, Frame, parse_frames

TOOL_LIFE_S = 10.0  # a tool is forgotten this long after its last frame
MAX_TOOLS = 16  # per vehicle: when one more speaks, the one silent for longest makes room
MAX_HEARD = 32  # speakers remembered per endpoint
MAX_ROUTES = 256  # cached ways per vehicle
GCS_ALIVE_S = 3.0
RUN_BYTES = 1472  # consecutive frames leave as one datagram up to what an Ethernet frame holds

_TIMESYNC = 111
_ANYWHERE = ("0.0.0.0", 0)
_PEEKED = (HEARTBEAT, EXTENDED_SYS_STATE)
_TELEMETRY = (LOCAL_POSITION_NED, SYS_STATUS, STATUSTEXT)
_EVERYBODY = 0
_NOBODY = -1


# (index in `Router.sockets`, where to) of each receiver
Destinations = tuple[tuple[int, Address], ...]
# a datagram to send, a slice of the one that came in, and who gets it
Out = tuple[Buffer, Destinations]
Handler = Callable[[Address, Buffer, float], list[Out]]


@dataclass(kw_only=True)
class Endpoint:
    """One client. heard: (system << 8 | component) of those who spoke from there, oldest first."""

    socket: int
    address: Address
    heard: dict[int, None] = field(default_factory=dict)
    last: float = 0.0

    def serves(self, target: int) -> bool:
        """target: system << 8 | component, component 0 for any of that system."""
        return target in self.heard or (not target & 0xFF and any(h >> 8 == target >> 8 for h in self.heard))


@dataclass(kw_only=True)
class Line:
    """One vehicle's side of the router.

    up: its link's other end.  routes: target -> who hears it, emptied whenever an endpoint changes.
    """

    vehicle: Vehicle
    seen: Seen
    telemetry: VehicleTelemetry = field(default_factory=VehicleTelemetry)
    serve: int = 0
    tools: int = 0
    up: Destinations = ()
    clients: dict[Address, Endpoint] = field(default_factory=dict)
    guests: dict[Address, Endpoint] = field(default_factory=dict)
    routes: dict[int, Destinations] = field(default_factory=dict)


@dataclass(kw_only=True)
class Counts:
    """Frames and bytes since the start. Frames out count once per destination."""

    frames_from_vehicles: int = 0
    frames_from_clients: int = 0
    frames_to_vehicles: int = 0
    frames_to_clients: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    unknown: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


class Router:
    """Feed it datagrams with `on_datagram`, time with `tick`; send what both return."""

    def __init__(self, table: Table) -> None:
        self.table, self.counts = table, Counts()
        self.sockets: list[Address] = []
        self._handlers: list[Handler] = []
        self._gcs = self._serve(table.gcs_local, self._from_gcs, table.gcs)
        self._gcs_heard_at = float("-inf")
        self._news: dict[str, Fact] = {}
        self._lines = [self._open(vehicle) for vehicle in table.vehicles]
        self._ids = frozenset(line.vehicle.id for line in self._lines)
        self._up_routes = {line.vehicle.id: line.up for line in self._lines}
        self._up_routes[_EVERYBODY] = tuple(place for line in self._lines for place in line.up)

    @property
    def links(self) -> dict[str, int]:
        """Vehicle -> index in `sockets` of its link's."""
        return {line.vehicle.name: line.up[0][0] for line in self._lines}

    def on_datagram(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out]:
        """socket: index in `sockets`.  data: as received; the answer holds slices of it.  now: monotonic [s]."""
        self.counts.bytes_in += len(data)
        return self._handlers[socket](sender, memoryview(data), now)

    def tick(self, now: float) -> None:
        """A few times a second: forget silent tools, notice silent vehicles."""
        for line in self._lines:
            line.seen.tick(now)
            silent = [address for address, guest in line.guests.items() if now - guest.last > TOOL_LIFE_S]
            for address in silent:
                del line.guests[address]
                line.routes.clear()

    def heartbeat(self, frame: bytes) -> list[Out]:
        """The same frame to every vehicle."""
        return [(frame, self._up_routes[_EVERYBODY])]

    def news(self) -> dict[str, Fact]:
        """Facts that changed since the last call."""
        if not self._news:
            return {}
        found = dict(self._news)
        self._news.clear()
        return found

    def warnings(self) -> list[str]:
        """Return the autopilots' warnings since the last call, as `uav1: Failsafe activated: ...`."""
        found = [f"{line.vehicle.name}: {text}" for line in self._lines for text in line.telemetry.texts]
        for line in self._lines if found else ():
            line.telemetry.texts.clear()
        return found

    def telemetry(self) -> dict[str, dict[str, float | None]]:
        """Return vehicle -> its height above the floor [m] and its battery [%], None where unknown."""
        return {
            line.vehicle.name: {
                "height_m": None if line.telemetry.height_m is None else round(line.telemetry.height_m, 2),
                "battery": line.telemetry.battery,
            }
            for line in self._lines
        }

    def any_armed(self, *, simulated: bool) -> bool:
        """Of the simulated vehicles, or of the real ones."""
        return any(line.seen.armed for line in self._lines if line.vehicle.simulated == simulated)

    @property
    def all_heard(self) -> bool:
        """Of the simulated vehicles: a real one that is switched off must not keep the others on the ground."""
        return not self.silent

    @property
    def silent(self) -> list[str]:
        """Simulated vehicles that were never heard."""
        return [
            line.vehicle.name for line in self._lines if line.vehicle.simulated and not line.seen.ever_heard
        ]

    def gcs_alive(self, now: float) -> bool:
        return now - self._gcs_heard_at <= GCS_ALIVE_S

    def _open(self, vehicle: Vehicle) -> Line:
        line = Line(vehicle=vehicle, seen=Seen(name=vehicle.name, news=self._news))
        line.up = ((self._add(vehicle.local, partial(self._from_vehicle, line)), vehicle.remote),)
        line.tools = self._add(vehicle.tools, partial(self._from_tool, line))
        line.serve = len(self.sockets)
        line.clients = self._serve(vehicle.serve, partial(self._from_client, line), vehicle.clients)
        return line

    def _serve(self, local: Address, handler: Handler, clients: Iterable[Address]) -> dict[Address, Endpoint]:
        """One more socket where there are clients on other computers: one bound to loopback cannot send to them."""
        near = self._add(local, handler)
        far = {c for c in clients if _is_loopback(local) and not _is_loopback(c)}
        wide = self._add(_ANYWHERE, handler) if far else near
        return {c: Endpoint(socket=wide if c in far else near, address=c) for c in clients}

    def _add(self, local: Address, handler: Handler) -> int:
        self.sockets.append(local)
        self._handlers.append(handler)
        return len(self.sockets) - 1

    # vehicle -> clients

    def _from_vehicle(self, line: Line, sender: Address, data: Buffer, now: float) -> list[Out]:
        if sender != line.vehicle.remote:
            return self._refuse("stranger on a vehicle's link")
        frames = self._cut(data)
        self.counts.frames_from_vehicles += len(frames)
        out: list[Out] = []
        for target, start, end, count in _runs(
            frames, [self._verdict_down(line, data, f, now) for f in frames]
        ):
            destinations = line.routes.get(target) or self._listen(line, target)
            if destinations:
                self.counts.frames_to_clients += count * len(destinations)
                out.append((data[start:end], destinations))
            else:
                self.counts.dropped["no listener"] += count
        return out

    def _verdict_down(self, line: Line, data: Buffer, frame: Frame, now: float) -> int:
        """The target, system << 8 | component."""
        _, _, _, _, sysid, compid, msgid, target_sys, target_comp = frame
        if sysid != line.vehicle.id:
            self.counts.dropped["foreign system on a vehicle's link"] += 1
            return _NOBODY
        if msgid in _PEEKED and compid == AUTOPILOT:
            line.seen.hear(data, frame, now)
        elif msgid in _TELEMETRY and compid == AUTOPILOT:
            line.telemetry.on_frame(data, frame, now)
        return target_sys << 8 | target_comp if target_sys else _EVERYBODY

    def _listen(self, line: Line, target: int) -> Destinations:
        if len(line.routes) >= MAX_ROUTES:
            line.routes.clear()
        found = line.routes[target] = tuple(self._listeners(line, target))
        return found

    def _listeners(self, line: Line, target: int) -> Iterable[tuple[int, Address]]:
        if line.vehicle.logger is not None:
            yield line.serve, line.vehicle.logger
        for endpoints in (line.clients, line.guests, self._gcs):
            for endpoint in endpoints.values():
                if target == _EVERYBODY or endpoint.serves(target):
                    yield endpoint.socket, endpoint.address

    # clients -> vehicle

    def _from_client(self, line: Line, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = line.clients.get(sender)
        if endpoint is None:
            return self._refuse("stranger on a serving socket")
        return self._up(line, endpoint, self._cut(data), data)

    def _from_tool(self, line: Line, sender: Address, data: Buffer, now: float) -> list[Out]:
        if not (_is_loopback(sender) or sender[0] == line.vehicle.tools[0]):
            return self._refuse("tool on another computer")
        frames = self._cut(data)
        if not frames:
            return []
        endpoint = line.guests.pop(sender, None)
        if endpoint is None:
            endpoint = Endpoint(socket=line.tools, address=sender)
            line.routes.clear()
            if len(line.guests) >= MAX_TOOLS:
                del line.guests[next(iter(line.guests))]
        line.guests[sender] = endpoint
        endpoint.last = now
        return self._up(line, endpoint, frames, data)

    def _from_gcs(self, sender: Address, data: Buffer, now: float) -> list[Out]:
        endpoint = self._gcs.get(sender)
        if endpoint is None:
            return self._refuse("stranger on the ground stations' socket")
        frames = self._cut(data)
        if frames:
            self._gcs_heard_at = now
        return self._up(None, endpoint, frames, data)

    def _up(self, line: Line | None, endpoint: Endpoint, frames: list[Frame], data: Buffer) -> list[Out]:
        """line: the only vehicle this endpoint may speak to; None for ground stations."""
        self.counts.frames_from_clients += len(frames)
        out: list[Out] = []
        for target, start, end, count in _runs(
            frames, [self._verdict_up(line, endpoint, data, f) for f in frames]
        ):
            destinations = self._up_routes[target]
            self.counts.frames_to_vehicles += count * len(destinations)
            out.append((data[start:end], destinations))
        return out

    def _verdict_up(self, line: Line | None, endpoint: Endpoint, data: Buffer, frame: Frame) -> int:
        """The system id of the vehicle it goes to."""
        _, _, payload, size, sysid, compid, msgid, target, _ = frame
        if compid == AUTOPILOT and sysid in self._ids:
            self.counts.dropped["vehicle's own message come back"] += 1
            return _NOBODY
        if (speaker := sysid << 8 | compid) not in endpoint.heard:
            self._learn(line, endpoint, speaker)
        if msgid == _TIMESYNC and any(data[payload : payload + min(8, size)]):
            self.counts.dropped["TIMESYNC reply"] += 1
            return _NOBODY
        if line is not None and (target in (0, line.vehicle.id)):
            return line.vehicle.id
        if line is None and (target == 0 or target in self._ids):
            return target
        self.counts.dropped["for a system not served here"] += 1
        return _NOBODY

    def _learn(self, line: Line | None, endpoint: Endpoint, speaker: int) -> None:
        if len(endpoint.heard) >= MAX_HEARD:
            del endpoint.heard[next(iter(endpoint.heard))]
        endpoint.heard[speaker] = None
        for changed in self._lines if line is None else (line,):
            changed.routes.clear()

    # both

    def _cut(self, data: Buffer) -> list[Frame]:
        frames, garbage, bad_crc, unknown = parse_frames(data)
        if garbage or unknown:
            self.counts.unknown += unknown
            self.counts.dropped["garbage bytes"] += garbage
            self.counts.dropped["wrong CRC"] += bad_crc
        return frames

    def _refuse(self, why: str) -> list[Out]:
        self.counts.dropped[why] += 1
        return []


def _is_loopback(address: Address) -> bool:
    return address[0].startswith("127.")


def _runs(frames: list[Frame], verdicts: list[int]) -> list[tuple[int, int, int, int]]:
    """(verdict, start, end, frames) of whole runs of adjoining frames with one verdict; _NOBODY's are left out."""
    if len(frames) == 1:
        return [(verdicts[0], frames[0][0], frames[0][1], 1)] if verdicts[0] != _NOBODY else []
    runs: list[tuple[int, int, int, int]] = []
    verdict, start, end, count = _NOBODY, 0, 0, 0
    for frame, own in zip(frames, verdicts, strict=True):
        if own == verdict and frame.start == end and frame.end - start <= RUN_BYTES:
            end, count = frame.end, count + 1
            continue
        if verdict != _NOBODY:
            runs.append((verdict, start, end, count))
        verdict, start, end, count = own, frame.start, frame.end, 1
    if verdict != _NOBODY:
        runs.append((verdict, start, end, count))
    return runs
