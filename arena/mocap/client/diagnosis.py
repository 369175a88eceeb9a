"""Why no pose comes from a motion-capture server, in a sentence that says what to do. Pure."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from arena.wire.natnet import ServerInfo

WELL = "motion capture is heard again"
_MOST_NAMES = 8


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What a receiver knows of its server. Everything is of the last seconds.

    closed: why there are no sockets yet, "" when there are; answered: what the server said of itself, None when it is silent;
    refused: it speaks a version that is not understood; streaming: frames come that are understood; garbled: frames come that
    are not; early: frames come from a server that does not answer; stranger: an address whose frames are not believed;
    names: the bodies it has; missing, twice, hidden: wanted bodies that it has not, has two of, does not track.
    """

    server: str
    command_port: int
    data_port: int
    transport: str
    group: str
    local: str
    closed: str = ""
    answered: ServerInfo | None = None
    refused: bool = False
    streaming: bool = False
    garbled: bool = False
    early: bool = False
    stranger: str = ""
    names: Collection[str] = ()
    missing: Sequence[str] = ()
    twice: Sequence[str] = ()
    hidden: Sequence[str] = ()


def sentence(c: Condition) -> str:
    """The first thing that keeps poses away; "" when nothing does."""
    if c.closed:
        return f"motion capture: no way to {c.server} yet ({c.closed}): is this computer in its network? Trying every second"
    if c.refused and c.answered is not None:
        return (
            f"motion capture: {c.server} speaks NatNet {_version(c.answered)}, and 3.0 to 4.2 are understood: "
            "choose one of these in its streaming settings"
        )
    if not c.streaming:
        return _no_frames(c) if c.answered is not None else _no_answer(c)
    return _no_body(c)


def _no_answer(c: Condition) -> str:
    said = f"motion capture: no answer from {c.server}:{c.command_port} (asked from {c.local})"
    if c.early:
        return f"{said}, though its frames arrive: is UDP {c.command_port} let through by the firewalls on both sides?"
    if c.stranger:
        return (
            f"{said}, and {c.stranger} streams to the same group: is that the server? Set mocap.server to it"
        )
    return (
        f"{said}: is mocap.server right, is streaming switched on there and bound to this network's interface, "
        f"and do the firewalls let UDP {c.command_port} through?"
    )


def _no_frames(c: Condition) -> str:
    if c.garbled and c.answered is not None:
        return (
            f"motion capture: {c.server} answers, but its frames are not laid out as NatNet {_version(c.answered)}, as it says: "
            "choose a version from 3.0 to 4.2 in its streaming settings"
        )
    if c.stranger:
        return (
            f"motion capture: {c.server} answers, but frames come from {c.stranger}, which is not believed: "
            "if that is the same computer, set mocap.server to it"
        )
    return f"motion capture: {c.server} answers, but no frame comes by {_way(c)}: {_advice(c)}"


def _advice(c: Condition) -> str:
    """By what the server says of its own streaming, where it says anything."""
    info = c.answered
    if info is not None and info.data_port:
        if info.group and c.transport == "unicast":
            return f"it streams by multicast to {info.group}:{info.data_port}. Set mocap.transport: multicast"
        if not info.group and c.transport == "multicast":
            return "it streams by unicast. Set mocap.transport: unicast, or multicast there"
        if info.group and info.group != c.group:
            return f"it streams to the group {info.group}. Set mocap.group to it"
        if info.data_port != c.data_port:
            return f"it streams to port {info.data_port}. Set mocap.data_port to it"
    return f"is it recording or live, and do the firewalls let UDP {c.data_port} through" + (
        " and the network multicast?" if c.transport == "multicast" else "?"
    )


def _no_body(c: Condition) -> str:
    if c.twice:
        return f"motion capture: {c.server} has two bodies called {_list(c.twice)}, so neither is believed: rename one there"
    if c.missing:
        there = f"it has {_list(sorted(c.names))}" if c.names else "it has no bodies at all"
        near = _near(c)
        return (
            f"motion capture: {c.server} streams, but has no body {_list(c.missing)}; {there}."
            f"{f' Perhaps you meant {near}?' if near else ''} Rename it there, or set the vehicle's mocap_body"
        )
    if c.hidden:
        return (
            f"motion capture: {c.server} streams, but does not track {_list(c.hidden)}: "
            "is it in view with all its markers, and switched on there?"
        )
    return ""


def _near(c: Condition) -> str:
    """The server's name that looks most like the first missing one, whatever its capitals."""
    plain = {name.lower(): name for name in sorted(c.names)}
    found = difflib.get_close_matches(c.missing[0].lower(), plain, n=1)
    return repr(plain[found[0]]) if found else ""


def _list(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:_MOST_NAMES])
    return shown + (f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else "")


def _way(c: Condition) -> str:
    return (
        f"multicast {c.group}:{c.data_port} on {c.local}"
        if c.transport == "multicast"
        else f"unicast to {c.local}"
    )


def _version(info: ServerInfo) -> str:
    return f"{info.version[0]}.{info.version[1]}"


class Complaint:
    """Says each trouble once, and once that it is over."""

    def __init__(self) -> None:
        self._told = ""

    def news(self, trouble: str) -> str | None:
        """What is to be told now, None when that has been told."""
        if trouble == self._told:
            return None
        self._told = trouble
        return trouble or WELL
