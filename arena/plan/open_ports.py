"""List of all sockets that a run opens, and of the senders that each socket accepts. Pure.

The list is made from the plan. The list contains the ports of `arena.schema.ports.PORTS`, multicast ports
that receivers share, ports that the kernel chooses for requests (port 0), and the Unix sockets in the run's
private folder.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from arena.constants import MONITOR_PORT
from arena.mocap.vendors import VENDORS, SocketUse, vendor_settings
from arena.plan.model import Plan, ProcessSpec
from arena.schema.ports import MONITOR, MONITOR_ANSWERS, PORTS

MONITOR_COMMAND, LOOPBACK = ("-m", "arena", "monitor"), "127.0.0.1"
# (process kind, short name of the port) -> the senders that are accepted
_ANSWERS = {(binder.kind, port.name): binder.answers for port in PORTS for binder in port.binders}


@dataclass(frozen=True, kw_only=True)
class OpenSocket:
    """A socket that a run opens: its process, address, purpose and accepted senders.

    process: name of the process that opens the socket.
    address: numeric host address; for a `unix` socket its path.
    port: port number; 0 if the kernel chooses it.
    what: what the socket is for.
    who: text that names the accepted senders.
    always: whether the socket is open as long as the process runs.
    interface: address of the interface that joins a multicast group.
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
    def local(self) -> bool:
        """True if programs on other computers cannot reach the socket."""
        return self.protocol == "unix" or (self.interface or self.address).startswith("127.")


def open_sockets(plan: Plan) -> tuple[OpenSocket, ...]:
    """Return the sockets of the supervisor and of every process of the plan, except the user's tools."""
    control = OpenSocket(
        process="supervisor",
        protocol="unix",
        address="{rt}/control.sock",
        port=0,
        what="arena ps, restart, down",
        who="the owner and root",
    )
    return (control, *itertools.chain.from_iterable(_sockets_of(plan, spec) for spec in plan.processes))


def open_lines(plan: Plan) -> list[str]:
    """Return the lines `open: ...` for the user, which list all sockets that other computers can reach.

    Ports for the same use are in one line.
    """
    found = [opened for opened in open_sockets(plan) if not opened.local and opened.port]
    lines: dict[tuple[str, str, str, str], list[OpenSocket]] = {}
    for opened in found:
        what = opened.what.partition(" of ")[0]
        lines.setdefault((opened.protocol, opened.address, what, opened.who), []).append(opened)
    return [
        f"open: {protocol} {address}:{_ports(same)} {what} ({_names(same)}) answers {who}"
        for (protocol, address, what, who), same in lines.items()
    ]


def _ports(same: list[OpenSocket]) -> str:
    ports = sorted({opened.port for opened in same})
    return ",".join(map(str, ports)) if len(ports) <= 4 else f"{ports[0]}..{ports[-1]}[{len(ports)}]"


def _names(same: list[OpenSocket]) -> str:
    names = sorted({opened.process for opened in same})
    return ", ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more"


def _sockets_of(plan: Plan, spec: ProcessSpec) -> Iterator[OpenSocket]:
    parts = [(spec.name, spec.kind), *((member.name, member.kind) for member in spec.members)]
    servers = [used for name, kind in parts if kind == "mocap" for used in _server_sockets(plan, name)]
    of_vendor = {used.what for used in servers}
    for x in spec.listens:
        if x.what in of_vendor:
            continue
        names = (x.what, x.what.partition(" of ")[0])
        found = (_ANSWERS.get((kind, name)) for _, kind in parts for name in names)
        who = next((who for who in found if who is not None), "?")
        yield OpenSocket(
            process=spec.name, protocol=x.protocol, address=x.address, port=x.port, what=x.what, who=who
        )
    for used in servers:
        yield _vendor_socket(spec, used)
    for name, _ in parts if spec.is_program or not spec.members else ():
        for capture in _captures(plan.slices.get(f"{name}.json", {})):
            for used in vendor_settings(capture["kind"]).client_sockets(capture):
                yield _vendor_socket(spec, used)
    for name, kind in parts:
        yield from _other_sockets(plan, spec, kind, plan.slices.get(f"{name}.json", {}))


def _server_sockets(plan: Plan, name: str) -> Iterator[SocketUse]:
    slice_ = plan.slices[f"{name}.json"]
    yield from vendor_settings(slice_["kind"]).server_sockets(slice_)


def _other_sockets(plan: Plan, spec: ProcessSpec, kind: str, slice_: dict[str, Any]) -> Iterator[OpenSocket]:
    """Yield the sockets that are neither in the table `PORTS` nor for motion capture, such as Unix sockets.

    These are Unix sockets, and UDP sockets that only send.

    kind, slice_: kind and configuration of the process, or of one member that runs inside the process.
    """
    if kind == "program" and slice_.get("heartbeat"):
        yield OpenSocket(
            process=spec.name,
            protocol="udp",
            address=plan.address,
            port=0,
            what="heartbeats, sent",
            who="no one: it only sends",
        )
    if kind == "tool" and spec.argv[1:4] == MONITOR_COMMAND:
        host, port = (_option(spec.argv, name) for name in ("--host", "--port"))
        yield OpenSocket(
            process=spec.name,
            protocol="tcp",
            address=host or LOOPBACK,
            port=int(port or MONITOR_PORT),
            what=MONITOR,
            who=MONITOR_ANSWERS,
        )
    if kind == "world":
        yield _local(spec, "{rt}/clock.sock", "the simulation clock")
    if slice_.get("faults"):
        yield _local(spec, str(slice_["faults"]), "fault injection")


def _option(argv: Sequence[str], name: str) -> str:
    """Return the value of an option in a command line; "" if the option is missing."""
    return next((value for key, value in itertools.pairwise(argv) if key == name), "")


def _captures(slice_: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the settings of all motion-capture receivers in a configuration file (slice)."""
    found = slice_.get("captures", slice_.get("capture"))
    captures = [found] if isinstance(found, dict) else list(found or ())
    return [each for each in captures if each["kind"] in VENDORS]


def _vendor_socket(spec: ProcessSpec, used: SocketUse) -> OpenSocket:
    return OpenSocket(
        process=spec.name,
        protocol=used.protocol,
        address=used.address,
        port=used.port,
        what=used.what,
        who=used.peer,
        always=used.always,
        interface=used.interface,
    )


def _local(spec: ProcessSpec, path: str, what: str) -> OpenSocket:
    return OpenSocket(process=spec.name, protocol="unix", address=path, port=0, what=what, who="the owner")
