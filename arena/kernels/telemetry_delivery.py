"""Delivers the ordinary telemetry of the built-in autopilots of a fused arena: to the recorder, programs and other receivers. Pure.

`arena.fused.router` decides who the receivers are, and delivers all other datagrams.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from arena.kernels.held_telemetry import HeldTelemetry, ProgramPlace
    from arena.kernels.ordinary_datagrams import OrdinaryDatagrams

    Message = tuple[int, str, bytes]
    Record = tuple[str, bool, bytes]
    Place = tuple[int, tuple[str, int]]
    Receivers = tuple[Place, ...]
    Places = list[tuple[Place, ProgramPlace | None]]


class TelemetryPath:
    """Receivers of the telemetry of one link, sorted by kind: recorder, programs, others.

    receivers: all receivers, including those whose port is closed.  closed: the closed ports for which this was computed
    vehicle: name under which the recorder stores the datagrams; None: they are not recorded
    places: (socket, address) of each receiver with an open port except the recorder, and its `ProgramPlace`; None if it is not a
        program that sleeps
    """

    def __init__(self, receivers: Receivers, closed: object, vehicle: str | None, places: Places) -> None:
        self.receivers, self.closed, self.vehicle, self.places = receivers, closed, vehicle, places


class TelemetryDelivery:
    """Sender of the ordinary telemetry of all built-in autopilots of this process.

    ordinary: finds the receivers, and defines which datagrams are ordinary
    links: name of each link -> (socket, number of the autopilot's address) of each vehicle; (-1, -1) for one without this link
    held: store of the telemetry for sleeping programs
    records: list that gets (vehicle, up, data) of each datagram for the recorder
    find_path: returns the path for a set of receivers
    bytes_out: sum over all datagrams of size times number of receivers [bytes]. Receivers with a closed port count, too
    """

    def __init__(
        self,
        ordinary: OrdinaryDatagrams,
        links: Mapping[str, Sequence[tuple[int, int]]],
        held: HeldTelemetry,
        records: list[Record],
        find_path: Callable[[Receivers], TelemetryPath],
    ) -> None:
        self._ordinary, self._held, self._records, self._find_path = ordinary, held, records, find_path
        self._links = {name: list(places) for name, places in links.items()}
        self._paths: list[Any] = [None] * len(ordinary.receivers)
        self.bytes_out = 0

    def deliver(self, messages: list[Message], begin: int, closed: object, now: float) -> int:
        """Deliver messages of the autopilots, in their order. Return the index of the first one that is not ordinary.

        The caller must deliver that message, and then call again. If all are delivered, the number of messages is returned.
        messages: (index of the vehicle, name of the link, datagram) of each.  begin: index of the first message to deliver
        closed: ports at which no program listens.  now: simulation time [s]
        """
        for k in range(begin, len(messages)):
            vehicle, link, data = messages[k]
            places = self._links.get(link)
            if places is None:
                return k
            socket, sender = places[vehicle]
            found = self._ordinary.find(socket, sender, data, 0, len(data), now) if socket >= 0 else -1
            if found < 0:
                return k
            receivers = self._ordinary.receivers[found]
            path: TelemetryPath | None = self._paths[found]
            if path is None or path.receivers is not receivers or path.closed is not closed:
                path = self._paths[found] = self._find_path(receivers)
            self.bytes_out += len(data) * len(receivers)
            if path.vehicle is not None:
                self._records.append((path.vehicle, False, data))
            for place, program in path.places:
                if program is None or not self._held.hold(program, data, now, True):
                    self._held.send(place[0], data, place[1])
        return len(messages)
