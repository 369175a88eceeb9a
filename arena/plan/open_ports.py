"""Every socket that a run has open, by its plan: what, where, and to whom it answers. Pure.

`listens` of a process are the ports that are its own. Doors are those and the rest: the multicast ports that receivers share, the
ephemeral ones that only ask or send (port 0), and the local sockets of the run's private folder.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from arena.mocap.vendors import SocketUse, vendor_settings
from arena.plan.model import Plan, ProcessSpec

_HERE = "this computer alone"
_NAMED = "the addresses that the YAML names"
_PARTNER = "its fixed partner alone"
# kind of process -> the words of its Listen begin with -> who is answered, or obeyed
_ANSWERS: dict[str, dict[str, str]] = {
    "world": {"": f"commands from {_HERE}", "simulator API": f"PX4s of {_HERE}"},
    "px4": {"": "whoever speaks to it: PX4 binds its links on every address; let the firewall close them"},
    "link": {
        "": _PARTNER,
        "panic link": f"commands from {_HERE}",
        "the wire": "the first address that speaks as this vehicle",
    },
    "forward": {"": _PARTNER},
    "router": {"": _PARTNER, "tools": _HERE, "programs": _NAMED, "ground stations": _NAMED},
    "logger": {"": "nobody: it listens"},
    "copilot": {
        "": "nobody: it counts the programs' heartbeats, and hears vehicles through the router alone"
    },
    "program": {"": "the vehicle's router; what else, the program decides"},
    "task": {"": _PARTNER},
    "tool": {"": "what the tool decides"},
}


@dataclass(frozen=True, kw_only=True)
class Door:
    """process: whose.  address: a numeric host, or for `unix` the path.  port 0: whichever the kernel gives.

    what, who: for a person; who is answered, or obeyed.  always: open as long as the process serves.
    interface: of a multicast group, where it is joined.
    """

    process: str
    protocol: Literal["udp", "tcp", "unix"]
    address: str
    port: int
    what: str
    who: str
    always: bool = True
    interface: str = ""

    @property
    def closed(self) -> bool:
        """Does nobody on another computer reach it?"""
        return self.protocol == "unix" or (self.interface or self.address).startswith("127.")


def doors(plan: Plan) -> tuple[Door, ...]:
    """Of every process of the plan but those that are the user's own tools, and of the supervisor."""
    control = Door(
        process="supervisor",
        protocol="unix",
        address="{rt}/control.sock",
        port=0,
        what="arena ps, restart, down",
        who="the owner and root",
    )
    return (control, *itertools.chain.from_iterable(_doors_of(plan, spec) for spec in plan.processes))


def open_lines(plan: Plan) -> list[str]:
    """A line for each thing that other computers reach; ports of the same kind share one."""
    found = [door for door in doors(plan) if not door.closed and door.port]
    lines: dict[tuple[str, str, str, str], list[Door]] = {}
    for door in found:
        what = door.what.partition(" of ")[0]
        lines.setdefault((door.protocol, door.address, what, door.who), []).append(door)
    return [
        f"open: {protocol} {address}:{_ports(same)} {what} ({_names(same)}) answers {who}"
        for (protocol, address, what, who), same in lines.items()
    ]


def _ports(same: list[Door]) -> str:
    ports = sorted({door.port for door in same})
    return ",".join(map(str, ports)) if len(ports) <= 4 else f"{ports[0]}..{ports[-1]}[{len(ports)}]"


def _names(same: list[Door]) -> str:
    names = sorted({door.process for door in same})
    return ", ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more"


def _doors_of(plan: Plan, spec: ProcessSpec) -> Iterator[Door]:
    slice_ = plan.slices.get(f"{spec.name}.json", {})
    for x in spec.listens if spec.kind != "mocap" else ():
        known = _ANSWERS.get(spec.kind, {"": "?"})
        who = next((words for begin, words in known.items() if begin and x.what.startswith(begin)), known[""])
        yield Door(
            process=spec.name, protocol=x.protocol, address=x.address, port=x.port, what=x.what, who=who
        )
    for capture in _captures(slice_):
        yield from _receiver(spec, capture)
    if spec.kind == "mocap":
        for used in vendor_settings(slice_["kind"]).server_sockets(slice_):
            yield _door(spec, used)
    if slice_.get("heart"):
        yield Door(
            process=spec.name,
            protocol="udp",
            address=plan.address,
            port=0,
            what="heartbeats leave",
            who="nobody: it sends",
        )
    if spec.kind == "world":
        yield _local(spec, "{rt}/clock.sock", "the simulation clock")
    if slice_.get("faults"):
        yield _local(spec, str(slice_["faults"]), "faults on purpose")


def _captures(slice_: dict[str, Any]) -> list[dict[str, Any]]:
    """Of any room: one, several, or none."""
    found = slice_.get("captures", slice_.get("capture"))
    return [found] if isinstance(found, dict) else list(found or ())


def _receiver(spec: ProcessSpec, capture: dict[str, Any]) -> Iterator[Door]:
    for used in vendor_settings(capture["kind"]).client_sockets(capture):
        yield _door(spec, used)


def _door(spec: ProcessSpec, used: SocketUse) -> Door:
    return Door(
        process=spec.name,
        protocol=used.protocol,
        address=used.address,
        port=used.port,
        what=used.what,
        who=used.peer,
        always=used.always,
        interface=used.interface,
    )


def _local(spec: ProcessSpec, path: str, what: str) -> Door:
    return Door(process=spec.name, protocol="unix", address=path, port=0, what=what, who="the owner")
