"""The `link` slice as frozen data."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arena.errors import InputError
from arena.transport import Address, ConnectionUrl, url_from_json


@dataclass(frozen=True, kw_only=True)
class Ends:
    """One of the vehicle's three links: local is ours, remote its fixed partner."""

    local: Address
    remote: Address


@dataclass(frozen=True, kw_only=True)
class Preflight:
    """What must hold before the vehicle may be armed.

    position_m, yaw_deg: farthest between captured pose and estimate.  pose_age_s, pose_rate_hz: of the poses that pass.
    battery: least charge 0..1, 0 for one that is not measured.  size_m: N, E, height of the arena [m].
    height_m: the body's lowest point below its origin [m].  poses: does a forwarder feed it?
    """

    position_m: float
    yaw_deg: float
    pose_age_s: float
    pose_rate_hz: float
    battery: float
    size_m: tuple[float, float, float]
    height_m: float
    poses: bool


@dataclass(frozen=True, kw_only=True)
class Settings:
    """simulator: the world's TCP address, for a controller in the loop.  params: what it must hold before arming.

    wire_file: where the vehicle's last address is kept for land-all; "" for nowhere.
    """

    vehicle: str
    id: int
    connection: ConnectionUrl
    links: Mapping[str, Ends]
    simulator: Address | None
    preflight: Preflight
    params: Mapping[str, float]
    params_file: str
    simulated: bool
    wire_file: str = ""

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Settings:
        """Raises InputError, naming what is missing or wrong: no gate is switched off by a value left out."""
        try:
            return cls(
                vehicle=str(raw["vehicle"]),
                id=int(raw["id"]),
                connection=_connection(raw["wire"]),
                links={
                    n: Ends(
                        local=_address(raw["links"][n]["local"]), remote=_address(raw["links"][n]["remote"])
                    )
                    for n in ("router", "vision", "panic")
                },
                simulator=_address(raw["simulator"]) if raw["simulator"] is not None else None,
                preflight=_preflight(raw["preflight"]),
                params={str(k): _finite(f"params.{k}", v) for k, v in raw["params"].items()},
                params_file=str(raw["params_file"]),
                simulated=bool(raw["simulated"]),
                wire_file=str(raw.get("wire_file", "")),
            )
        except (KeyError, TypeError) as error:
            what = f"{type(error).__name__} {error}"
            raise InputError(
                f"the link's slice is not complete: {what} (docs/architecture.md, Slices)"
            ) from error


def _connection(raw: Any) -> ConnectionUrl:
    try:
        return url_from_json(raw)
    except ValueError as error:
        raise InputError(f"the link's slice: wire: {error}") from error


def _preflight(raw: Mapping[str, Any]) -> Preflight:
    poses = bool(raw["poses"])
    needed = ("position_m", "yaw_deg", "pose_age_s", "pose_rate_hz")
    limits = {k: _above(f"preflight.{k}", raw[k]) if poses else 0.0 for k in needed}
    north, east, height = (_above("preflight.size_m", x) for x in raw["size_m"])
    return Preflight(
        **limits,
        battery=_finite("preflight.battery", raw["battery"] or 0.0),
        size_m=(north, east, height),
        height_m=_finite("preflight.height_m", raw["height_m"]),
        poses=poses,
    )


def _above(name: str, value: Any) -> float:
    number = _finite(name, value)
    if number <= 0.0:
        raise InputError(
            f"the link's slice: {name}: got {value!r}, expected a number above 0: a gate is not switched off by it"
        )
    return number


def _finite(name: str, value: Any) -> float:
    """The number as it is, so that whole ones stay whole."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"the link's slice: {name}: got {value!r}, expected a finite number")
    return value


def _address(raw: Any) -> Address:
    try:
        host, port = raw
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError as error:
        raise InputError(f"the link's slice: {raw!r} is not [numeric IPv4 host, port]: {error}") from error
