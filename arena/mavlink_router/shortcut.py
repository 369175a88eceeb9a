"""Shortcut of the router for ordinary datagrams (telemetry to all clients, setpoints), in compiled code.

Nearly all datagrams are ordinary. The kernel `ordinary_datagrams` finds their receivers in the tables of the
router.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

from arena.authority import MESSAGES
from arena.kernels.ordinary_datagrams import (
    BATTERY,
    BATTERY_REMAINING,
    LANDED,
    LANDED_STATE,
    NOT_FROM_AUTOPILOT,
    NOT_FROM_CLIENT,
    POSITION,
    SETPOINT,
    OrdinaryDatagrams,
    address_number,
)
from arena.mavlink_router.datagrams import MAX_DATAGRAM_BYTES
from arena.mavlink_router.endpoints import AutopilotLink, Counts, Destinations, Endpoint, Out, VehicleRoutes
from arena.mavlink_router.vehicle_telemetry import LOCAL_POSITION_NED, STATUSTEXT, SYS_STATUS
from arena.transport import Address
from arena.wire.age_limits import SETPOINTS
from arena.wire.mavlink_frame import Buffer, Frame, byte_at
from arena.wire.mavlink_minimal import EXTENDED_SYS_STATE, HEARTBEAT, TIMESYNC
from arena.wire.mavlink_targets import CRC_EXTRA, TARGETS

_STATUS = (HEARTBEAT, STATUSTEXT)
_READ = {SYS_STATUS: (BATTERY, BATTERY_REMAINING), EXTENDED_SYS_STATE: (LANDED, LANDED_STATE)}
"""Message -> (its property in the kernel, payload offset of the byte that the router reads)."""
_UNKNOWN = -1
_FLOAT, _BITS = struct.Struct("<f"), struct.Struct("<I")


class Shortcut:
    """Finder of the receivers of ordinary datagrams: telemetry to all clients, and setpoints.

    The router keeps the receivers and senders up to date.

    kernel: finds the receivers.  vehicles: all vehicles of the router, with their clients
    setpoint_test: MAVLink system id -> function that decides whether a program's setpoint may be sent to the vehicle now
    """

    def __init__(
        self,
        kernel: type[OrdinaryDatagrams],
        vehicles: Sequence[VehicleRoutes],
        setpoint_test: Callable[[int], Callable[[float], bool]],
    ) -> None:
        clients = [(i, endpoint) for i, v in enumerate(vehicles) for endpoint in v.clients.values()]
        # the kernel gets the ground station links as further vehicles, which have no clients
        links = [(v, v.main) for v in vehicles] + [(v, v.ground) for v in vehicles if v.ground is not None]
        for number, (_, link) in enumerate(links):
            link.number = number
        addresses = [link.remote for _, link in links] + [endpoint.address for _, endpoint in clients]
        self._number_of_address = {address: address_number(*address) for address in addresses}
        self._client_of = {id(endpoint): k for k, (_, endpoint) in enumerate(clients)}
        ids = [v.vehicle.id for v, _ in links]
        number_of, checks_beats = self._number_of_address, any(v.vehicle.needs_operator for v in vehicles)
        self.ordinary = kernel(
            {
                msgid: (_kind(msgid, checks_beats), seed, TARGETS.get(msgid, (-1, -1))[0])
                for msgid, seed in CRC_EXTRA.items()
            },
            ids,
            [(link.socket, number_of[link.remote]) for _, link in links],
            [(endpoint.socket, i, number_of[endpoint.address]) for i, endpoint in clients],
            [setpoint_test(system) for system in ids],
            MAX_DATAGRAM_BYTES,
        )
        for v in vehicles:
            self.ordinary.set_receivers(len(links) + v.number, v.up_and_record)

    def route(self, socket: int, sender: Address, data: Buffer, now: float) -> list[Out] | None:
        """Find the receivers of an ordinary datagram. Return None for other datagrams, which the router must process.

        The arguments are those of `Router.on_datagram`. The result contains the datagram and its receivers.
        """
        number = self._number_of_address.get(sender, _UNKNOWN)
        found = self.ordinary.find(socket, number, data, 0, len(data), now)
        return [(data, self.ordinary.receivers[found])] if found >= 0 else None

    def set_receivers(self, link: AutopilotLink, receivers: Destinations) -> None:
        """Set the receivers of the broadcast messages on a vehicle's link; () if they are not known yet."""
        self.ordinary.set_receivers(link.number, receivers)

    def set_senders(self, endpoint: Endpoint) -> None:
        """Replace the set of MAVLink senders (system and component ids) that send through a client's port.

        Endpoints that are not configured clients of one vehicle are ignored.
        """
        client = self._client_of.get(id(endpoint))
        if client is not None:
            self.ordinary.set_senders(client, endpoint.senders)

    def collect(self, counts: Counts) -> None:
        """Add the kernel's counts of frames and bytes to `counts`, then set the kernel's counts to zero."""
        ordinary = self.ordinary
        counts.frames_from_vehicles += ordinary.from_vehicles
        counts.frames_to_clients += ordinary.to_clients
        counts.frames_from_clients += ordinary.from_clients
        counts.frames_to_vehicles += ordinary.to_vehicles
        counts.bytes_in += ordinary.bytes_in
        ordinary.from_vehicles = ordinary.to_clients = 0
        ordinary.from_clients = ordinary.to_vehicles = ordinary.bytes_in = 0

    def on_status(self, link: AutopilotLink, data: Buffer, frame: Frame) -> None:
        """Store the battery charge or landed state that the router has read from a frame of an autopilot. Other frames are ignored.

        Until the value changes, datagrams with this message are ordinary on this link.
        """
        if (read := _READ.get(frame.msgid)) is not None:
            kind, offset = read
            self.ordinary.set_status(link.number, kind, byte_at(data, frame, offset))

    def collect_height(self, v: VehicleRoutes) -> None:
        """Update the height of a vehicle from the last LOCAL_POSITION_NED that the compiled loop of the router has routed."""
        bits = self.ordinary.take_z_bits(v.number)
        if bits >= 0:
            v.telemetry.on_z_n(*_FLOAT.unpack(_BITS.pack(bits)))


def _kind(msgid: int, checks_beats: bool) -> int:
    """Return the properties of a MAVLink message as bits, such as SETPOINT, for the kernel `ordinary_datagrams`.

    checks_beats: the router must check the heartbeats of programs (`VehicleRoutes.simulates_operator`)
    """
    kind = NOT_FROM_AUTOPILOT if msgid in _STATUS else 0
    if msgid in _READ:
        kind |= _READ[msgid][0]
    if msgid == LOCAL_POSITION_NED:
        kind |= POSITION
    if msgid in SETPOINTS:
        kind |= SETPOINT
    elif msgid in MESSAGES or msgid == TIMESYNC or (checks_beats and msgid == HEARTBEAT):
        kind |= NOT_FROM_CLIENT
    return kind
