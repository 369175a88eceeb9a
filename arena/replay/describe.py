"""Description of a recorded flight before its replay starts: vehicles and room.

It reads no recorded messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arena.errors import InputError
from arena.flight_log.flight import Flight
from arena.flight_log.open import read_flights
from arena.flight_log.recording import Recording
from arena.replay.flight_script import FlightScript
from arena.replay.open_script import record_of
from arena.replay.record_script import script_vehicles
from arena.replay.script import ScriptVehicle
from arena.wire.flight_record import UNIX_CLOCK

_ROOM_M = (7.0, 4.0, 3.0)
_MARGIN_M = 0.5
_UNIX_FROM_S = 1e9


@dataclass(frozen=True, kw_only=True)
class Described:
    """Vehicles, room and files of a recorded flight.

    name: name of the arena or of the log.  sources: absolute paths of the files.  vehicles: its vehicles.
    size_m: size of the room, north, east, height [m].  folder: the run folder of a record, None for logs.
    drawn: geofence and obstacles, as in the configuration (slice) of viewers; empty for logs.
    unix_clock: whether its times are Unix times; else simulation times, or times since the start of an autopilot.
    """

    name: str
    sources: tuple[str, ...]
    vehicles: tuple[ScriptVehicle, ...]
    size_m: tuple[float, float, float]
    unix_clock: bool
    folder: Path | None
    drawn: Mapping[str, Any] = field(default_factory=dict)


def describe(paths: Sequence[Path]) -> Described:
    """Return the vehicles and the room of a recorded flight. Raises InputError if a file cannot be read.

    paths: files or run folder, as for `open_script`.
    """
    record = record_of(paths[0])
    if record is not None and len(paths) == 1:
        recording = Recording(record)
        return Described(
            name=recording.name,
            sources=(str(record.resolve()),),
            vehicles=script_vehicles(recording),
            size_m=recording.size_m,
            unix_clock=recording.clock == UNIX_CLOCK,
            folder=record.resolve().parent,
            drawn=recording.drawn,
        )
    if any(record_of(path) is not None for path in paths):
        raise InputError(
            "a record (flight.mcap) contains all vehicles of a run: replay one record, or several log files, not both"
        )
    flights = [flight for path in paths for flight in read_flights(path)]
    return Described(
        name=paths[0].stem,
        sources=tuple(str(path.resolve()) for path in paths),
        vehicles=FlightScript(flights).vehicles,
        size_m=_room(flights),
        unix_clock=min(flight.t0 for flight in flights) > _UNIX_FROM_S,
        folder=None,
    )


def _room(flights: Sequence[Flight]) -> tuple[float, float, float]:
    """Return a room size that contains all logged positions: north, east, height [m].

    It is at least the size of the default room.
    """
    farthest = np.zeros(3)
    for flight in flights:
        known = np.concatenate([flight.group(name) for name in ("truth.pos", "mocap.pos", "ekf.pos")])
        farthest = np.fmax(farthest, np.nanmax(np.abs(np.vstack((known, np.zeros(3)))), axis=0))
    north, east, height = (farthest + _MARGIN_M).tolist()
    sizes = (2.0 * north, 2.0 * east, height)
    return (
        max(_ROOM_M[0], round(sizes[0], 1)),
        max(_ROOM_M[1], round(sizes[1], 1)),
        max(_ROOM_M[2], round(sizes[2], 1)),
    )
