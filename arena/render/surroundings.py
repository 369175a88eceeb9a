"""Names, room, geofence and rotor positions of a recorded flight, from its run folder or its record."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arena.errors import InputError
from arena.flight_log.recording import Recording
from arena.obstacles import obstacles_of
from arena.render.airframe import Airframe, airframe
from arena.render.backdrop import Room

_BELOW_M = 0.06


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """Room, vehicle names and airframes of a flight: the data that the vehicles' logs do not contain.

    title: name of the arena; "" if unknown.  order: names of the vehicles in the order of the YAML.
    room: None if unknown.  airframes: vehicle -> places of its rotors.
    """

    title: str = ""
    order: tuple[str, ...] = ()
    room: Room | None = None
    airframes: Mapping[str, Airframe] = field(default_factory=dict)


def surroundings(path: Path) -> Surroundings:
    """Return the room, names and airframes for a run folder or a log file.

    A log file in a run folder belongs to this run.
    """
    for folder in (path, *path.resolve().parents[:2]):
        try:
            plan = json.loads((folder / "plan.json").read_text())
        except (OSError, ValueError):
            continue
        if isinstance(plan, dict):
            return _of_plan(plan)
    return _of_record(path) if path.suffix == ".mcap" else Surroundings()


def _of_plan(plan: Mapping[str, Any]) -> Surroundings:
    slices = {name.removesuffix(".json"): given for name, given in plan.get("slices", {}).items()}
    links = [given.get("preflight") or {} for name, given in slices.items() if name.startswith("link.")]
    view, world = slices.get("view") or {}, slices.get("world") or {}
    size = next((given["size_m"] for given in (view, world, *links) if given.get("size_m")), None)
    return Surroundings(
        title=str(plan.get("name") or ""),
        order=tuple(v["name"] for v in plan.get("vehicles", ())),
        room=None if size is None else _room(size, view),
        airframes=dict(_airframes(view)) | dict(_airframes(world)),
    )


def _of_record(file: Path) -> Surroundings:
    try:
        record = Recording(file)
    except InputError:
        return Surroundings()  # reading its flights reports the reason
    names = tuple(v.name for v in record.vehicles)
    return Surroundings(title=record.name, order=names, room=_room(record.size_m, record.drawn))


def _room(size_m: Any, drawn: Mapping[str, Any]) -> Room:
    """Return the room of a flight.

    size_m: north, east, height [m].
    drawn: mapping with the keys `fence` and `obstacles` of slices.
    """
    fence = drawn.get("fence")
    north, east, height = (float(x) for x in size_m)
    corners = None
    if fence is not None:
        (south, north_end), (west, east_end) = fence["north"], fence["east"]
        corners = ((float(south), float(west), 0.0), (float(north_end), float(east_end), -float(fence["up"])))
    return Room(
        low=(-north / 2, -east / 2),
        high=(north / 2, east / 2),
        height_m=height,
        fence=corners,
        obstacles=obstacles_of(drawn.get("obstacles")),
    )


def _airframes(given: Mapping[str, Any]) -> Iterator[tuple[str, Airframe]]:
    """Yield (vehicle, airframe) for each vehicle whose rotor positions are known.

    given: slice `world`, in which a vehicle has a profile, or `view`, in which a vehicle has some keys of its profile.
    """
    for vehicle in given.get("vehicles", ()):
        found = vehicle.get("profile")
        profile = found if isinstance(found, dict) else vehicle
        rotors = [rotor["position_m"] for rotor in profile.get("rotors") or ()]
        if rotors:
            sizes = (profile.get(key) or {} for key in ("ground_effect", "downwash"))
            disc_m = next((s["rotor_radius_m"] for s in sizes if s.get("rotor_radius_m")), None)
            below_m = profile.get("ground_clearance_m") or 0.5 * float(profile.get("height_m") or 0.0)
            yield vehicle["name"], airframe(rotors, disc_m=disc_m, below_m=below_m or _BELOW_M)
