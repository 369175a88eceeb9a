"""Reads the data for a film from run folders or log files: motions, names, room, rotor positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.flight_log.flight import Flight
from arena.flight_log.open import read_flights
from arena.render.backdrop import Room
from arena.render.surroundings import Surroundings, surroundings
from arena.render.tracks import Track, track

_ROUND_M = 1.0


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Recorded flights with one common time axis.

    title: name of the arena or of the log.
    tracks: vehicles in the order of the plan.
    """

    title: str
    tracks: tuple[Track, ...]
    room: Room


def load(paths: Sequence[Path], vehicles: Sequence[str] = ()) -> Recorded:
    """Read run folders and log files for a film. All log formats are supported.

    Logs of one folder are on one clock. Several paths are shown together: each starts at zero, unless their clocks overlap.
    vehicles: names of the vehicles to show; () for all.
    Raises InputError if a path is no log, a vehicle does not exist, or no log contains a position.
    """
    around = [surroundings(path) for path in paths]
    groups = [_in_order(read_flights(path), found.order) for path, found in zip(paths, around, strict=True)]
    groups = _on_one_clock(groups)
    names = [f.name for flights in groups for f in flights]
    if unknown := [v for v in vehicles if v not in names]:
        raise InputError(
            f"--vehicle {unknown[0]}: no such vehicle in {paths[0]}, expected one of {', '.join(names)}"
        )
    frames = {name: frame for found in around for name, frame in found.airframes.items()}
    shown = [f for flights in groups for f in flights if not vehicles or f.name in vehicles]
    start_s = min(f.t0 for f in shown)
    tracks = tuple(found for f in shown if (found := track(f, start_s, frames.get(f.name))) is not None)
    if not tracks:
        raise InputError(f"{paths[0]}: the log contains no position of a vehicle, so no picture can be drawn")
    room = next((found.room for found in around if found.room is not None), None)
    return Recorded(title=_title(paths, around), tracks=tracks, room=room or _floor_around(tracks))


def _in_order(flights: Sequence[Flight], names: Sequence[str]) -> list[Flight]:
    order = {name: k for k, name in enumerate(names)}
    return sorted(flights, key=lambda f: order.get(f.name, len(order)))


def _on_one_clock(groups: list[list[Flight]]) -> list[list[Flight]]:
    """Shift each run or log to start at time zero if the runs and logs do not overlap in time."""
    spans = [(min(f.t0 for f in g), max(f.t0 + float(f.t[-1]) for f in g)) for g in groups]
    if max(start for start, _ in spans) <= min(end for _, end in spans):
        return groups
    return [
        [Flight(**{**f.__dict__, "t0": f.t0 - start}) for f in group]
        for group, (start, _) in zip(groups, spans, strict=True)
    ]


def _title(paths: Sequence[Path], around: Sequence[Surroundings]) -> str:
    names = dict.fromkeys(
        found.title or path.resolve().stem for path, found in zip(paths, around, strict=True)
    )
    return ", ".join(names) if len(names) <= 2 else f"{next(iter(names))} and {len(names) - 1} more"


def _floor_around(tracks: Sequence[Track]) -> Room:
    """Return a floor slightly larger than the flown area, for logs without a room."""
    points = np.concatenate([t.p_n[:, :2] for t in tracks])
    low, high = np.floor(points.min(axis=0) - _ROUND_M), np.ceil(points.max(axis=0) + _ROUND_M)
    return Room(low=(float(low[0]), float(low[1])), high=(float(high[0]), float(high[1])), height_m=None)
