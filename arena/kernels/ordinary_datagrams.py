"""Fast routing of ordinary datagrams, which go unchanged to a fixed set of receivers. Pure.

Most datagrams of a router are ordinary: telemetry from a vehicle to all its clients, and poses and setpoints from a program
that the router already knows. All other datagrams (commands, replies to one client, status of the autopilot, new senders,
broken frames) are not: `arena.mavlink_router.router` routes them. `arena.wire.mavlink_frame` describes the frames.
"""

from __future__ import annotations

from array import array
from itertools import accumulate
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from arena.kernels.arrays import Integers

    Buffer = bytes | bytearray | memoryview

SETPOINT, POSITION, NOT_FROM_AUTOPILOT, NOT_FROM_CLIENT, BATTERY, LANDED = 1, 2, 4, 8, 16, 32
"""Properties of a message. SETPOINT: the authority over the vehicle is asked. POSITION: it is LOCAL_POSITION_NED.
NOT_FROM_AUTOPILOT, NOT_FROM_CLIENT: a datagram that contains it is not ordinary. BATTERY, LANDED: it is SYS_STATUS or
EXTENDED_SYS_STATE; from an autopilot, it is ordinary if battery charge or landed state are those that the router has read."""
BATTERY_REMAINING, LANDED_STATE = 30, 1
"""Payload offsets of the bytes that the router reads: `battery_remaining` of SYS_STATUS, `landed_state` of EXTENDED_SYS_STATE."""
MAX_SENDERS, MAX_RECEIVERS = 32, 256
"""Size of the tables: senders behind one address, and receivers of one set."""
NOT_ORDINARY = -1
# the same numbers with C types, see the .pxd file
_SETPOINT, _POSITION, _MAX_SENDERS = SETPOINT, POSITION, MAX_SENDERS
_NOT_FROM_AUTOPILOT, _NOT_FROM_CLIENT, _BATTERY, _LANDED = (
    NOT_FROM_AUTOPILOT,
    NOT_FROM_CLIENT,
    BATTERY,
    LANDED,
)
_BATTERY_REMAINING, _LANDED_STATE = BATTERY_REMAINING, LANDED_STATE
_V1, _V2, _SIGNED = 0xFE, 0xFD, 0x01
_V1_HEAD, _V2_HEAD, _CRC, _SIGNATURE = 6, 10, 2, 13
_AUTOPILOT = 1
_NO_VEHICLE = -1
# an entry of the table of messages contains the properties, CRC_EXTRA and 1 + the offset of target_system
_SEED_SHIFT, _TARGET_SHIFT = 8, 16
_Z = 12  # payload offset of z in LOCAL_POSITION_NED


def _tables(*sizes: int) -> list[Integers]:
    """Return arrays of -1 that lie side by side, because a datagram is routed faster if it needs few pages of memory.

    They are made without numpy, which would double the memory of the router's process.
    """
    memory, starts = memoryview(array("l", [-1]) * sum(sizes)), accumulate(sizes, initial=0)
    return [memory[start : start + size] for start, size in zip(starts, sizes, strict=False)]


def address_number(host: str, port: int) -> int:
    """Convert an IPv4 address and a UDP port to one integer."""
    a, b, c, d = (int(part) for part in host.split("."))
    return a << 40 | b << 32 | c << 24 | d << 16 | port


class OrdinaryDatagrams:
    """Finder of the receivers of ordinary datagrams (telemetry, setpoints) of V vehicles and their clients.

    A set of receivers has a number: v for all receivers of vehicle v's telemetry, V + v for its autopilot.
    receivers: the sets of receivers that the router has found; () for a set that it must still find (2 V)
    versions: number of changes of each set (2 V,)
    from_vehicles, to_clients: number of ordinary frames that were received, and that were sent (frames times receivers)
    from_clients, to_vehicles: the same in the other direction
    bytes_in: number of received bytes
    """

    def __init__(
        self,
        messages: Mapping[int, tuple[int, int, int]],
        ids: Sequence[int],
        links: Collection[tuple[int, int]],
        clients: Sequence[tuple[int, int, int]],
        passes_setpoint: Sequence[Callable[[float], bool]],
        max_bytes: int,
    ) -> None:
        """Create the tables for known messages, vehicles and clients.

        messages: message id -> (properties, CRC_EXTRA, payload offset of target_system or -1)
        ids: MAVLink system id of each vehicle
        links: (socket, number of the autopilot's address) of each vehicle
        clients: (first socket, vehicle, number of the address) of each client
        passes_setpoint: for each vehicle, monotonic time [s] -> whether a program's setpoint may be sent to it now
        max_bytes: a longer datagram is not ordinary
        """
        vehicles = len(ids)
        sockets = 1 + max([socket for socket, _ in links] + [socket for socket, _, _ in clients], default=0)
        self.max_bytes, self._passes_setpoint = max_bytes, list(passes_setpoint)
        (
            self._ids, self._remote, self._receiver_counts, self.versions, self._z_bits, self._charge,
            self._landed, self._link_of, self._client_of, self._next_client, self._owner, self._address,
            self._is_vehicle, self._senders, self._messages,
        ) = _tables(
            vehicles, vehicles, 2 * vehicles, 2 * vehicles, vehicles, vehicles, vehicles, sockets,
            sockets, len(clients), len(clients), len(clients), 256,
            len(clients) * MAX_SENDERS, 1 + max(messages),
        )  # fmt: skip
        for number, (kind, seed, target) in messages.items():
            self._messages[number] = kind | seed << _SEED_SHIFT | (target + 1) << _TARGET_SHIFT
        for v, ((socket, address), system) in enumerate(zip(links, ids, strict=True)):
            self._ids[v], self._remote[v], self._link_of[socket] = system, address, v
            self._is_vehicle[system] = 1
        for k, (socket, v, address) in enumerate(clients):
            self._owner[k], self._address[k] = v, address
            self._next_client[k], self._client_of[socket] = self._client_of[socket], k
        for number in range(2 * vehicles):
            self._receiver_counts[number] = self.versions[number] = 0
        self.receivers: list[tuple[Any, ...]] = [() for _ in range(2 * vehicles)]
        self.from_vehicles = self.to_clients = self.from_clients = self.to_vehicles = self.bytes_in = 0
        self._sysid = self._compid = self._kind = self._target = self._payload = self._length = 0

    def set_receivers(self, number: int, receivers: tuple[Any, ...]) -> None:
        """Replace the receivers of a vehicle's telemetry, or of the messages to its autopilot.

        number: number of this set of receivers, see the class.

        Datagrams to no receiver, or to more than `MAX_RECEIVERS`, are not ordinary.
        """
        receivers = receivers if len(receivers) <= MAX_RECEIVERS else ()
        self.receivers[number] = receivers
        self._receiver_counts[number] = len(receivers)
        self.versions[number] += 1

    def set_senders(self, client: int, senders: Collection[int]) -> None:
        """Store the MAVLink senders (system << 8 | component) that are known to send from a client's address.

        At most `MAX_SENDERS`.
        """
        known = [*senders, *[-1] * MAX_SENDERS]
        for i in range(MAX_SENDERS):
            self._senders[client * MAX_SENDERS + i] = known[i]

    def take_z_bits(self, v: int) -> int:
        """Return z of the newest LOCAL_POSITION_NED, as bits of a float32; -1 if none is new since the last call."""
        bits, self._z_bits[v] = self._z_bits[v], -1
        return bits

    def set_status(self, v: int, kind: int, value: int) -> None:
        """Store what the router has read from SYS_STATUS or EXTENDED_SYS_STATE: messages with the same value are then ordinary.

        kind: BATTERY or LANDED.  value: byte of the battery charge, or of the landed state.
        """
        if kind == BATTERY:
            self._charge[v] = value
        else:
            self._landed[v] = value

    def find(self, socket: int, sender: int, data: Buffer, start: int, end: int, now: float) -> int:
        """Find the receivers of a datagram. Return their index in `receivers`; `NOT_ORDINARY` if Python must route it.

        An ordinary datagram is counted as sent to all its receivers; of others nothing is remembered.
        socket: index of the socket that received it. sender: number of the sender's address
        data, start, end: the datagram is data[start:end]. now: monotonic [s]
        """
        if socket >= len(self._link_of) or end - start > self.max_bytes or start == end:
            return NOT_ORDINARY
        v = self._link_of[socket]
        if v != _NO_VEHICLE:
            if sender != self._remote[v]:
                return NOT_ORDINARY
            return self._from_vehicle(v, data, start, end)
        client = self._client_of[socket]
        while client >= 0 and self._address[client] != sender:
            client = self._next_client[client]
        return self._from_client(client, data, start, end, now) if client >= 0 else NOT_ORDINARY

    def _from_vehicle(self, v: int, data: Buffer, start: int, end: int) -> int:
        receivers, frames, at, z = self._receiver_counts[v], 0, start, -1
        if receivers == 0:
            return NOT_ORDINARY
        while at < end:
            at = self._read_frame(data, at, end)
            if at < 0 or self._sysid != self._ids[v] or self._target != 0:
                return NOT_ORDINARY
            kind = self._kind
            if self._compid == _AUTOPILOT and kind != 0:
                if kind & _NOT_FROM_AUTOPILOT:
                    return NOT_ORDINARY
                if kind & _BATTERY and self._number_at(data, _BATTERY_REMAINING) & 0xFF != self._charge[v]:
                    return NOT_ORDINARY
                if kind & _LANDED and self._number_at(data, _LANDED_STATE) & 0xFF != self._landed[v]:
                    return NOT_ORDINARY
                if kind & _POSITION:
                    z = self._number_at(data, _Z)
            frames += 1
        if z >= 0:
            self._z_bits[v] = z
        self.from_vehicles += frames
        self.to_clients += frames * receivers
        self.bytes_in += end - start
        return v

    def _from_client(self, client: int, data: Buffer, start: int, end: int, now: float) -> int:
        v, frames, at, setpoint = self._owner[client], 0, start, False
        while at < end:
            at = self._read_frame(data, at, end)
            if at < 0 or (self._target != 0 and self._target != self._ids[v]):
                return NOT_ORDINARY
            if self._compid == _AUTOPILOT and self._is_vehicle[self._sysid] == 1:
                return NOT_ORDINARY
            kind = self._kind
            if kind & _NOT_FROM_CLIENT or not self._knows_sender(client):
                return NOT_ORDINARY
            setpoint = setpoint or kind & _SETPOINT != 0
            frames += 1
        if setpoint and not self._passes_setpoint[v](now):
            return NOT_ORDINARY
        self.from_clients += frames
        self.to_vehicles += frames
        self.bytes_in += end - start
        return len(self._ids) + v

    def _knows_sender(self, client: int) -> bool:
        sender, first = self._sysid * 256 + self._compid, client * _MAX_SENDERS
        for i in range(first, first + _MAX_SENDERS):
            known = self._senders[i]
            if known == sender:
                return True
            if known < 0:
                return False
        return False

    def _read_frame(self, data: Buffer, at: int, end: int) -> int:
        """Read the MAVLink frame at an offset. Return the offset after the frame; -1 if the frame is broken or unknown."""
        magic, signature = data[at], 0
        if magic == _V2 and at + _V2_HEAD + _CRC <= end:
            if data[at + 2] > _SIGNED:  # a frame with an unknown flag must not be read
                return -1
            signature = _SIGNATURE if data[at + 2] == _SIGNED else 0
            self._payload = at + _V2_HEAD
            self._sysid, self._compid = data[at + 5], data[at + 6]
            msgid = data[at + 7] + 256 * data[at + 8] + 65536 * data[at + 9]
        elif magic == _V1 and at + _V1_HEAD + _CRC <= end:
            self._payload = at + _V1_HEAD
            self._sysid, self._compid, msgid = data[at + 3], data[at + 4], data[at + 5]
        else:
            return -1
        self._length = data[at + 1]
        crc_at = self._payload + self._length
        if crc_at + _CRC + signature > end or msgid >= len(self._messages) or self._messages[msgid] < 0:
            return -1
        message = self._messages[msgid]
        crc = self._crc(data, at + 1, crc_at, message >> _SEED_SHIFT & 0xFF)
        if data[crc_at] != crc & 0xFF or data[crc_at + 1] != crc >> 8:
            return -1
        target = (message >> _TARGET_SHIFT) - 1
        self._target = data[self._payload + target] if 0 <= target < self._length else 0
        self._kind = message & 0xFF
        return crc_at + _CRC + signature

    def _crc(self, data: Buffer, start: int, end: int, seed: int) -> int:
        """Compute the CRC-16/MCRF4XX over data[start:end], followed by the seed byte (CRC_EXTRA).

        It is computed without a table, which would have to be loaded again for nearly every message.
        """
        crc = 0xFFFF
        for i in range(start, end + 1):
            byte = (data[i] if i < end else seed) ^ crc & 0xFF
            byte = (byte ^ byte << 4) & 0xFF
            crc = crc >> 8 ^ byte << 8 ^ byte << 3 ^ byte >> 4
        return crc

    def _number_at(self, data: Buffer, offset: int) -> int:
        """Return four bytes of the present frame's payload as an unsigned integer.

        Bytes beyond the end of the payload are 0.
        """
        number = 0
        for i in range(4):
            if offset + i < self._length:
                byte = data[self._payload + offset + i]
                number += byte << 8 * i
        return number
