"""Socket on which the recorder receives copies of all MAVLink datagrams.

The router sends the copies. User programs send references and planned paths to the same socket.

The vehicle and the direction follow from the sender's address (`arena.mavlink_router.routing_table`). The kernel stamps each datagram at
its arrival, so that the recorder can read many datagrams at a time.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.clock_reading import read_together
from arena.transport import Address, enable_stamps, listen_udp, receive_stamped
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.planned_path import PATH_MESSAGE

RECEIVE_BUFFER_BYTES = 8 << 20
MAX_DATAGRAMS = 20_000  # read at a time, so that a flood of datagrams does not stop the recorder
_SO_RCVBUFFORCE, _SO_MEMINFO, _DROPS = 33, 55, 8  # asm-generic/socket.h and linux/sock_diag.h
_MEMINFO = struct.Struct("=9I")
_PUBLISHED = (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, PATH_MESSAGE)  # by programs, to the recorder


class CopySenders:
    """Table that assigns a received datagram to its vehicle and direction. Pure.

    vehicles: each with `name`, `id`, and the router's addresses `serve` and `tools`.
    unknown: number of datagrams from other senders that are not references or planned paths of a user program.
    """

    def __init__(self, vehicles: Sequence[Mapping[str, Any]]) -> None:
        self.unknown = 0
        self._senders: dict[Address, tuple[str, bool]] = {}
        for v in vehicles:
            self._senders[_address(v["serve"])] = (v["name"], False)
            self._senders[_address(v["tools"])] = (v["name"], True)
        self._names = {int(v["id"]): str(v["name"]) for v in vehicles}

    def owner(self, sender: Address) -> tuple[str, bool] | None:
        """Return the vehicle and direction that belong to an address of the router; None for another address.

        Direction: True for datagrams to the vehicle.
        """
        return self._senders.get(sender)

    def find(self, sender: Address, data: bytes) -> tuple[str, bool] | None:
        """Return the vehicle and direction of a datagram; None if the datagram must not be recorded.

        Direction: True for datagrams to the vehicle.
        """
        found = self._senders.get(sender) or self._reference(data)
        self.unknown += found is None
        return found

    def _reference(self, data: bytes) -> tuple[str, bool] | None:
        frames, garbage, _, _ = parse_frames(data)
        if not frames or garbage:
            return None
        systems = {f.sysid for f in frames if f.msgid in _PUBLISHED and f.compid == PROGRAM_COMPONENT}
        if len(systems) != 1 or any(f.msgid not in _PUBLISHED for f in frames):
            return None
        name = self._names.get(systems.pop())
        return None if name is None else (name, True)


class RouterCopies:
    """Socket that receives copies of all MAVLink datagrams.

    listen: address to bind.
    vehicles: as for `CopySenders`.
    """

    def __init__(self, listen: Address, vehicles: Sequence[Mapping[str, Any]]) -> None:
        self.senders = CopySenders(vehicles)
        self._socket = listen_udp(listen, "the recorder", receive_buffer_bytes=RECEIVE_BUFFER_BYTES)
        with contextlib.suppress(OSError):  # more than the system's limit, if the process may
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        enable_stamps(self._socket)

    def receive(self) -> Iterator[tuple[str, bool, bytes, float]]:
        """Yield all datagrams that have arrived, without waiting.

        Each item is (vehicle, up, data, monotonic time of arrival [s]). up: True if the datagram was sent to the
        vehicle.
        """
        receive, find, source = receive_stamped, self.senders.find, self._socket
        unix_s, monotonic_s = read_together(time.time)
        offset_s = monotonic_s - unix_s
        for _ in range(MAX_DATAGRAMS):
            try:
                data, sender, stamp_s = receive(source)
            except OSError:
                return
            if (found := find(sender, data)) is not None:
                at = time.monotonic() if stamp_s is None else stamp_s + offset_s
                yield found[0], found[1], data, at

    def fileno(self) -> int:
        """Return the file descriptor of the socket, which is readable when a datagram has arrived."""
        return self._socket.fileno()

    def is_empty(self) -> bool:
        """Return whether the socket's receive buffer is empty."""
        return not select.select([self._socket], [], [], 0.0)[0]

    def lost(self) -> int:
        """Return how many datagrams the kernel has dropped since the start because the receive buffer was full."""
        try:
            raw = self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
        except OSError:  # an old kernel
            return 0
        return int(_MEMINFO.unpack(raw)[_DROPS]) if len(raw) == _MEMINFO.size else 0

    def close(self) -> None:
        self._socket.close()


def _address(raw: Sequence[Any]) -> Address:
    host, port = raw
    return str(host), int(port)
