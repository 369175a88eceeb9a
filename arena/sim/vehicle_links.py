"""UDP sockets of the vehicles' MAVLink links, read without waiting.

A link with a loopback address accepts any sender, as PX4 does, but sends to its fixed partner only. A link
with an address that other computers can reach accepts only this computer and the partner's; other senders are
refused and counted.

The number of datagrams read per link and step and the total time are limited, so that a flood on one socket
delays neither the other links nor the step. The other datagrams stay in the kernel's buffer; if it is full,
the kernel drops them.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from arena.errors import InputError, RunError
from arena.transport import open_udp

LINKS = ("panic", "vision", "router", "ground")
_PER_TURN = 4  # datagrams of one link before the next link is read
_PER_STEP = 64  # datagrams of one link in one step
_MAX_BYTES = 65_536
Receive = Callable[[int, str, bytes], None]


class LinkInterface(Protocol):
    """Interface between the world's step loop (`arena.sim.loop`) and the MAVLink links of all vehicles.

    ready: True if the vehicles can be flown over these links.
    """

    @property
    def ready(self) -> bool: ...

    def drain(self, receive: Receive) -> None:
        """Read all datagrams that have arrived, and call `receive(vehicle, link, datagram)` for each."""

    def drain_panic(self, receive: Receive) -> bool:
        """Pass the datagrams of the panic links, which are reserved for emergencies, to `receive`.

        `receive` is the function of `drain`.

        The world calls it while simulation time stands still, so that emergency commands arrive then, too. Return whether a
        datagram had arrived.
        """

    def send(self, messages: list[tuple[int, str, bytes]], now: float) -> None:
        """Send the MAVLink datagrams of this step, given as (vehicle, link, datagram).

        now: simulation time [s].
        """

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Process a request of the supervisor. `process_context` explains the requests."""

    def stats(self) -> dict[str, int]:
        """Return the numbers of received, sent and dropped datagrams."""

    def close(self) -> None:
        """Close the MAVLink links of all vehicles."""


@dataclass(frozen=True, kw_only=True)
class _VehicleLink:
    vehicle: int
    link: str
    socket: socket.socket
    remote: tuple[str, int]
    hosts: frozenset[str]  # senders that are accepted; empty: all


class VehicleLinks:
    """UDP sockets of all vehicles' MAVLink links, on which the world's autopilots receive and send.

    vehicles: vehicles as configured for the world
    budget_s: wall time after which `drain` stops at the end of its current pass over the links [s]
    """

    def __init__(self, vehicles: Sequence[Mapping[str, Any]], *, budget_s: float) -> None:
        self._budget_s = budget_s
        self._epoll, self._panic_epoll = select.epoll(), select.epoll()
        self._by_fd: dict[int, _VehicleLink] = {}
        self._by_name: dict[tuple[int, str], _VehicleLink] = {}
        self._page = memoryview(bytearray(_MAX_BYTES))
        self.received = self.sent = self.not_sent = self.cut_short = self.strangers = 0
        for i, vehicle in enumerate(vehicles):
            for name in LINKS:
                if name in vehicle.get("links", {}):
                    self._open(i, str(vehicle["name"]), name, vehicle["links"][name])

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a datagram has arrived at a link."""
        return self._epoll.fileno()

    def drain(self, receive: Receive) -> None:
        """Read all datagrams that have arrived, and call `receive(vehicle, link, datagram)` for each.

        It reads a few datagrams per link in each pass over the links, panic links first.
        """
        if found := self._epoll.poll(0):
            self._read([self._by_fd[fd] for fd, _ in found], receive)

    def drain_panic(self, receive: Receive) -> bool:
        """Pass the datagrams of the panic links, which are reserved for emergencies, to `receive`.

        `receive` is the function of `drain`.

        Return whether a datagram had arrived.
        """
        before = self.received
        if found := self._panic_epoll.poll(0):
            self._read([self._by_fd[fd] for fd, _ in found], receive)
        return self.received > before

    def _read(self, ready: list[_VehicleLink], receive: Receive) -> None:
        ready.sort(key=lambda x: LINKS.index(x.link))
        until = time.monotonic() + self._budget_s
        for _ in range(_PER_STEP // _PER_TURN):
            ready = [link for link in ready if self._read_some(link, receive)]
            if not ready:
                return
            if time.monotonic() > until:
                break
        self.cut_short += 1

    @property
    def ready(self) -> bool:
        """Always True. The sockets can be used as soon as they are open.

        The processes at the other ends, such as the router, report to the supervisor themselves that they are ready.
        """
        return True

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Do nothing. The router and the pose forwarders receive the supervisor's requests in their own processes."""

    def send(self, messages: Sequence[tuple[int, str, bytes]], now: float = 0.0) -> None:
        """Send each (vehicle, link, datagram) to the remote address of the link.

        A datagram is dropped if the buffer is full, because MAVLink repeats its messages.
        """
        for vehicle, name, data in messages:
            link = self._by_name.get((vehicle, name))
            if link is None:
                continue
            try:
                link.socket.sendto(data, link.remote)
                self.sent += 1
            except OSError:
                self.not_sent += 1

    def stats(self) -> dict[str, int]:
        """Return the number of received, sent and dropped datagrams for the process's statistics."""
        return {
            "received": self.received,
            "sent": self.sent,
            "not_sent": self.not_sent,
            "cut_short": self.cut_short,
            "strangers": self.strangers,
        }

    def close(self) -> None:
        """Close all sockets."""
        for link in self._by_fd.values():
            link.socket.close()
        self._epoll.close()
        self._panic_epoll.close()

    def _read_some(self, link: _VehicleLink, receive: Receive) -> bool:
        """Read a limited number of datagrams of one link, so that no link blocks another link.

        Return whether more datagrams may be waiting.
        """
        for _ in range(_PER_TURN):
            try:
                size, sender = link.socket.recvfrom_into(self._page)
            except OSError:  # nothing left, or an ICMP error for a datagram sent before
                return False
            if link.hosts and sender[0] not in link.hosts:
                self.strangers += 1
                continue
            self.received += 1
            receive(link.vehicle, link.link, bytes(self._page[:size]))
        return True

    def _open(self, i: int, vehicle: str, name: str, settings: Mapping[str, Any]) -> None:
        local, remote = (
            _address(settings, "local", f"{vehicle}.{name}"),
            _address(settings, "remote", f"{vehicle}.{name}"),
        )
        try:
            made = open_udp(local, receive_buffer_bytes=None)
        except OSError as error:
            raise RunError(
                f"{vehicle}: {name} link: cannot bind UDP {local[0]}:{local[1]}: {error.strerror}. "
                "Does another arena run on this address?"
            ) from error
        link = _VehicleLink(
            vehicle=i, link=name, socket=made, remote=remote, hosts=accepted_hosts(local[0], remote[0])
        )
        self._by_fd[made.fileno()] = self._by_name[i, name] = link
        self._epoll.register(made.fileno(), select.EPOLLIN)
        if name == "panic":
            self._panic_epoll.register(made.fileno(), select.EPOLLIN)


def accepted_hosts(local: str, remote: str) -> frozenset[str]:
    """Return the hosts from which a link accepts datagrams. An empty set means all hosts.

    A link on the loopback accepts all, because only this computer can reach it.

    local, remote: the two ends of the link
    """
    return frozenset() if local.startswith("127.") else frozenset({local, remote})


def _address(settings: Mapping[str, Any], key: str, what: str) -> tuple[str, int]:
    try:
        host, port = settings[key]
        return str(host), int(port)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"configuration of link {what}: {key}: got {settings.get(key)!r}, expected [host, port]"
        ) from error
