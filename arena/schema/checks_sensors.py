"""Cross-checks of the emulated relative sensors: `neighbours`, `beacon_sensor` and `beacons`."""

from __future__ import annotations

import re
from collections.abc import Iterator

from arena.errors import Problem
from arena.schema.arena import Vehicle
from arena.schema.checking import Check
from arena.schema.source import near

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def _neighbours(c: Check) -> Iterator[Problem]:
    names = [v.name for v in c.arena.vehicles]
    for v in c.arena.vehicles:
        own = c.source.given(("vehicles", v.name, "neighbours"))
        for i, other in enumerate(v.neighbour_sensor.vehicles):
            place = _place(c, v, i)
            if other == v.name and own:
                yield c.problem(v.name, place, f"got {other!r}, which is the vehicle itself. Remove it.")
            elif other not in names:
                yield c.problem(v.name, place, f"got {other!r}, expected a vehicle. {near(other, names)}")
            elif other in v.neighbour_sensor.vehicles[:i]:
                yield c.problem(v.name, place, f"got {other!r} a second time. Remove it.")


def _place(c: Check, v: Vehicle, index: int) -> tuple[str | int, ...]:
    """Return the YAML path of one vehicle name in the key `neighbours`, for messages.

    The key is a list of names, or a mapping with the list `vehicles`.
    index: place of the name in the list, from 0.
    """
    mapping = c.source.given((*c.where(v.name, "neighbours"), "vehicles"))
    return ("neighbours", "vehicles", index) if mapping else ("neighbours", index)


def _beacons(c: Check) -> Iterator[Problem]:
    names = list(c.arena.beacons)
    for name in names:
        if not _NAME.fullmatch(name):
            said = f"got {name!r}, expected at most 64 letters, digits, _, - and ., starting with a letter or digit. Rename it."
            yield c.source.problem(("beacons", name), said)
    for v in c.arena.vehicles:
        sensor = v.beacon_sensor
        if sensor is None:
            continue
        if not names:
            said = "the arena has no beacons. Write `beacons: {NAME: [north, east, down]}`."
            yield c.problem(v.name, ("beacon_sensor",), said)
        for i, name in enumerate(sensor.beacons or ()):
            if names and name not in names:
                said = f"got {name!r}, expected a beacon. {near(name, names)}"
                yield c.problem(v.name, ("beacon_sensor", "beacons", i), said)


def _rates(c: Check) -> Iterator[Problem]:
    frames_hz = c.arena.mocap.rate_hz
    for v in c.arena.vehicles:
        for key, sensor in (("neighbours", v.neighbour_sensor), ("beacon_sensor", v.beacon_sensor)):
            if sensor is not None and sensor.source == "mocap" and sensor.rate_hz > frames_hz:
                said = f"got {sensor.rate_hz:g}, but motion capture has {frames_hz:g} frames per second (mocap.rate_hz). Try {frames_hz:g}."
                yield c.problem(v.name, (key, "rate_hz"), said)


def _sources(c: Check) -> Iterator[Problem]:
    """Check that the pose source of each relative sensor provides usable poses of all vehicles involved.

    An estimate without motion capture poses has another origin. The emulator does not measure real vehicles.
    """
    known = {v.name: v for v in c.arena.vehicles}
    for v in c.arena.vehicles:
        others = [known[name] for name in v.neighbours if name in known]
        if others:
            yield from _source(c, v, "neighbours", v.neighbour_sensor.source, [v, *others])
        if v.beacon_sensor is not None:
            yield from _source(c, v, "beacon_sensor", v.beacon_sensor.source, [v])


def _source(c: Check, v: Vehicle, key: str, source: str, measured: list[Vehicle]) -> Iterator[Problem]:
    for one in measured:
        if source == "estimator" and not one.forward:
            yield c.problem(
                v.name,
                (key, "source"),
                f"got estimator, but {one.name} has `forward: false`: without captured poses, the origin of its estimate is not that of "
                "the arena. Try mocap.",
            )
        elif source == "mocap" and not one.simulated and c.arena.mocap.source == "emulator":
            yield c.problem(
                v.name,
                (key, "source"),
                f"got mocap, but no motion capture measures {one.name}, because mocap.source is emulator. Try natnet for mocap.source.",
            )


SENSORS = (_neighbours, _beacons, _rates, _sources)
