"""Cross-checks of a whole arena: problems that involve several YAML keys.

All problems are reported at once. The checks read files only through the interface `Files`.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator

from arena.errors import Problem
from arena.mocap.vendors import vendor_settings
from arena.schema.arena import Arena, Vehicle
from arena.schema.checking import Check
from arena.schema.checks_fence import fence
from arena.schema.checks_groups import GROUPS
from arena.schema.checks_obstacles import obstacles
from arena.schema.checks_placeholders import placeholders
from arena.schema.checks_real import REAL
from arena.schema.checks_sensors import SENSORS
from arena.schema.checks_vehicle import VEHICLE
from arena.schema.loader import YamlPath
from arena.schema.mocap import keys_of_other_vendors
from arena.schema.models import NOT_YET
from arena.schema.ports import PORTS, SDK_ABOVE
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID

_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_LEAST_POSE_RATE_HZ = 10.0  # PX4's estimator stops fusing after gaps of 0.2 s


def check(c: Check) -> list[Problem]:
    """Run all cross-checks of an arena and return every problem that they find."""
    found = [p for one in _CHECKS for p in one(c)]
    return list(dict.fromkeys(p for p in found if p is not None))


def _names(c: Check) -> Iterator[Problem]:
    """Check that the names of vehicles and tools are valid.

    Only some characters are allowed, because arena also uses these names for files, processes and rigid bodies.
    """
    said = "expected at most 32 lower-case letters, digits and _, starting with a letter"
    for vehicle in c.arena.vehicles:
        if not _NAME.fullmatch(vehicle.name):
            yield c.source.problem(
                ("vehicles", vehicle.name), f"got {vehicle.name!r}, {said}. Try {_tamed(vehicle.name)}."
            )
        for tool in vehicle.tools:
            if not _NAME.fullmatch(tool):
                yield c.problem(vehicle.name, ("tools", tool), f"got {tool!r}, {said}. Try {_tamed(tool)}.")
    for tool in c.arena.tools:
        if not _NAME.fullmatch(tool):
            yield c.source.problem(("tools", tool), f"got {tool!r}, {said}. Try {_tamed(tool)}.")


def _tamed(name: str) -> str:
    kept = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return (kept if kept[:1].isalpha() else f"uav{kept}")[:32]


def _not_yet(c: Check) -> Iterator[Problem]:
    scopes: list[YamlPath] = [(), ("defaults",), *(("vehicles", v.name) for v in c.arena.vehicles)]
    for (key, only), instead in NOT_YET.items():
        for scope in scopes:
            path = (*scope, *key.split("."))
            value = c.source.value(path)
            if value not in (None, {}) and (only is None or value == only):
                shown = f" {value}" if only else ""
                yield c.source.problem(path, f"{path[-1]}{shown} is not available yet. {instead}.")


def _empty_sections(c: Check) -> Iterator[Problem]:
    """Refuse an empty section `copilot:` or `geofence:`. It looks enabled but has no effect.

    `--set copilot=null` is allowed.
    """
    written = c.source.document.data
    for key, meaning in (("copilot", "all its defaults"), ("geofence", "the whole room")):
        if (
            isinstance(written, dict)
            and key in written
            and written[key] is None
            and c.source.value((key,)) is None
        ):
            yield c.source.problem(
                (key,), f"has nothing below it. Write `{key}: {{}}` for {meaning}, or remove it."
            )


def _px4(c: Check) -> Iterator[Problem]:
    if c.arena.px4 is not None:
        return
    home = c.source.value(("px4", "home"))
    if isinstance(home, str) and any(v.asked in ("auto", "px4") for v in c.arena.vehicles):
        said = f"got {home}, which contains no PX4. Expected PX4's source, build or installation folder, or stand-in"
        yield c.source.problem(("px4", "home"), f"{said}. Run `arena doctor` to see how to get PX4.")
        return
    for vehicle in c.arena.vehicles:
        if vehicle.asked == "px4":
            message = "got px4, but no PX4 was found on this machine. Try autopilot: builtin, or set PX4_HOME to PX4's build folder."
            yield c.problem(
                vehicle.name,
                ("autopilot",),
                f"{message} `arena doctor` lists the searched folders, and how to get PX4.",
            )


def _ids(c: Check) -> Iterator[Problem]:
    for a, b in itertools.combinations(c.arena.vehicles, 2):
        if a.id == b.id and c.sound(a, "id") and c.sound(b, "id"):
            yield c.problem(
                b.name,
                ("id",),
                f"got {b.id}, which {a.name} ({c.place_of(a, 'id')}) has too. Try {_free_id(c.arena)}.",
            )
    for vehicle in c.arena.vehicles:
        if vehicle.id > LARGEST_VEHICLE_ID:
            yield c.source.problem(
                ("vehicles", vehicle.name),
                f"would get an id above {LARGEST_VEHICLE_ID}. "
                f"An arena has at most {LARGEST_VEHICLE_ID} vehicles.",
            )


def _free_id(arena: Arena) -> int:
    taken = {v.id for v in arena.vehicles}
    return next(i for i in range(1, len(taken) + 2) if i not in taken)


def _ports(c: Check) -> Iterator[Problem]:
    """Check that every port number is used only once in the arena.

    Vehicles with the same id are skipped, because `_ids` reports them.
    """
    owners: dict[int, tuple[str, YamlPath]] = {}
    reported: set[tuple[str, ...]] = set()
    for port, words, path in _claims(c):
        if port not in owners:
            owners[port] = (words, path)
            continue
        other, other_path = owners[port]
        pair = (str(path[:2]), str(other_path[:2]))
        if pair not in reported:
            reported.add(pair)
            yield _clash(c, port, (words, path), (other, other_path))


def _clash(c: Check, port: int, one: tuple[str, YamlPath], two: tuple[str, YamlPath]) -> Problem:
    """Return a problem that names the two YAML keys or processes that use the same port number.

    The problem is reported at the YAML key of `one`. If the user wrote only the key of `two`, it is reported
    at the key of `two`.
    """
    (words, path), (other, other_path) = (
        (one, two) if c.source.given(one[1]) or not c.source.given(two[1]) else (two, one)
    )
    file, line = c.source.place(other_path)
    at = f" ({file}:{line})" if other_path and line else ""
    rule = "Remove it to get a port by rule." if c.source.given(path) else "Change one of the two."
    return c.source.problem(path, f"port {port} for {words} is also {other}{at}. {rule}")


def _claims(c: Check) -> Iterator[tuple[int, str, YamlPath]]:
    """Yield (port number, its use as text, YAML path of its key) for each port that the arena uses."""
    for port in PORTS:
        place = c.arena.port_address(port)
        if place is not None:
            yield place[1], f"{port.owner}'s ({port.name})", ("copilot",) if port.key == "copilot" else ()
    mocap = c.arena.mocap
    for vendor in mocap.vendors:
        for key, words in vendor_settings(vendor).PORTS.items():
            yield getattr(mocap, key), words, ("mocap", key)
    seen: set[int] = set()
    for vehicle in c.arena.vehicles:
        if vehicle.id in seen or not c.sound(vehicle, "id", "port"):
            continue
        seen.add(vehicle.id)
        for port in PORTS:
            if port.per_vehicle and port.key != "wire":
                words = f"{vehicle.name}'s {_PORT_WORDS.get(port.key, f'{port.name} of {port.owner}')}"
                yield getattr(vehicle.ports, port.key), words, ("vehicles", vehicle.name, "port")


_PORT_WORDS = {"program": "program", "sdk": "SDK (port + 6000)"}


def _port_range(c: Check) -> Iterator[Problem]:
    for vehicle in c.arena.vehicles:
        if vehicle.ports.sdk > 65535:
            most = 65535 - SDK_ABOVE
            yield c.problem(
                vehicle.name,
                ("port",),
                f"got {vehicle.ports.program}, expected at most {most}, because the SDK's port is this number + 6000.",
            )


def _start(c: Check) -> Iterator[Problem]:
    """Check that every simulated vehicle starts completely inside the room."""
    north, east, height = c.arena.world.size
    for v in c.arena.simulated:
        if not c.sound(v, "start", "profile") or ("world", "size") in c.pruned:
            continue
        (n, e, d), radius = v.position, v.profile.radius_m
        yield from _beside(c, v, "N", n, north / 2 - radius)
        yield from _beside(c, v, "E", e, east / 2 - radius)
        if d > 0:
            said = f"got D {d:g}, expected 0 or less, because D points down. Try {-d:g} or 0."
            yield c.problem(v.name, ("start", "position"), f"starts below the floor: {said}")
        elif -d > height - v.profile.height_m:
            said = f"got D {d:g}, expected {v.profile.height_m - height:.2f} .. 0. Try 0."
            yield c.problem(v.name, ("start", "position"), f"starts outside the room: {said}")


def _beside(c: Check, v: Vehicle, axis: str, value: float, room: float) -> Iterator[Problem]:
    """Check on one horizontal axis that a simulated vehicle starts inside the room.

    Its centre must be at least its own radius away from the walls.

    room: largest allowed distance from the room's middle [m].
    """
    if abs(value) > room:
        best = math.copysign(max(math.floor(room * 100) / 100, 0.0), value)
        why = f"(the walls, less the vehicle's radius of {v.profile.radius_m:g} m)"
        said = f"starts outside the room: got {axis} {value:g}, expected {-room:.2f} .. {room:.2f} {why}"
        yield c.problem(v.name, ("start", "position"), f"{said}. Try {best:g}.")


def _overlap(c: Check) -> Iterator[Problem]:
    for a, b in itertools.combinations(c.arena.simulated, 2):
        apart, needed = math.dist(a.position, b.position), a.profile.radius_m + b.profile.radius_m
        if apart < needed and c.sound(a, "start", "profile") and c.sound(b, "start", "profile"):
            said = f"got {apart:.2f} m between their centres, expected at least {needed:.2f} m. Try another position."
            yield c.problem(
                b.name, ("start", "position"), f"overlaps {a.name} ({c.place_of(a, 'start')}): {said}"
            )


def _rates(c: Check) -> Iterator[Problem]:
    sim, mocap = c.arena.sim, c.arena.mocap
    if sim.physics_hz % sim.sensor_hz:
        near_by = [sim.physics_hz // n for n in range(1, 200) if sim.physics_hz % n == 0]
        best = min(near_by, key=lambda hz: abs(hz - sim.sensor_hz))
        yield c.source.problem(
            ("sim", "sensor_hz"),
            f"got {sim.sensor_hz}, must divide sim.physics_hz ({sim.physics_hz}). Try {best}.",
        )
    least_ms = 1000.0 / sim.sensor_hz
    if mocap.latency_ms < least_ms:
        said = f"got {mocap.latency_ms:g}, expected at least one sensor step ({least_ms:g} ms at {sim.sensor_hz} Hz)"
        yield c.source.problem(("mocap", "latency_ms"), f"{said}. Try {math.ceil(least_ms)}.")
    if ("mocap", "rate_hz") in c.pruned:
        return
    for vehicle in c.arena.vehicles:
        if vehicle.forward and c.sound(vehicle, "pose_rate_hz"):
            yield from _pose_rate(c, vehicle, mocap.rate_hz)


def _pose_rate(c: Check, vehicle: Vehicle, frames: float) -> Iterator[Problem]:
    rate = vehicle.pose_rate_hz
    every = frames / rate
    if abs(every - round(every)) > 1e-6 or every < 1:
        slower, faster = frames / math.ceil(every), frames / max(math.floor(every), 1)
        tries = " or ".join(f"{hz:g}" for hz in dict.fromkeys((slower, faster)) if hz >= _LEAST_POSE_RATE_HZ)
        yield c.problem(
            vehicle.name,
            ("pose_rate_hz",),
            f"got {rate:g}, must divide mocap.rate_hz ({frames:g}). Try {tries or f'{frames:g}'}.",
        )
    elif rate < _LEAST_POSE_RATE_HZ:
        said = f"got {rate:g}, expected at least {_LEAST_POSE_RATE_HZ:g}, because the estimator rejects poses after gaps of 0.2 s"
        yield c.problem(vehicle.name, ("pose_rate_hz",), f"{said}. Try {frames / math.ceil(frames / 60):g}.")


def _capture(c: Check) -> Iterator[Problem]:
    mocap = c.arena.mocap
    for vendor in mocap.vendors:
        for key, problem in vendor_settings(vendor).problems(mocap.keys):
            yield c.source.problem(("mocap", key), problem)
    for key, vendor in keys_of_other_vendors(mocap).items():
        if c.source.given(("mocap", key)):
            used = " and ".join(mocap.vendors)
            yield c.source.problem(
                ("mocap", key), f"is a key of {vendor}, but this arena uses {used}. Remove the key."
            )


_CHECKS = (
    _names,
    _not_yet,
    _empty_sections,
    _px4,
    *REAL,
    *VEHICLE,
    *GROUPS,
    placeholders,
    *SENSORS,
    _ids,
    _ports,
    _port_range,
    _start,
    fence,
    obstacles,
    _overlap,
    _rates,
    _capture,
)
