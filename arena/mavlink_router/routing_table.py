"""The addresses of vehicles and clients: the router's slice of the plan as frozen data."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arena.errors import InputError
from arena.transport import Address


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle and the clients that receive only this vehicle.

    id: MAVLink system id
    local, remote: the two ends of the router link, ours and the autopilot's
    serve: our address towards `clients` and `logger`
    tools: our address that any program on this computer may send to
    simulated: a simulated vehicle is present when the arena starts; a real one may be switched on later
    """

    name: str
    id: int
    local: Address
    remote: Address
    serve: Address
    clients: tuple[Address, ...]
    logger: Address | None
    tools: Address
    simulated: bool = True


@dataclass(frozen=True, kw_only=True)
class Table:
    """All vehicles and ground stations. heartbeat: send a ground station's heartbeat, which PX4's data link failsafe watches."""

    vehicles: tuple[Vehicle, ...]
    gcs_local: Address
    gcs: tuple[Address, ...]
    heartbeat: bool
    simulated: bool

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Table:
        """Read the router's slice. Raises InputError that names the missing key or the wrong address."""
        try:
            return cls(
                vehicles=tuple(_vehicle(v) for v in raw["vehicles"]),
                gcs_local=_address(raw["gcs_local"]),
                gcs=tuple(_address(g["address"]) for g in raw["gcs"]),
                heartbeat=bool(raw["heartbeat"]),
                simulated=bool(raw["simulated"]),
            )
        except (KeyError, TypeError) as error:
            raise InputError(f"the router's slice is not complete: {type(error).__name__} {error}") from error


def _vehicle(raw: Mapping[str, Any]) -> Vehicle:
    return Vehicle(
        name=str(raw["name"]),
        id=int(raw["id"]),
        local=_address(raw["link"]["local"]),
        remote=_address(raw["link"]["remote"]),
        serve=_address(raw["serve"]),
        clients=tuple(_address(c["address"]) for c in raw["clients"]),
        logger=_address(raw["logger"]) if raw["logger"] is not None else None,
        tools=_address(raw["tools"]),
        simulated=bool(raw.get("simulated", True)),
    )


def _address(raw: Any) -> Address:
    """Return an address. Refuses a host name: each message would look it up and block."""
    try:
        host, port = raw
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError as error:
        raise InputError(f"the router's slice: {raw!r} is not [numeric IPv4 host, port]: {error}") from error
