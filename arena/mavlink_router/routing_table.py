"""Addresses of vehicles and clients, read from the router's JSON configuration (slice)."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from arena.errors import InputError
from arena.transport import Address


@dataclass(frozen=True, kw_only=True)
class Link:
    """The two addresses of a link between the router and an autopilot.

    local: the router's address. remote: the autopilot's address.
    """

    local: Address
    remote: Address


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Addresses of one vehicle, and of the clients that receive only messages of this vehicle.

    id: MAVLink system id
    local, remote: the router's end and the autopilot's end of the router link
    ground: link that carries the messages of ground stations only; None: the router link carries them, too
    serve: address of the router for `clients`
    tools: address of the router to which any program on this computer may send
    sensors: address of the router for the measurements of the vehicle's emulated sensors; None: it has none
    simulated: a simulated vehicle is present when the arena starts; a real one may be switched on later
    needs_operator: send the heartbeat of a ground station only while an operator is present
    radio: a pilot has an RC transmitter
    """

    name: str
    id: int
    local: Address
    remote: Address
    serve: Address
    clients: tuple[Address, ...]
    tools: Address
    ground: Link | None = None
    sensors: Address | None = None
    simulated: bool = True
    needs_operator: bool = False
    radio: bool = True


@dataclass(frozen=True, kw_only=True)
class Table:
    """The routing table: addresses of all vehicles, their clients, and the ground stations.

    recorder: receives a copy of each datagram that the router passes on, in both directions: datagrams from a vehicle are sent to
        it from the vehicle's `serve` address, datagrams to a vehicle from its `tools` address. None: no copies.
    sensors: address of the process `sensors`, the only sender of measurements.
    heartbeat: send the heartbeat of a ground station, which PX4's data link failsafe monitors.
    aliases: address from which a ground station also sends -> its address in `gcs`. Only replays have one: a ground station that is
        bound to 0.0.0.0 sends from 127.0.0.1, also to a replay at another loopback address.
    """

    vehicles: tuple[Vehicle, ...]
    gcs_local: Address
    gcs: tuple[Address, ...]
    recorder: Address | None
    sensors: Address | None
    heartbeat: bool
    simulated: bool
    aliases: Mapping[Address, Address] = field(default_factory=dict)

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Table:
        """Read the routing table from the router's JSON configuration (slice).

        Raises InputError, which names the missing key or the wrong address.
        """
        try:
            return cls(
                vehicles=tuple(_vehicle(v) for v in raw["vehicles"]),
                gcs_local=_address(raw["gcs_local"]),
                gcs=tuple(_address(g["address"]) for g in raw["gcs"]),
                recorder=_address(raw["recorder"]) if raw.get("recorder") is not None else None,
                sensors=_address(raw["sensors"]) if raw.get("sensors") is not None else None,
                heartbeat=bool(raw["heartbeat"]),
                simulated=bool(raw["simulated"]),
                aliases={
                    _address(g["also_from"]): _address(g["address"]) for g in raw["gcs"] if "also_from" in g
                },
            )
        except (KeyError, TypeError) as error:
            missing = isinstance(error, KeyError)
            problem = f"the key {error} is missing" if missing else f"a value has the wrong type: {error}"
            raise InputError(
                f"configuration of the router: {problem} (docs/reference/slices.md lists the keys)"
            ) from error


def _vehicle(raw: Mapping[str, Any]) -> Vehicle:
    return Vehicle(
        name=str(raw["name"]),
        id=int(raw["id"]),
        local=_address(raw["link"]["local"]),
        remote=_address(raw["link"]["remote"]),
        ground=_link(raw["ground"]) if raw.get("ground") is not None else None,
        serve=_address(raw["serve"]),
        clients=tuple(_address(c["address"]) for c in raw["clients"]),
        tools=_address(raw["tools"]),
        sensors=_address(raw["sensors"]) if raw.get("sensors") is not None else None,
        simulated=bool(raw.get("simulated", True)),
        needs_operator=bool(raw.get("needs_operator", False)),
        radio=bool(raw.get("radio", True)),
    )


def _link(raw: Mapping[str, Any]) -> Link:
    return Link(local=_address(raw["local"]), remote=_address(raw["remote"]))


def _address(raw: Any) -> Address:
    """Convert an address in the router's configuration to (IPv4 address, port), and check it.

    Raises InputError for a host name, because each send would then wait for name resolution.
    """
    try:
        host, port = raw
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError as error:
        raise InputError(
            f"configuration of the router: got the address {raw!r}, expected [numeric IPv4 address, port]: {error}"
        ) from error
