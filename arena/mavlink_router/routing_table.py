"""Who speaks from where: the router's slice of the plan as frozen data."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arena.errors import InputError

Address = tuple[str, int]


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One vehicle and those who listen to it alone.

    id: its system id.  local, remote: the router link, our end and the autopilot's fixed end.
    serve: where we speak to `clients` and `logger` from.  tools: where any local client may speak to us.
    simulated: it is there when the arena starts; a real one may be switched on later.
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
    """heartbeat: speak as the ground station that the vehicles' data link failsafe watches."""

    vehicles: tuple[Vehicle, ...]
    gcs_local: Address
    gcs: tuple[Address, ...]
    heartbeat: bool
    simulated: bool

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Table:
        """Raises InputError, naming what is missing or is no address."""
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
    """A numeric host: a name would be looked up, and block, at every message."""
    try:
        host, port = raw
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError as error:
        raise InputError(f"the router's slice: {raw!r} is not [numeric IPv4 host, port]: {error}") from error
