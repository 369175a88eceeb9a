"""Sentence for the user about why no poses arrive from a NatNet server, and what to check. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.mocap.client.diagnosis import no_network, no_pose
from arena.mocap.client.reception import BodyStatus
from arena.mocap.natnet.codec import ServerInfo


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Observations of a NatNet client in the last seconds, from which `diagnose` finds why no poses arrive.

    no_network: reason why no socket is open, "" if the sockets are open.
    answered: the server's description of itself, None if the server has not answered.
    version_unsupported: the server uses a NatNet version that cannot be decoded.
    streaming: frames arrive and can be decoded. malformed: frames arrive but cannot be decoded.
    early: frames arrive from a server that does not answer requests.
    foreign: address that sends frames but is not the server's, "" if there is none.
    """

    server: str
    command_port: int
    data_port: int
    transport: str
    group: str
    local: str
    no_network: str = ""
    answered: ServerInfo | None = None
    version_unsupported: bool = False
    streaming: bool = False
    malformed: bool = False
    early: bool = False
    foreign: str = ""
    bodies: BodyStatus = field(default_factory=BodyStatus)


def diagnose(c: Condition) -> str:
    """Return a sentence about why no poses arrive and what to check; "" if poses arrive."""
    if c.no_network:
        return no_network(c.server, c.no_network)
    if c.version_unsupported and c.answered is not None:
        return (
            f"motion capture: {c.server} uses NatNet {_version(c.answered)}, supported are 3.0 to 4.2: "
            "choose one of these in the server's streaming settings"
        )
    if not c.streaming:
        return _no_frames(c) if c.answered is not None else _no_answer(c)
    return no_pose(c.server, c.bodies)


def _no_answer(c: Condition) -> str:
    start = f"motion capture: no answer from {c.server}:{c.command_port} (requested from {c.local})"
    if c.early:
        return (
            f"{start}, though its frames arrive: is UDP {c.command_port} open in the firewalls on both sides?"
        )
    if c.foreign:
        return f"{start}, and {c.foreign} streams to the same group: if this is the server, set mocap.server to this address"
    return (
        f"{start}: is mocap.server right, is streaming enabled on the server and bound to the interface of this network, "
        f"and do the firewalls let UDP {c.command_port} through?"
    )


def _no_frames(c: Condition) -> str:
    if c.malformed and c.answered is not None:
        return (
            f"motion capture: {c.server} answers, but its frames do not have the layout of NatNet {_version(c.answered)} "
            f"that it announces: choose a version from 3.0 to 4.2 in the server's streaming settings"
        )
    if c.foreign:
        return (
            f"motion capture: {c.server} answers, but frames come from {c.foreign} and are dropped: "
            "if this is another address of the same computer, set mocap.server to it"
        )
    way = (
        f"multicast {c.group}:{c.data_port} on {c.local}"
        if c.transport == "multicast"
        else f"unicast to {c.local}"
    )
    return f"motion capture: {c.server} answers, but no frame arrives by {way}: {_advice(c)}"


def _advice(c: Condition) -> str:
    """Return advice for the user when the server answers but no frames arrive.

    The advice follows from the streaming mode, address and port that the server reports.
    """
    info = c.answered
    if info is not None and info.data_port:
        if info.group and c.transport == "unicast":
            return f"the server streams by multicast to {info.group}:{info.data_port}. Set mocap.transport: multicast"
        if not info.group and c.transport == "multicast":
            return "the server streams by unicast. Set mocap.transport: unicast, or select multicast on the server"
        if info.group and info.group != c.group:
            return f"the server streams to the group {info.group}. Set mocap.group: {info.group}"
        if info.data_port != c.data_port:
            return f"the server streams to port {info.data_port}. Set mocap.data_port: {info.data_port}"
    return f"is the server live or recording, and do the firewalls let UDP {c.data_port} through" + (
        " and the network multicast?" if c.transport == "multicast" else "?"
    )


def _version(info: ServerInfo) -> str:
    return f"{info.version[0]}.{info.version[1]}"
