"""Port table: every port of an arena, the rule for its number, and the processes that open it.

It also contains the senders that each process accepts.

The checks, the plan, `arena check`, `arena doctor` and docs/reference/ports.md are made from `PORTS`. Ports of motion
capture are in the table of vendors, `arena.mocap.vendors`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from arena.constants import MONITOR_PORT

PROGRAM_BASE = 16000
SDK_ABOVE = 6000
LINK_BASE = 24000
GROUND_BASE = 27000
COPILOT, RECORDER, SENSORS = LINK_BASE + 1, LINK_BASE + 2, LINK_BASE + 3
GROUND_STATION = 14550


@dataclass(frozen=True, kw_only=True)
class VehiclePorts:
    """Port numbers of one vehicle on the arena's address. `PORTS` explains the use of each port."""

    program: int
    sdk: int
    router_autopilot: int
    router_router: int
    vision_autopilot: int
    vision_forwarder: int
    panic_autopilot: int
    panic_land_all: int
    tools: int
    sensors_router: int
    serve: int
    simulator: int
    ground_autopilot: int
    ground_router: int


@dataclass(frozen=True, kw_only=True)
class Binder:
    """Kind of process that opens (binds) a port, and the senders that it accepts there.

    kind: kind of process, such as `router`.
    answers: text that names the senders from which this process accepts datagrams.
    autopilots: the process binds the port only for vehicles with these autopilots; () for all vehicles.
    """

    kind: str
    answers: str
    autopilots: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Port:
    """Kind of port: its number, its use, and the processes that open it.

    It is a row of the port table.

    key: field of `VehiclePorts`, or the name of a port that the arena has once.
    rule: rule for the number, as text: `24000 + 10 id + 2`.
    name: short name in plans and messages.
    owner: name of the program that binds the port, for people.
    use: what the port is for.
    per_vehicle: whether each vehicle has such a port; false: the arena has one.
    base, step: number = base + step * id; None if the number follows another rule.
    binders: arena's processes that bind the port; () if a program outside the arena binds it.
    """

    key: str
    rule: str
    name: str
    owner: str
    use: str
    per_vehicle: bool = True
    base: int | None = None
    step: int = 10
    protocol: Literal["udp", "tcp"] = "udp"
    binders: tuple[Binder, ...] = ()

    def binder(self, kind: str) -> Binder | None:
        """Return the `Binder` of one kind of process, such as `router`. None if that process does not open this port."""
        return next((binder for binder in self.binders if binder.kind == kind), None)


MONITOR = "monitor page"
MONITOR_ANSWERS = (
    "browsers of the same user and of root; at an address other than loopback: browsers with the token"
)
_THIS_COMPUTER = "this computer only"
_YAML_ADDRESSES = "the addresses that the YAML names"
_PARTNER = "its fixed partner only"
_COMMANDS = f"commands from {_THIS_COMPUTER}"
_ANY_SENDER = "any sender, because PX4 binds its links on every address; block them with a firewall"


def _link(offset: int, key: str, owner: str, name: str, *binders: Binder, use: str = "") -> Port:
    rule = f"24000 + 10 id{f' + {offset}' if offset else ''}"
    return Port(
        key=key, rule=rule, name=name, owner=owner, use=use or name, base=LINK_BASE + offset, binders=binders
    )


def _ground_link(offset: int, key: str, owner: str, use: str, *binders: Binder) -> Port:
    return Port(
        key=key,
        rule=f"27000 + 2 id{f' + {offset}' if offset else ''}",
        name="ground station link",
        owner=owner,
        use=use,
        base=GROUND_BASE + offset,
        step=2,
        binders=binders,
    )


def _autopilot_end(offset: int, key: str, name: str, *, link_answers: str = _PARTNER) -> Port:
    return _link(
        offset,
        key,
        "the autopilot",
        name,
        Binder(kind="world", answers=_COMMANDS, autopilots=("builtin",)),
        Binder(kind="px4", answers=_ANY_SENDER),
        Binder(kind="link", answers=link_answers),
    )


PORTS: tuple[Port, ...] = (
    Port(
        key="program",
        rule="16000 + id, or `port`",
        name="MAVLink",
        owner="the user's program",
        use="the vehicle's MAVLink, from the router",
        binders=(Binder(kind="program", answers="the vehicle's router; the program may answer others too"),),
    ),
    Port(key="sdk", rule="port + 6000", name="SDK", owner="an SDK", use="the vehicle's MAVLink, for an SDK"),
    _autopilot_end(0, "router_autopilot", "router link"),
    _link(1, "router_router", "the router", "router link", Binder(kind="router", answers=_PARTNER)),
    _autopilot_end(2, "vision_autopilot", "vision link"),
    _link(
        3, "vision_forwarder", "the pose forwarder", "vision link", Binder(kind="forward", answers=_PARTNER)
    ),
    _autopilot_end(4, "panic_autopilot", "panic link", link_answers=_COMMANDS),
    _link(5, "panic_land_all", "land-all", "panic link", Binder(kind="task", answers=_PARTNER)),
    _link(
        6,
        "tools",
        "the router",
        "tools",
        Binder(kind="router", answers=_THIS_COMPUTER),
        use="MAVLink for any client on this computer",
    ),
    _link(
        7,
        "sensors_router",
        "the router",
        "sensors",
        Binder(kind="router", answers="the process `sensors` only"),
        use="messages of the emulated relative sensors",
    ),
    _link(
        8,
        "serve",
        "the router",
        "programs",
        Binder(kind="router", answers=_YAML_ADDRESSES),
        use="the router's socket for program and SDK",
    ),
    Port(
        key="simulator",
        rule="24000 + 10 id + 9",
        name="simulator API",
        owner="the world",
        use="PX4's simulator API, TCP",
        base=LINK_BASE + 9,
        protocol="tcp",
        binders=(Binder(kind="world", answers=f"PX4s of {_THIS_COMPUTER}", autopilots=("px4", "hitl")),),
    ),
    _ground_link(
        0,
        "ground_autopilot",
        "the autopilot",
        "second MAVLink link of a simulated vehicle, with PX4's streams for ground stations",
        Binder(kind="world", answers=_COMMANDS, autopilots=("builtin",)),
        Binder(kind="px4", answers=_ANY_SENDER),
    ),
    _ground_link(
        1,
        "ground_router",
        "the router",
        "the router's end of this link",
        Binder(kind="router", answers=_PARTNER),
    ),
    Port(
        key="wire",
        rule="`url`",
        name="flight controller",
        owner="the hardware link",
        use="MAVLink of a hardware vehicle with a `udpin` URL",
        binders=(Binder(kind="link", answers="the first address that sends as this vehicle"),),
    ),
    Port(
        key="ground_stations",
        rule=str(LINK_BASE),
        name="ground stations",
        owner="the router",
        use="the router's socket for ground stations",
        per_vehicle=False,
        binders=(Binder(kind="router", answers=_YAML_ADDRESSES),),
    ),
    Port(
        key="recorder",
        rule=str(RECORDER),
        name="record",
        owner="the recorder",
        use="copies of all MAVLink messages that the router passes on; references and planned paths that programs publish",
        per_vehicle=False,
        binders=(Binder(kind="recorder", answers="no one: it only receives"),),
    ),
    Port(
        key="copilot",
        rule=str(COPILOT),
        name="heartbeats of programs",
        owner="the copilot",
        use="heartbeats of programs; the copilot sends to the tools ports from here",
        per_vehicle=False,
        binders=(
            Binder(
                kind="copilot", answers="no one: it counts heartbeats; vehicles reach it through the router"
            ),
        ),
    ),
    Port(
        key="sensors",
        rule=str(SENSORS),
        name="emulated sensors",
        owner="the process `sensors`",
        use="telemetry to the emulated relative sensors, and their measurements to the router; only in arenas with such sensors",
        per_vehicle=False,
        binders=(Binder(kind="sensors", answers="no one: it receives telemetry from the router"),),
    ),
    Port(
        key="foxglove",
        rule="8765, or `log.foxglove.port`",
        name="Foxglove",
        owner="the recorder",
        use="WebSocket for Foxglove, TCP; only with `log.foxglove`",
        per_vehicle=False,
        protocol="tcp",
        binders=(Binder(kind="recorder", answers="anyone who reaches its address; it accepts no commands"),),
    ),
    Port(
        key="monitor",
        rule=f"{MONITOR_PORT}, or the next free one",
        name=MONITOR,
        owner="the monitor",
        use="page of `arena monitor` and `tools: {monitor: true}`, TCP",
        per_vehicle=False,
        protocol="tcp",
        binders=(Binder(kind="tool", answers=MONITOR_ANSWERS),),
    ),
    Port(
        key="ground_station",
        rule=str(GROUND_STATION),
        name="ground station",
        owner="a ground station",
        use="all vehicles",
        per_vehicle=False,
    ),
)


def vehicle_ports(vehicle_id: int, port: int | None = None) -> VehiclePorts:
    """Return the port numbers of a vehicle, computed from its id by the rules in `PORTS`.

    port: the vehicle's `port` in the YAML, or None.
    """
    program = PROGRAM_BASE + vehicle_id if port is None else port
    by_rule = {row.key: row.base + row.step * vehicle_id for row in PORTS if row.base is not None}
    return VehiclePorts(program=program, sdk=program + SDK_ABOVE, **by_rule)
