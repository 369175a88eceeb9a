"""`Job`, the input for planning one process, and functions for addresses of MAVLink links.

Pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from arena.plan.firmware import Firmware, Fleet
from arena.plan.model import LinkPlan
from arena.schema import Arena, Vehicle
from arena.schema.placeholders import filled

Json = dict[str, Any]
Address = list[Any]


@dataclass(frozen=True, kw_only=True)
class Job:
    """Input for planning one process: the arena, the vehicle or group of the process, and PX4 parameters.

    fleet: vehicle name -> PX4 parameters that the vehicle must have.
    python: path of the Python interpreter for arena's processes and `.py` programs.
    vehicle: vehicle that the process belongs to; None for a process of the whole arena.
    group: group whose programs run in the process; "" for all other processes.
    """

    arena: Arena
    fleet: Fleet
    python: str
    vehicle: Vehicle | None = None
    group: str = ""

    @property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """Return the vehicles of this program group, whose programs all run in this process."""
        return self.arena.groups[self.group]

    @property
    def v(self) -> Vehicle:
        """Return the vehicle of this process. Raises ValueError for a process without a vehicle."""
        if self.vehicle is None:
            raise ValueError(
                "cannot plan the process: got no vehicle, expected the vehicle that the process belongs to"
            )
        return self.vehicle

    @property
    def firmware(self) -> Firmware:
        """Required PX4 parameters of this process's vehicle.

        They are called firmware because they depend on the PX4 version.
        """
        return self.fleet[self.v.name]


def program_args(arena: Arena, v: Vehicle) -> tuple[str, ...]:
    """Return the arguments of a vehicle's program, with placeholders replaced by their values."""
    return tuple(filled(text, arena, v) for text in v.program.args) if v.program else ()


def link_of(arena: Arena, vehicle: Vehicle, name: str) -> LinkPlan:
    """Return both addresses of a MAVLink link: the autopilot's, and that of its partner, such as the router.

    name: router, vision (to the pose forwarder), panic (to land-all) or ground (to the router, for ground stations).
    """
    ports, partners = vehicle.ports, {"vision": "forwarder", "panic": "land_all"}
    return LinkPlan(
        autopilot_host=_autopilot_host(arena, vehicle),
        autopilot_port=getattr(ports, f"{name}_autopilot"),
        partner_host=arena.address,
        partner_port=getattr(ports, f"{name}_{partners.get(name, 'router')}"),
    )


def _autopilot_host(arena: Arena, vehicle: Vehicle) -> str:
    """Return the IP address from which an autopilot sends its datagrams.

    PX4 binds its sockets to 0.0.0.0. On the loopback network the kernel then always sends from 127.0.0.1.
    """
    return (
        "127.0.0.1" if flies_px4_sitl(arena, vehicle) and arena.address.startswith("127.") else arena.address
    )


def flies_px4_sitl(arena: Arena, vehicle: Vehicle) -> bool:
    """Return whether PX4's own SITL program flies the vehicle.

    False for arena's PX4 stand-in, the built-in autopilot and flight controllers.
    """
    return vehicle.autopilot == "px4" and arena.px4 is not None and not arena.px4.stand_in


def autopilot_ends(arena: Arena, vehicle: Vehicle) -> Json:
    """Return the addresses of an autopilot's MAVLink links: {link name: local and remote address}."""
    names = ("router", "vision", "panic", *(("ground",) if vehicle.has_ground_link else ()))
    links = {name: link_of(arena, vehicle, name) for name in names}
    return {
        name: {
            "local": [link.autopilot_host, link.autopilot_port],
            "remote": [link.partner_host, link.partner_port],
        }
        for name, link in links.items()
    }


def partner_end(link: LinkPlan) -> Json:
    """Return the `local` and `remote` address of a MAVLink link for the autopilot's partner, such as the router.

    This partner is the process at the other end of the link: the router, the pose forwarder or land-all.
    """
    return {
        "local": [link.partner_host, link.partner_port],
        "remote": [link.autopilot_host, link.autopilot_port],
    }
