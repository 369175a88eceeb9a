"""Model + source -> Arena: the one merge, defaults -> profile -> `defaults` -> vehicle -> `--set`, with the origin of each value.

Never fails: what is missing or wrong has been reported by `validate` or will be by `checks`, which judge the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from arena.schema.arena import Arena, Origin, Program, Px4, Vehicle
from arena.schema.loader import YamlPath, dotted
from arena.schema.models import ArenaFile, Start, Tool, VehicleKeys
from arena.schema.ports import MOST_ID, capture_group, vehicle_ports
from arena.schema.profile import Profile
from arena.schema.px4 import STAND_IN
from arena.schema.source import Source
from arena.schema.wires import Wire, read_url, serial_wire

DEFAULT_BAUD = 921_600
DEFAULT_PROFILE = "iris"
MOST_POSE_RATE_HZ = 60.0
_FORWARD_MS = 1.0
_RETURN_SHARE = 0.6  # of the room's height, up to which AUTO.RTL climbs

# What an arena without sticks and satellites needs of any PX4. Sources: PX4's parameter reference and its guide to external
# vision; land when setpoints stop (COM_OBL_RC_ACT 4, at once), no sticks (COM_RC_IN_MODE 4, COM_RCL_EXCEPT bit 2), a brisk
# take-off (MPC_TKO_RAMP_T 1 s of 3).
ARENA_PARAMS: Mapping[str, float] = {
    "COM_OBL_RC_ACT": 4, "COM_FAIL_ACT_T": 0.0, "MPC_TKO_RAMP_T": 1.0, "COM_RC_IN_MODE": 4, "COM_RCL_EXCEPT": 4, "SYS_HAS_GPS": 0,
}  # fmt: skip
# Noise: floors under the covariance that the forwarder sends. NOAID: a room is a second and a half long.
VISION_PARAMS: Mapping[str, float] = {
    "EKF2_EV_CTRL": 15, "EKF2_GPS_CTRL": 0, "EKF2_HGT_REF": 3, "EKF2_MAG_TYPE": 5,
    "EKF2_EVP_NOISE": 0.01, "EKF2_EVA_NOISE": 0.05, "EKF2_NOAID_TOUT": 1_000_000,
}  # fmt: skip

# How high AUTO.RTL climbs and where it waits before it lands, PX4's defaults [m]: in a room its ceiling comes first.
RETURN_HEIGHTS: Mapping[str, float] = {"RTL_RETURN_ALT": 30.0, "RTL_DESCEND_ALT": 10.0}

# With satellites: seen by all that asks for them. Where cameras are, EKF2 goes on flying by those alone (EKF2_GPS_CTRL 0).
GPS_PARAMS: Mapping[str, float] = {"SYS_HAS_GPS": 1}
# With a radio: PX4's own answer to its loss holds in OFFBOARD too; its sticks are channels 1 to 4.
STICKS_PARAMS: Mapping[str, float] = {
    "COM_RC_IN_MODE": 0, "COM_RCL_EXCEPT": 0, "RC_CHAN_CNT": 8, "RC_MAP_ROLL": 1, "RC_MAP_PITCH": 2, "RC_MAP_THROTTLE": 3,
    "RC_MAP_YAW": 4,
}  # fmt: skip


def resolve(
    model: ArenaFile,
    source: Source,
    profiles: Mapping[str, Profile],
    find_px4: Callable[[str | None], Px4 | None] = lambda home: None,
    params_files: Mapping[str, Mapping[str, float]] | None = None,
) -> Arena:
    """profiles: by the name that vehicles ask for; a name that is not in it falls back to the default, and `checks` says so.

    find_px4: asked once, when a vehicle may fly it.  params_files: what is in them, by the name that the YAML gives.
    """
    folder = Path(source.document.file).absolute().parent
    origins: dict[str, Origin] = {}
    for key in ("address", "world", "sim", "mocap", "preflight"):
        _trace(origins, source, (key,), getattr(model, key))
    name = model.name or _name_from(folder.name)
    served = model.mocap.source != "emulator"
    group = capture_group(model.address) if served else model.mocap.group or capture_group(model.address)
    server_group = model.mocap.group or capture_group(model.mocap.server or model.address)
    _note(origins, "name", name, source.origin(("name",)) if model.name else "the folder's name")
    _note(
        origins,
        "mocap.group",
        server_group if served else group,
        source.origin(("mocap", "group")) if model.mocap.group else "rule: from address",
    )
    ids = _ids(model.vehicles)
    wanted = {v.autopilot or model.defaults.autopilot or "auto" for v in model.vehicles.values()}
    px4 = find_px4(_home(model, folder)) if wanted & {"auto", "px4"} else None
    files = params_files or {}
    vehicles = tuple(
        _Merge(model, source, profiles, origins, v, folder, px4 is not None, files).vehicle(ids[v]) for v in model.vehicles
    )
    return Arena(
        name=name, file=source.document.file, folder=str(folder), address=model.address, world=model.world, sim=model.sim,
        mocap=model.mocap, group=group, server_group=server_group, preflight=model.preflight, tools=model.tools,
        vehicles=vehicles, px4=px4 if any(v.autopilot == "px4" for v in vehicles) else None, origins=origins,
    )  # fmt: skip


def _home(model: ArenaFile, folder: Path) -> str | None:
    """The YAML's folder, from where the YAML is; `stand-in` is a word and no folder."""
    home = model.px4.home
    return str(folder / Path(home).expanduser()) if home and home != STAND_IN else home


def _name_from(folder: str) -> str:
    kept = "".join(c if c.isalnum() or c in "_-." else "-" for c in folder if ord(c) < 128).strip("-._")
    return kept[:64] or "arena"


def _ids(vehicles: Mapping[str, VehicleKeys]) -> dict[str, int]:
    taken = {v.id for v in vehicles.values() if v.id is not None}
    free = iter(i for i in range(1, MOST_ID + len(vehicles) + 1) if i not in taken)
    return {name: v.id if v.id is not None else next(free) for name, v in vehicles.items()}


def pose_rate_hz(frame_rate_hz: float) -> float:
    """The highest rate up to 60 Hz that divides the frame rate."""
    return frame_rate_hz / math.ceil(frame_rate_hz / MOST_POSE_RATE_HZ - 1e-9)


class _Merge:
    """One vehicle's layers. Each `_take` notes where the value came from."""

    def __init__(self, model: ArenaFile, source: Source, profiles: Mapping[str, Profile], origins: dict[str, Origin],
                 name: str, folder: Path, has_px4: bool, params_files: Mapping[str, Mapping[str, float]]) -> None:  # fmt: skip
        self.model, self.source, self.profiles = model, source, profiles
        self.origins, self.name, self.folder, self.has_px4 = origins, name, folder, has_px4
        self.own, self.common = model.vehicles[name], model.defaults
        self.params_files = params_files

    def vehicle(self, vehicle_id: int) -> Vehicle:
        name, own = self.name, self.own
        wanted = self._take("profile", DEFAULT_PROFILE)
        profile = self.profiles.get(wanted, self.profiles[DEFAULT_PROFILE])
        ports = vehicle_ports(vehicle_id, own.port)
        self._own("id", vehicle_id, "rule: lowest free, in order of appearance")
        self._own("port", ports.program, "rule: 16000 + id")
        self._note("sdk_port", ports.sdk, "rule: port + 6000")
        asked = self._take("autopilot", "auto")
        autopilot = self._autopilot(asked)
        start = self._start()
        forward = bool(self._take("forward", True))
        gps, sticks = bool(self._take("gps", False)), bool(self._take("sticks", False))
        rate = self._take(
            "pose_rate_hz",
            pose_rate_hz(self.model.mocap.rate_hz),
            "default: the highest divisor of mocap.rate_hz up to 60",
        )
        return Vehicle(
            name=name, id=vehicle_id, profile=profile,
            profile_key=str((self.folder / wanted).absolute()) if wanted.endswith(".yaml") else wanted,
            autopilot=autopilot, asked=asked, wire=self._wire(autopilot), gps=gps, sticks=sticks, position=start.position,
            rpy_deg=start.rpy_deg, ports=ports, gcs=self._take("gcs", ()),
            params=self._params(profile, vehicle_id, {"forward": forward, "gps": gps, "sticks": sticks}, autopilot != "hardware"),
            mocap_body=self._own("mocap_body", own.mocap_body or name, "default: the vehicle's name"), forward=forward,
            pose_rate_hz=float(rate), program=self._program(), neighbours=self._take("neighbours", ()), tools=self._tools(),
        )  # fmt: skip

    def _autopilot(self, asked: str) -> Literal["builtin", "px4", "hardware", "hitl"]:
        if asked == "hardware":
            return "hardware"
        if asked == "hitl":
            return "hitl"
        return "px4" if self.has_px4 and asked in ("auto", "px4") else "builtin"

    def _wire(self, autopilot: str) -> Wire | None:
        """None too when what the YAML says of it is missing or wrong: `checks` tells."""
        if autopilot not in ("hardware", "hitl"):
            return None
        key = "url" if autopilot == "hardware" else "serial"
        given = self._own(key, getattr(self.own, key), "default")
        baud = self._own("baud", self.own.baud or DEFAULT_BAUD, "default")
        if given is None:
            return None
        try:
            return read_url(given, baud) if autopilot == "hardware" else serial_wire(given, baud)
        except ValueError:
            return None

    def _take(self, key: str, default: Any, words: str = "default") -> Any:
        """The vehicle's value, else that of `defaults`, else the default."""
        for layer, path in ((self.own, ("vehicles", self.name, key)), (self.common, ("defaults", key))):
            value = getattr(layer, key)
            if value is not None:
                return self._note(key, value, self.source.origin(path))
        return self._note(key, default, words)

    def _own(self, key: str, value: Any, words: str) -> Any:
        """A key that `defaults` cannot give."""
        path = ("vehicles", self.name, key)
        return self._note(key, value, self.source.origin(path) if self.source.given(path) else words)

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
        return Start(**layers)

    def _params(self, profile: Profile, vehicle_id: int, has: Mapping[str, bool], simulated: bool) -> dict[str, float]:
        """Of hardware those that the YAML asks for, and no others: they must hold before it arms."""
        layers = self._generated(profile, vehicle_id, has) if simulated else []
        if name := self._take("params_file", None):
            layers += [(k, v, str(name)) for k, v in self.params_files.get(name, {}).items() if k != "MAV_SYS_ID"]
        for given, path in (
            (self.common.params, ("defaults", "params")),
            (self.own.params, ("vehicles", self.name, "params")),
        ):
            layers += [(k, v, self.source.origin((*path, k))) for k, v in (given or {}).items()]
        for key, value, words in layers:
            self._note(f"params.{key}", value, words)
        return {key: float(value) for key, value, _ in layers}

    def _generated(self, profile: Profile, vehicle_id: int, has: Mapping[str, bool]) -> list[tuple[str, float, str]]:
        """What an arena needs of a simulated vehicle's autopilot: name, value, why."""
        delay_ms = self.model.mocap.latency_ms + _FORWARD_MS
        computed = {"MAV_SYS_ID": (vehicle_id, "rule: id"),
                    "MPC_THR_HOVER": (profile.hover_command, f"thrust curve of profile {profile.name}")}  # fmt: skip
        height = round(_RETURN_SHARE * self.model.world.size[2], 2)
        computed |= {k: (min(height, most), "under the ceiling: 0.6 of the room's height") for k, most in RETURN_HEIGHTS.items()}
        if has["forward"]:
            computed["EKF2_EV_DELAY"] = (delay_ms, "mocap.latency_ms + 1 ms of forwarding")
        layers: list[tuple[str, float, str]] = [(k, v, "arena's default") for k, v in ARENA_PARAMS.items()]
        layers += [(k, v, "arena's default with motion capture") for k, v in VISION_PARAMS.items() if has["forward"]]
        layers += [(k, v, "gps: true") for k, v in GPS_PARAMS.items() if has["gps"]]
        layers += [(k, v, "sticks: true") for k, v in STICKS_PARAMS.items() if has["sticks"]]
        layers += [(k, float(v), words) for k, (v, words) in computed.items()]
        return layers + [(k, v, f"profile {profile.name}") for k, v in profile.params.items()]

    def _program(self) -> Program | None:
        given = self._take("program", None)
        args = self._take("args", ())
        if given is None:
            return None
        path = (self.folder / given.path).absolute()
        return Program(path=str(path), args=(*given.args, *args), restart=given.restart)

    def _tools(self) -> dict[str, Tool]:
        tools = {**(self.common.tools or {}), **(self.own.tools or {})}
        for name, tool in tools.items():
            layer = ("vehicles", self.name) if name in (self.own.tools or {}) else ("defaults",)
            self._note(f"tools.{name}", tool, self.source.origin((*layer, "tools", name)))
        return tools

    def _note(self, key: str, value: Any, words: str) -> Any:
        _note(self.origins, f"vehicles.{self.name}.{key}", value, words)
        return value


def _trace(origins: dict[str, Origin], source: Source, path: YamlPath, value: Any) -> None:
    """Note every leaf of a section."""
    if isinstance(value, BaseModel):
        for key in type(value).model_fields:
            _trace(origins, source, (*path, key), getattr(value, key))
    else:
        _note(origins, dotted(path), value, source.origin(path))


def _note(origins: dict[str, Origin], key: str, value: Any, words: str) -> None:
    plain = value.model_dump(mode="json", exclude_none=True) if isinstance(value, BaseModel) else value
    origins[key] = Origin(value=plain, source=words)
