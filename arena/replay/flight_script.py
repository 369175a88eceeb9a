"""Messages of a replay, computed from log files (CSV or ULog) if there is no flight.mcap. Pure.

Telemetry and motion capture messages are computed from the columns of the logs.
"""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from arena.errors import InputError
from arena.flight_log.columns import RPY, WXYZ
from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.replay.parameters import ParameterHistory, Stored
from arena.replay.script import Item, Kind, ScriptVehicle, TrueState, nanoseconds
from arena.replay.synthetic_telemetry import SyntheticTelemetry
from arena.wire.flight_record import RecordedBody, RecordedFrame
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID

_MAX_GAP_S = 0.5
_UNTRACKED = (math.nan,) * 3, (math.nan,) * 4


class FlightScript:
    """Source of a replay's messages: computes them from log files. Implements `arena.replay.script.Script`.

    Logs whose times do not overlap are moved to a common start: their clocks count from the start of each autopilot.
    The frames of motion capture have the times of the rows of the first log with captured poses. The poses of the other vehicles
    are interpolated to these times.

    flights: log of each vehicle.  parameters: those of each vehicle at the start; () if they are unknown.
    Raises InputError if there is no log.
    """

    def __init__(self, flights: Sequence[Flight], parameters: Sequence[Mapping[str, Stored]] = ()) -> None:
        if not flights:
            raise InputError("nothing to replay: no log of a vehicle was given")
        self._flights = _aligned(flights)
        ids = vehicle_ids([flight.name for flight in flights])
        self.vehicles = tuple(
            ScriptVehicle(name=name, id=ids[name], body=name, simulated=flight.simulated)
            for name, flight in zip(ids, self._flights, strict=True)
        )
        self.bodies = frozenset(v.body for v in self.vehicles)
        self.parameters = [ParameterHistory(known) for known in parameters or [{}] * len(flights)]
        self.start_ns = nanoseconds(min(f.t0 for f in self._flights))
        self.end_ns = nanoseconds(max(f.t0 + float(f.t[-1]) for f in self._flights))

    def items(self, from_ns: int) -> Iterator[Item]:
        streams = [
            self._frames(),
            *(s(i) for i in range(len(self.vehicles)) for s in (self._truth, self._telemetry)),
        ]
        for item in heapq.merge(*streams, key=attrgetter("time_ns")):
            if item.time_ns >= from_ns:
                yield item

    def _telemetry(self, vehicle: int) -> Iterator[Item]:
        telemetry = SyntheticTelemetry(self._flights[vehicle], self.vehicles[vehicle].id)
        for t, datagram in telemetry.datagrams():
            yield Item(nanoseconds(t), Kind.DOWN, vehicle, datagram)

    def _truth(self, vehicle: int) -> Iterator[Item]:
        flight = self._flights[vehicle]
        if not flight.simulated:
            return
        groups = (("truth.pos", None), ("truth.vel", None), ("truth.att_q", WXYZ), ("truth.ang_vel", RPY))
        columns = [flight.group(name, parts) if parts else flight.group(name) for name, parts in groups]
        known = np.isfinite(np.concatenate(columns, axis=1)).all(axis=1)
        for i in np.flatnonzero(known).tolist():
            values = [tuple(column[i].tolist()) for column in columns]
            yield Item(nanoseconds(flight.t0 + float(flight.t[i])), Kind.TRUTH, vehicle, TrueState(*values))

    def _frames(self) -> Iterator[Item]:
        poses = [_Poses(flight) for flight in self._flights]
        leader = next((p for p in poses if p.t.size), None)
        for number, t in enumerate(() if leader is None else leader.t.tolist(), start=1):
            bodies = (p.body(v.body, t) for v, p in zip(self.vehicles, poses, strict=True) if p.t.size)
            ordered = tuple(sorted(bodies))
            yield Item(nanoseconds(t), Kind.FRAME, -1, RecordedFrame(t, number, t, t, True, ordered))


class _Poses:
    """Captured poses of one vehicle, from its log.

    t: times of the rows that have a pose, by the clock of the log [s].
    """

    def __init__(self, flight: Flight) -> None:
        p_n, q_nb = flight.group("mocap.pos"), flight.group("mocap.att_q", WXYZ)
        known = np.isfinite(p_n).all(axis=1) & (np.linalg.norm(q_nb, axis=1) > 0.9)
        self.t: Array = (flight.t0 + flight.t)[known]
        self._p_n, q = p_n[known], q_nb[known]
        flips = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
        self._q_nb = q * np.concatenate(([1.0], flips))[:, None] if len(q) else q

    def body(self, name: str, t: float) -> RecordedBody:
        """Return the captured pose at a time [s], interpolated between two log rows.

        The body is untracked if rows are missing at this time.
        """
        after = int(np.searchsorted(self.t, t))
        if after == self.t.size or (after == 0 and self.t[0] != t):
            return RecordedBody(name, False, *_UNTRACKED)
        before = after if self.t[after] == t else after - 1
        span = float(self.t[after] - self.t[before])
        if span > _MAX_GAP_S:
            return RecordedBody(name, False, *_UNTRACKED)
        u = (t - float(self.t[before])) / span if span else 0.0
        x, y, z = (self._p_n[before] + u * (self._p_n[after] - self._p_n[before])).tolist()
        mixed = self._q_nb[before] + u * (self._q_nb[after] - self._q_nb[before])
        w, i, j, k = (mixed / np.linalg.norm(mixed)).tolist()
        return RecordedBody(name, True, (x, y, z), (w, i, j, k))


def vehicle_ids(names: Sequence[str]) -> dict[str, int]:
    """Return the MAVLink system id of each vehicle name.

    It is the number at the end of the name, or else the lowest free id.

    A name that several logs have gets a suffix.
    """
    unique: list[str] = []
    for name in names:
        made, k = name, 2
        while made in unique:
            made, k = f"{name}_{k}", k + 1
        unique.append(made)
    found: dict[str, int] = {}
    for name in unique:
        digits = re.search(r"(\d{1,3})$", name)
        number = int(digits.group()) if digits else 0
        if 1 <= number <= LARGEST_VEHICLE_ID and number not in found.values():
            found[name] = number
    free = (k for k in range(1, LARGEST_VEHICLE_ID + 1) if k not in found.values())
    return {name: found[name] if name in found else next(free) for name in unique}


def _aligned(flights: Sequence[Flight]) -> list[Flight]:
    """Return the flights on a common time axis: if their times do not overlap, all flights start together.

    If their times do not overlap, all flights start at the time of the first flight.
    """
    latest_start = max(f.t0 for f in flights)
    earliest_end = min(f.t0 + float(f.t[-1]) for f in flights)
    if latest_start <= earliest_end:
        return list(flights)
    return [replace(f, t0=flights[0].t0) for f in flights]
