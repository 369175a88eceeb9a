"""The input of every row of the process table, and the addresses of a vehicle's MAVLink links. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from arena.plan.firmware import Firmware, Fleet
from arena.plan.model import LinkPlan
from arena.schema import Arena, Vehicle

Json = dict[str, Any]
Address = list[Any]


@dataclass(frozen=True, kw_only=True)
class Job:
    """Input for the plan of one process.

    fleet: the firmware parameters of every vehicle.
    python: interpreter of arena's processes and of `.py` programs.
    vehicle: the vehicle of a process that each vehicle has; None for a process of the whole arena.
    """

    arena: Arena
    fleet: Fleet
    python: str
    vehicle: Vehicle | None = None

    @property
    def v(self) -> Vehicle:
        """The vehicle. Raises ValueError for a process of the whole arena."""
        if self.vehicle is None:
            raise ValueError("this process belongs to no vehicle")
        return self.vehicle

    @property
    def firmware(self) -> Firmware:
        """The firmware parameters of the vehicle."""
        return self.fleet[self.v.name]


def link_of(arena: Arena, vehicle: Vehicle, name: str) -> LinkPlan:
    """Return the addresses of one MAVLink link of a vehicle. name: router, vision or panic."""
    ports, partners = vehicle.ports, {"router": "router", "vision": "forwarder", "panic": "land_all"}
    return LinkPlan(
        autopilot_host=_autopilot_host(arena, vehicle),
        autopilot_port=getattr(ports, f"{name}_autopilot"),
        partner_host=arena.address,
        partner_port=getattr(ports, f"{name}_{partners[name]}"),
    )


def _autopilot_host(arena: Arena, vehicle: Vehicle) -> str:
    """Return the source address of an autopilot's datagrams.

    PX4 binds its sockets to no address: on the loopback the kernel sends from 127.0.0.1, whatever the partner's address.
    """
    return (
        "127.0.0.1" if flies_real_px4(arena, vehicle) and arena.address.startswith("127.") else arena.address
    )


def flies_real_px4(arena: Arena, vehicle: Vehicle) -> bool:
    """Return whether a PX4 binary flies the vehicle, not its stand-in."""
    return vehicle.autopilot == "px4" and arena.px4 is not None and not arena.px4.stand_in


def autopilot_ends(arena: Arena, vehicle: Vehicle) -> Json:
    """Return the autopilot's end of its three links: link name -> local and remote address."""
    links = {name: link_of(arena, vehicle, name) for name in ("router", "vision", "panic")}
    return {
        name: {
            "local": [link.autopilot_host, link.autopilot_port],
            "remote": [link.partner_host, link.partner_port],
        }
        for name, link in links.items()
    }


def partner_end(link: LinkPlan) -> Json:
    """Return the end of a link's fixed partner: local and remote address."""
    return {
        "local": [link.partner_host, link.partner_port],
        "remote": [link.autopilot_host, link.autopilot_port],
    }
