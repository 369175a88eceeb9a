"""Plan of a replay, which sends a recorded flight again to viewers, recorder and programs. Pure.

The arena of a replay is made new: it has the recorded vehicles, and nothing else of the recorded arena that could reach a vehicle. All
vehicles count as simulated, and all addresses are loopback addresses, except ground stations that the user names. In the plan, one
process `replay` replaces the fused arena's process `world`.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.errors import InputError
from arena.plan import slices
from arena.plan.fused import SLICE
from arena.plan.make import make_plan
from arena.plan.model import Listen, Member, Plan, ProcessSpec, Restart
from arena.schema import Arena
from arena.schema.load import arena_of
from arena.schema.loader import dump_yaml, load_yaml, parse_yaml

ADDRESS = "127.0.77.1"
"""Address of a replay, or the first free one after it. Arenas use 127.0.0.1 and following addresses, so land-all for an arena.yaml cannot
take a replayed vehicle for the vehicle of this arena."""
NAME, MODULE = "replay", "arena.replay"
_MEMBERS = ("router", "mocap", "recorder")
_WORLD_KEYS = ("size", "ceiling", "heading_deg", "origin")
_MOCAP_KEYS = ("rate_hz", "latency_ms", "version", "transport", "command_port", "data_port")
_VEHICLE_KEYS = ("id", "profile", "mocap_body", "mass_kg", "start")
_LONGEST_NAME = 57


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedVehicle:
    """Description of one vehicle of a recorded flight.

    name, body: its name, and that of its rigid body.  id: MAVLink system id.
    simulated: whether a simulated vehicle was recorded; only such a vehicle has a recorded true state.
    autopilot, profile: its autopilot (`builtin`, `px4`, `hitl`, `hardware`) and the name of its profile, "" if unknown.
    """

    name: str
    id: int
    body: str
    simulated: bool
    autopilot: str = ""
    profile: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings:
    """Source and options of a replay, such as the recorded files and the speed.

    name: name of the recorded arena, or of the log.  sources: files with the record, absolute.
    vehicles: vehicles of the flight.  size_m: size of the room, north, east, height [m].
    recorded: content of the recorded arena's YAML; {} if only a log exists.  folder: folder of this YAML.
    drawn: geofence and obstacles of the record, as in the slice of viewers; empty if the source does not contain them.
    unix_clock: the record has Unix times, because a vehicle was real; else simulation times.
    speed: recorded seconds per second of wall time, or "max".  from_s: where to begin, after the start of the record [s].
    loop: begin again at the end.  paused: begin paused.  stay: pause at the end instead of ending.
    stations: addresses of other computers whose ground station receives the telemetry.
    local_station: send the telemetry to a ground station on this computer.
    """

    name: str
    sources: Sequence[str]
    vehicles: Sequence[ReplayedVehicle]
    size_m: tuple[float, float, float]
    recorded: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    drawn: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    folder: str = ""
    unix_clock: bool = False
    speed: float | str = 1.0
    from_s: float = 0.0
    loop: bool = False
    paused: bool = False
    stay: bool = False
    stations: Sequence[str] = ()
    local_station: bool = True


def make_replay_plan(settings: ReplaySettings, address: str = ADDRESS, python: str = sys.executable) -> Plan:
    """Return the plan of a replay: its processes and their configuration files.

    address: loopback address that its processes bind.  python: path of the Python interpreter.
    Raises InputError if the address is not a loopback address, or one that `arena up` chooses for arenas.
    """
    if not address.startswith("127."):
        raise InputError(
            f"got the address {address}, but a replay can use only loopback addresses. Try {ADDRESS}"
        )
    if address.startswith("127.0.0."):
        raise InputError(
            f"got the address {address}, but 127.0.0.x are the addresses of flights: `arena land-all` could take "
            f"a replayed vehicle for a flying one. Try {ADDRESS}"
        )
    arena = _arena(settings, address)
    plan = make_plan(arena, python)
    made = _slices(arena, plan, settings)
    joined = [p for p in plan.processes if p.kind == "world"]
    return dataclasses.replace(
        plan,
        vehicles=tuple(dataclasses.replace(v, autopilot=NAME) for v in plan.vehicles),
        processes=(_process(joined[0], arena, python), *_others(plan)),
        slices=made,
        yaml="\n".join((f"# replay of {settings.sources[0]}", *plan.yaml.splitlines()[1:], "")),
        replay=settings.sources[0],
    )


def recorded_yaml(path: Path) -> Mapping[str, Any]:
    """Return the content of a recorded run's arena.yaml; {} if the file cannot be read."""
    try:
        data = load_yaml(path).data
    except InputError:
        return {}
    return data if isinstance(data, Mapping) else {}


def _arena(settings: ReplaySettings, address: str) -> Arena:
    world, mocap = (_section(settings.recorded, key) for key in ("world", "mocap"))
    log = _chosen(_section(settings.recorded, "log"), ("rate_hz",))
    fence = settings.recorded.get("geofence")
    content = {
        "name": _name(settings.name),
        "address": address,
        "world": {"size": list(settings.size_m), **_chosen(world, _WORLD_KEYS)},
        "sim": {"processes": "one", "speed": settings.speed},
        "mocap": _chosen(mocap, _MOCAP_KEYS),
        **({"log": log} if log else {}),
        **({"geofence": fence} if isinstance(fence, Mapping) else {}),
        "vehicles": {v.name: _vehicle(v, settings) for v in settings.vehicles},
    }
    file = str(Path(settings.folder) / "arena.yaml") if settings.folder else "replay"
    return arena_of(parse_yaml(dump_yaml(content), file), cross_checks=False)


def _vehicle(v: ReplayedVehicle, settings: ReplaySettings) -> dict[str, Any]:
    recorded = _chosen(_section(_section(settings.recorded, "vehicles"), v.name), _VEHICLE_KEYS)
    profile = str(recorded.pop("profile", v.profile))
    if not profile.endswith(".yaml") or (Path(settings.folder) / profile).is_file():
        recorded["profile"] = profile
    if not profile:
        del recorded["profile"]
    return {
        **recorded,
        "id": v.id,
        "mocap_body": v.body,
        "autopilot": "builtin",
        "gcs": list(settings.stations),
    }


def _slices(arena: Arena, plan: Plan, settings: ReplaySettings) -> dict[str, dict[str, Any]]:
    """Return the configuration files (slices) of a replay: {file name: content}.

    Viewers and programs get those of a flight. The process `replay` has one of its own.
    """
    made = {name: dict(slice_) for name, slice_ in plan.slices.items()}
    world = made.pop("world.json")
    members = [name for name in made.pop(SLICE)["members"] if name in _MEMBERS]
    for name in [name for name in made if name.startswith("forward.")]:
        del made[name]
    for name, slice_ in made.items():  # the process `replay` writes no pose page
        if name.startswith("program."):
            slice_["capture"] = slices.capture(arena, [slice_["body"]], simulated=True)
    router = made["router.json"]
    router |= {"heartbeat": False, "faults": None}
    router["vehicles"] = [{**v, "ground": None} for v in router["vehicles"]]
    router["gcs"] = [
        {**station, "also_from": ["127.0.0.1", station["address"][1]]}
        if station["name"] == "gcs"
        else station
        for station in router["gcs"]
        if settings.local_station or station["name"] != "gcs"
    ]
    made["mocap.json"]["faults"] = None
    _mark_vehicles(made, {v.name for v in settings.vehicles if not v.simulated})
    autopilots = {v.name: v.autopilot for v in settings.vehicles}
    for name in ("view.json", "recorder.json"):
        made[name] |= settings.drawn
    recorder = made["recorder.json"]
    recorder["vehicles"] = [{**v, "autopilot": autopilots[v["name"]]} for v in recorder["vehicles"]]
    if settings.unix_clock:
        recorder["clock"] = (
            None  # only for the metadata of the record: the times are those of the replay's clock
        )
    made[f"{NAME}.json"] = {
        "name": NAME,
        "sources": list(settings.sources),
        "address": plan.address,
        "stations": list(settings.stations),
        "speed": settings.speed,
        "from_s": settings.from_s,
        "loop": settings.loop,
        "paused": settings.paused,
        "stay": settings.stay,
        "clock": world["clock"],
        "truth": world["truth"],
        "members": members,
        "vehicles": [{"name": v.name, "id": v.id, "body": v.body} for v in settings.vehicles],
    }
    return made


def _mark_vehicles(made: dict[str, dict[str, Any]], real: set[str]) -> None:
    """Mark all vehicles as replayed in the configuration of the recorder and the viewers.

    Vehicles that were real have no true state.

    real: names of the vehicles that were real. Viewers receive their captured poses.
    """
    for name in ("recorder.json", "view.json"):
        slice_ = made.get(name)
        if slice_ is not None:
            vehicles = [{**v, "index": None} if v.get("name") in real else v for v in slice_["vehicles"]]
            made[name] = {**slice_, "vehicles": vehicles}
    view = made["view.json"]
    view["vehicles"] = [{**v, "replayed": True} for v in view["vehicles"]]
    bodies = [v["body"] for v in view["vehicles"] if v["name"] in real]
    captures = (slice_["capture"] for name, slice_ in made.items() if name.startswith("program."))
    view["captures"] = [{**capture, "bodies": bodies} for capture in [next(captures)] if bodies]


def _process(world: ProcessSpec, arena: Arena, python: str) -> ProcessSpec:
    """Return the process `replay`, which replaces the process `world` of the fused arena.

    world: the process `world`. The process `replay` contains the same router, motion capture emulator and recorder.
    python: path of the Python interpreter.
    """
    members = tuple(m for m in world.members if m.name in _MEMBERS)
    return dataclasses.replace(
        world,
        name=NAME,
        kind=NAME,
        argv=(python, "-m", MODULE, f"{{run}}/slices/{NAME}.json"),
        env=tuple(each for each in world.env if each[0] != "PYTHONHASHSEED"),
        needs=(),
        restart=Restart(),
        outlives=False,
        listens=tuple(x for x in world.listens if not _of_autopilot(x)),
        members=tuple(Member(name=m.name, kind=m.kind, vehicle=m.vehicle) for m in members),
    )


def _of_autopilot(port: Listen) -> bool:
    return port.what.startswith(("panic link", "vision link", "ground station link", "simulator API"))


def _others(plan: Plan) -> list[ProcessSpec]:
    """Return the processes of a replay except `replay` itself, such as viewers.

    They wait for the process `replay` instead of the world.
    """
    found = []
    for spec in plan.processes:
        if spec.kind == "world":
            continue
        needs = (NAME if need == "world" else need for need in spec.needs if not need.startswith("forward."))
        found.append(dataclasses.replace(spec, needs=tuple(dict.fromkeys(needs))))
    return found


def _section(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = data.get(key)
    return found if isinstance(found, Mapping) else {}


def _chosen(data: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    return {key: data[key] for key in keys if key in data}


def _name(name: str) -> str:
    """Return the name of a replay's arena: the recorded name with `-replay`.

    Characters that a name must not have are replaced.
    """
    return re.sub(r"^[^A-Za-z0-9]+", "", re.sub(r"[^A-Za-z0-9_.-]", "_", name))[:_LONGEST_NAME] + "-replay"
