"""Every port of an arena, by rule. One table for the checks, the plan and the reference page."""

from __future__ import annotations

from dataclasses import dataclass

PROGRAM_BASE = 16000
SDK_ABOVE = 6000
LINK_BASE = 24000
COPILOT = LINK_BASE + 1
GROUND_STATION = 14550
MOST_ID = 250


@dataclass(frozen=True, kw_only=True)
class VehiclePorts:
    """UDP ports of one vehicle, all on the arena's address."""

    program: int
    sdk: int
    router_autopilot: int
    router_router: int
    vision_autopilot: int
    vision_forwarder: int
    panic_autopilot: int
    panic_land_all: int
    tools: int
    logger: int
    serve: int
    simulator: int


# field of VehiclePorts -> (who binds it, what it is); the order of the table is the order of the rule
WHAT: dict[str, tuple[str, str]] = {
    "program": ("the user's program", "the vehicle's MAVLink, from the router"),
    "sdk": ("an SDK", "the same"),
    "router_autopilot": ("the autopilot", "router link"),
    "router_router": ("the router", "router link"),
    "vision_autopilot": ("the autopilot", "vision link"),
    "vision_forwarder": ("the pose forwarder", "vision link"),
    "panic_autopilot": ("the autopilot", "panic link"),
    "panic_land_all": ("land-all", "panic link"),
    "tools": ("the router", "tools: any local client may speak here and is answered"),
    "logger": ("the logger", "its copy of the stream"),
    "serve": ("the router", "the socket that serves program, SDK and logger"),
    "simulator": ("the world", "PX4's simulator API, TCP"),
}

RULE: dict[str, str] = {
    "program": "16000 + id, or `port`",
    "sdk": "port + 6000",
    "router_autopilot": "24000 + 10 id",
    "router_router": "24000 + 10 id + 1",
    "vision_autopilot": "24000 + 10 id + 2",
    "vision_forwarder": "24000 + 10 id + 3",
    "panic_autopilot": "24000 + 10 id + 4",
    "panic_land_all": "24000 + 10 id + 5",
    "tools": "24000 + 10 id + 6",
    "logger": "24000 + 10 id + 7",
    "serve": "24000 + 10 id + 8",
    "simulator": "24000 + 10 id + 9",
}


def vehicle_ports(vehicle_id: int, port: int | None = None) -> VehiclePorts:
    """port: the program port when it is not the rule's."""
    program = PROGRAM_BASE + vehicle_id if port is None else port
    base = LINK_BASE + 10 * vehicle_id
    return VehiclePorts(
        program=program,
        sdk=program + SDK_ABOVE,
        router_autopilot=base,
        router_router=base + 1,
        vision_autopilot=base + 2,
        vision_forwarder=base + 3,
        panic_autopilot=base + 4,
        panic_land_all=base + 5,
        tools=base + 6,
        logger=base + 7,
        serve=base + 8,
        simulator=base + 9,
    )
