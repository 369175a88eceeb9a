"""Converts the validated YAML to an `Arena`: merges defaults, profiles and vehicle keys.

Later layers win: built-in defaults, profile, `defaults`, the vehicle's own keys, `--set`. `resolve` never raises, because
`validate` (before) and `checks` (after) report missing and wrong values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from arena.mocap.vendors import vendor_settings
from arena.schema.arena import Arena, Autopilot, Fence, Origin, Program, Px4, Vehicle
from arena.schema.base import Strict
from arena.schema.library import with_overrides
from arena.schema.loader import YamlPath, dotted
from arena.schema.models import ArenaFile, Sim, Start, VehicleKeys
from arena.schema.ports import vehicle_ports
from arena.schema.profile import Profile
from arena.schema.px4 import STAND_IN
from arena.schema.ranges import place_in_grid
from arena.schema.relative_sensors import BeaconSensor, Neighbours
from arena.schema.source import Source
from arena.schema.tools import Tool
from arena.transport import DEFAULT_BAUD, ConnectionUrl, parse_url
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID

Section = TypeVar("Section", bound=Strict)

DEFAULT_PROFILE = "iris"
MOST_POSE_RATE_HZ = 60.0


def resolve(
    model: ArenaFile,
    source: Source,
    profiles: Mapping[str, Profile],
    find_px4: Callable[[str | None], Px4 | None] = lambda home: None,
    params_files: Mapping[str, Mapping[str, float]] | None = None,
) -> Arena:
    """Return the `Arena` of a validated YAML, with defaults, profiles and vehicle keys merged.

    profiles: name -> profile. A missing profile is replaced by the default profile.
    find_px4: searches PX4; called with `px4.home`, at most once, if a vehicle may use PX4.
    params_files: file name in the YAML -> parameters in this file.
    """
    folder = Path(source.document.file).absolute().parent
    origins: dict[str, Origin] = {}
    for key in ("address", "world", "sim", "mocap", "log", "preflight", "failsafe", "landing_speed_m_s"):
        _trace(origins, source, (key,), getattr(model, key))
    if model.copilot is not None:
        _trace(origins, source, ("copilot",), model.copilot)
    name = model.name or _name_from(folder.name)
    _note(origins, "name", name, source.origin(("name",)) if model.name else "the folder's name")
    for vendor in model.mocap.vendors:
        for key, value in vendor_settings(vendor).derived_keys(model.mocap.keys, model.address).items():
            given = source.given(("mocap", key))
            origin = source.origin(("mocap", key)) if given else "rule: from address"
            _note(origins, f"mocap.{key}", value, origin)
    drawn, fence = model.geofence, fence_of(model)
    if drawn is not None:
        for key in ("north", "east", "up"):
            place = ("geofence", key)
            words = source.origin(place) if source.given(place) else "default: the room's"
            words += ", less margin_m" if drawn.margin_m else ""
            _note(origins, f"geofence.{key}", getattr(fence, key), words)
    ids = _ids(model.vehicles)
    wanted = {v.autopilot or model.defaults.autopilot or "auto" for v in model.vehicles.values()}
    px4 = find_px4(_home(model, folder)) if wanted & {"auto", "px4"} else None
    files = params_files or {}
    vehicles = tuple(
        _Merge(model, source, profiles, origins, v, folder, px4, files).vehicle(ids[v])
        for v in model.vehicles
    )
    sim = _speed_of_programs(model.sim, vehicles, origins)
    return Arena(
        name=name,
        file=source.document.file,
        folder=str(folder),
        address=model.address,
        world=model.world,
        sim=sim,
        mocap=model.mocap,
        log=model.log,
        preflight=model.preflight,
        tools=model.tools,
        copilot=model.copilot,
        vehicles=vehicles,
        px4=px4 if any(v.autopilot == "px4" for v in vehicles) else None,
        geofence=fence,
        failsafe=model.failsafe,
        landing_speed_m_s=model.landing_speed_m_s,
        beacons=model.beacons,
        source=source,
        origins=origins,
    )


def wall_clock_programs(vehicles: Sequence[Vehicle]) -> list[str]:
    """Return the names of the simulated vehicles whose programs use the wall clock. They need `sim.speed` 1."""
    return [v.name for v in vehicles if v.simulated and v.program is not None and v.program.clock == "wall"]


def _speed_of_programs(sim: Sim, vehicles: Sequence[Vehicle], origins: dict[str, Origin]) -> Sim:
    """Return the simulation settings, with speed 1 (real time) if a user program uses the wall clock.

    At another speed such a program would send setpoints at a wrong rate of simulated time, so that the offboard failsafe acts.
    """
    programs = wall_clock_programs(vehicles)
    if not programs or sim.speed == 1.0:
        return sim
    _note(origins, "sim.speed", 1.0, f"rule: the program of {programs[0]} uses the wall clock")
    return sim.model_copy(update={"speed": 1.0})


def fence_of(model: ArenaFile) -> Fence | None:
    """Return the geofence, reduced by the margin. Sides that the YAML does not give are the room's walls and ceiling."""
    drawn = model.geofence
    if drawn is None:
        return None
    (north, east, up), m = model.world.size, drawn.margin_m
    n, e = drawn.north or (-north / 2.0, north / 2.0), drawn.east or (-east / 2.0, east / 2.0)
    return Fence(north=(n[0] + m, n[1] - m), east=(e[0] + m, e[1] - m), up=(drawn.up or up) - m)


def _home(model: ArenaFile, folder: Path) -> str | None:
    """Return the folder of PX4 SITL from the YAML key `px4.home`, or `stand-in`, or None if the key is not set.

    A relative path starts at the YAML's folder. `stand-in` selects the built-in autopilot with PX4's simulator API, for computers without
    PX4.
    """
    home = model.px4.home
    return str(folder / Path(home).expanduser()) if home and home != STAND_IN else home


def _name_from(folder: str) -> str:
    kept = "".join(c if c.isalnum() or c in "_-." else "-" for c in folder if ord(c) < 128).strip("-._")
    return kept[:64] or "arena"


def _ids(vehicles: Mapping[str, VehicleKeys]) -> dict[str, int]:
    taken = {v.id for v in vehicles.values() if v.id is not None}
    free = iter(i for i in range(1, LARGEST_VEHICLE_ID + len(vehicles) + 1) if i not in taken)
    return {name: v.id if v.id is not None else next(free) for name, v in vehicles.items()}


def pose_rate_hz(frame_rate_hz: float) -> float:
    """Return the pose rate to an autopilot [Hz]: the camera frame rate divided by an integer, at most 60 Hz."""
    return frame_rate_hz / math.ceil(frame_rate_hz / MOST_POSE_RATE_HZ - 1e-9)


class _Merge:
    """Merger of one vehicle's values from built-in defaults, `defaults` in the YAML, and the vehicle's keys.

    It records where each value comes from.
    """

    def __init__(
        self,
        model: ArenaFile,
        source: Source,
        profiles: Mapping[str, Profile],
        origins: dict[str, Origin],
        name: str,
        folder: Path,
        px4: Px4 | None,
        params_files: Mapping[str, Mapping[str, float]],
    ) -> None:
        self.model, self.source, self.profiles = model, source, profiles
        self.origins, self.name, self.folder, self.px4 = origins, name, folder, px4
        self.own, self.common = model.vehicles[name], model.defaults
        self.params_files = params_files

    def vehicle(self, vehicle_id: int) -> Vehicle:
        name, own = self.name, self.own
        wanted = self._take("profile", DEFAULT_PROFILE)
        overrides = self._overrides()
        profile = with_overrides(self.profiles.get(wanted, self.profiles[DEFAULT_PROFILE]), overrides)
        ports = vehicle_ports(vehicle_id, own.port)
        self._own("id", vehicle_id, "rule: lowest free id, in the order of the YAML")
        self._own("port", ports.program, "rule: 16000 + id")
        self._note("sdk_port", ports.sdk, "rule: port + 6000")
        asked = self._take("autopilot", "auto")
        autopilot = self._autopilot(asked)
        start = self._start()
        near = self._section("neighbours", Neighbours)
        forward = bool(self._take("forward", True))
        gps, sticks = bool(self._take("gps", False)), bool(self._take("sticks", False))
        rate = self._take(
            "pose_rate_hz",
            pose_rate_hz(self.model.mocap.rate_hz),
            "default: the highest divisor of mocap.rate_hz up to 60",
        )
        return Vehicle(
            name=name,
            id=vehicle_id,
            profile=profile,
            profile_key=str((self.folder / wanted).absolute()) if wanted.endswith(".yaml") else wanted,
            autopilot=autopilot,
            asked=asked,
            wire=self._wire(autopilot),
            uid=own.uid or "",
            gps=gps,
            sticks=sticks,
            radio=self._take("radio", "required") if autopilot == "hardware" else "none",
            key_file=self._key_file(),
            measured=own.measured or {},
            position=start.position,
            rpy_deg=start.rpy_deg,
            ports=ports,
            gcs=self._take("gcs", ()),
            own_params=self._own_params(),
            overrides=overrides,
            wind_m_s=self._take("wind_m_s", None, "default: world.wind_m_s"),
            px4_version=self._px4_version(autopilot),
            mocap_body=self._own("mocap_body", own.mocap_body or name, "default: the vehicle's name"),
            forward=forward,
            pose_rate_hz=float(rate),
            program=self._program(),
            backend=self._take("backend", "mavlink"),
            neighbours=tuple(n for n in near.vehicles if n != name),
            neighbour_sensor=near,
            beacon_sensor=self._beacon_sensor(),
            tools=self._tools(),
        )

    def _autopilot(self, asked: str) -> Autopilot:
        if asked == "hardware":
            return "hardware"
        if asked == "hitl":
            return "hitl"
        return "px4" if self.px4 and asked in ("auto", "px4") else "builtin"

    def _wire(self, autopilot: str) -> ConnectionUrl | None:
        """Return the connection to a real flight controller, from `url` or `serial`. Other autopilots give None.

        A missing or wrong key gives None, too; `checks` reports it.
        """
        if autopilot not in ("hardware", "hitl"):
            return None
        key = "url" if autopilot == "hardware" else "serial"
        given = self._own(key, getattr(self.own, key), "default")
        baud = self._own("baud", self.own.baud or DEFAULT_BAUD, "default")
        if given is None:
            return None
        try:
            serial = ConnectionUrl(kind="serial", device=given, baud=baud)
            return parse_url(given, baud=baud) if autopilot == "hardware" else serial
        except ValueError:
            return None

    def _key_file(self) -> str:
        if self.own.signing is None:
            return ""
        file = str((self.folder / self.own.signing.key_file).absolute())
        return str(self._own("signing.key_file", file, "default"))

    def _take(self, key: str, default: Any, words: str = "default") -> Any:
        """Return a key's value from the vehicle, or else from `defaults`, or else the default. Record its source."""
        for layer, path in ((self.own, ("vehicles", self.name, key)), (self.common, ("defaults", key))):
            value = getattr(layer, key)
            if value is not None:
                return self._note(key, value, self.source.origin(path))
        return self._note(key, default, words)

    def _own(self, key: str, value: Any, words: str) -> Any:
        """Return the value of a key that can be written only under the vehicle, not under `defaults`.

        Record where the value comes from.
        """
        path = ("vehicles", self.name, key)
        return self._note(key, value, self.source.origin(path) if self.source.given(path) else words)

    def _beacon_sensor(self) -> BeaconSensor | None:
        if self.own.beacon_sensor is None and self.common.beacon_sensor is None:
            return None
        return self._section("beacon_sensor", BeaconSensor)

    def _section(self, section: str, model: type[Section]) -> Section:
        """Return a section of the vehicle, merged key by key with `defaults`. Keys of the vehicle win."""
        layers: dict[str, Any] = {}
        own, common = getattr(self.own, section), getattr(self.common, section)
        for key, field in model.model_fields.items():
            layers[key], words = field.default, "default"
            for layer, path in (
                (common, ("defaults", section)),
                (own, ("vehicles", self.name, section)),
            ):
                if layer is not None and key in layer.model_fields_set:
                    inner = (*path, key)
                    place = inner if self.source.given(inner) else path
                    layers[key], words = getattr(layer, key), self.source.origin(place)
            self._note(f"{section}.{key}", layers[key], words)
        return model.model_construct(**layers)

    def _start(self) -> Start:
        layers: dict[str, Any] = {}
        for key in Start.model_fields:
            layers[key], words = Start.model_fields[key].default, "default"
            for layer, path in (
                (self.common.start, ("defaults", "start", key)),
                (self.own.start, ("vehicles", self.name, "start", key)),
            ):
                if layer is not None and key in layer.model_fields_set:
                    layers[key], words = getattr(layer, key), self.source.origin(path)
            self._note(f"start.{key}", layers[key], words)
        if (member := self.source.range_of(self.name)) is not None and layers["grid"] is not None:
            rule = f"rule: start.grid of {member.key}"
            layers["position"] = self._note(
                "start.position", place_in_grid(layers["position"], layers["grid"], member.index), rule
            )
        return Start.model_construct(**layers)  # each value is validated already

    def _px4_version(self, autopilot: Autopilot) -> str:
        """Return the PX4 version of a vehicle: from the SITL binary for `px4`, else from the YAML key `px4_version`."""
        if autopilot == "px4" and self.px4 is not None:
            return str(self._note("px4_version", self.px4.version, f"rule: {self.px4.words}"))
        return str(self._take("px4_version", ""))

    def _overrides(self) -> dict[str, Any]:
        """Return the mass and sensor noise that replace the profile's values. Keys of the vehicle win over `defaults`."""
        found: dict[str, Any] = {}
        if (mass := self._take("mass_kg", None, "default: the profile's")) is not None:
            found["mass_kg"] = mass
        for given, path in (
            (self.common.sensors, ("defaults", "sensors")),
            (self.own.sensors, ("vehicles", self.name, "sensors")),
        ):
            for sensor, values in (given or {}).items():
                for key, value in values.items():
                    origin = self.source.origin((*path, sensor, key))
                    self._note(f"sensors.{sensor}.{key}", value, origin)
                    found.setdefault("sensors", {}).setdefault(sensor, {})[key] = value
        return found

    def _own_params(self) -> dict[str, float]:
        """Return the user's PX4 parameters. Later sources win: `params_file`, `defaults`, `measured`, `params`."""
        found: dict[str, float] = {}
        if name := self._take("params_file", None):
            for key, value in self.params_files.get(name, {}).items():
                if key != "MAV_SYS_ID":
                    found[key] = self._note(f"params.{key}", value, str(name))
        here: YamlPath = ("vehicles", self.name)
        measured = {key: one.value for key, one in (self.own.measured or {}).items()}
        layers: tuple[tuple[Mapping[str, float] | None, YamlPath], ...] = (
            (self.common.params, ("defaults", "params")),
            (measured, (*here, "measured")),
            (self.own.params, (*here, "params")),
        )
        for given, path in layers:
            for key, value in (given or {}).items():
                found[key] = self._note(f"params.{key}", float(value), self.source.origin((*path, key)))
        return found

    def _program(self) -> Program | None:
        given = self._take("program", None)
        args = self._take("args", ())
        if given is None:
            return None
        path = (self.folder / given.path).absolute()
        return Program(
            path=str(path),
            args=(*given.args, *args),
            restart=given.restart,
            group=given.group or "",
            once=given.run == "once",
            needs=given.needs,
            clock=given.clock or ("simulation" if path.suffix == ".py" else "wall"),
        )

    def _tools(self) -> dict[str, Tool]:
        merged = {**(self.common.tools or {}), **(self.own.tools or {})}
        tools = {name: tool for name, tool in merged.items() if tool is not None}
        for name, tool in tools.items():
            layer = ("vehicles", self.name) if name in (self.own.tools or {}) else ("defaults",)
            self._note(f"tools.{name}", tool, self.source.origin((*layer, "tools", name)))
        return tools

    def _note(self, key: str, value: Any, words: str) -> Any:
        _note(self.origins, f"vehicles.{self.name}.{key}", value, words)
        return value


def _trace(origins: dict[str, Origin], source: Source, path: YamlPath, value: Any) -> None:
    """Record where every value of a YAML section comes from."""
    if isinstance(value, Strict):
        for key in type(value).model_fields:
            _trace(origins, source, (*path, key), getattr(value, key))
    elif isinstance(value, dict) and value:
        for key, each in value.items():
            _trace(origins, source, (*path, key), each)
    else:
        _note(origins, dotted(path), value, source.origin(path))


def _note(origins: dict[str, Origin], key: str, value: Any, words: str) -> None:
    plain = value.as_dict(json=True, without_none=True) if isinstance(value, Strict) else value
    origins[key] = Origin(value=plain, source=words)
