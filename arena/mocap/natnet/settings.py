"""NatNet settings of the client and of the emulated server, converted from the YAML, and their sockets.

Pure.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from typing import Any

from arena.errors import InputError
from arena.mocap.vendors import Settings, SocketUse

COMMAND_PORT, DATA_PORT = 1510, 1511
GROUP = "239.255.42.99"
PORTS = {
    "command_port": "the motion capture's commands",
    "data_port": "the motion capture's data",
}


def group_for(address: str) -> str:
    """Return the default multicast group of a server at this address.

    Servers on different loopback addresses get different groups, so that two arenas on one computer do not
    receive each other's frames.
    """
    a, b, c, d = (int(part) for part in address.split("."))
    if a != 127 or (b, c, d) == (0, 0, 1):
        return GROUP
    return f"239.{192 + b % 64}.{c}.{d}"


def derived_keys(keys: Settings, address: str) -> dict[str, Any]:
    server = keys["server"] if keys["source"] == "natnet" else None
    return {"group": keys["group"] or group_for(server or address)}


def problems(keys: Settings) -> Iterator[tuple[str, str]]:
    group = keys["group"]
    if group is None or keys["transport"] != "multicast" or ipaddress.IPv4Address(group).is_multicast:
        return
    yield "group", f"got {group}, expected a multicast address. Try {GROUP}."


def client_settings(keys: Settings) -> dict[str, Any]:
    return {
        "kind": "natnet",
        "server": keys["server"],
        "local": keys["local"],
        "group": keys["group"] or group_for(keys["server"]),
        **_common(keys),
    }


def emulator_client_settings(keys: Settings, address: str) -> dict[str, Any]:
    group = _emulator_group(keys, address)
    return {"kind": "natnet", "server": address, "local": address, "group": group, **_common(keys)}


def server_settings(keys: Settings, address: str) -> dict[str, Any]:
    group = _emulator_group(keys, address)
    return {
        "kind": "natnet",
        "address": address,
        "version": keys["version"],
        "group": group,
        **_common(keys),
    }


def client_sockets(settings: Settings) -> tuple[SocketUse, ...]:
    server, data_port = settings["server"], int(settings["data_port"])
    here = settings["local"] or ("127.0.0.1" if server.startswith("127.") else "0.0.0.0")
    peer = f"{server} only"
    requests = SocketUse(address=here, port=0, what="requests to the motion capture", peer=peer)
    # a server that streams to one receiver may do so to the data port
    unicast = SocketUse(address=here, port=data_port, what="NatNet frames", peer=peer, always=False)
    if settings["transport"] != "multicast":
        return requests, unicast
    frames = SocketUse(
        address=settings["group"],
        port=data_port,
        what="NatNet frames, shared",
        peer=peer,
        shared=True,
        interface=here,
    )
    return requests, frames, unicast


def server_sockets(settings: Settings) -> tuple[SocketUse, ...]:
    address = settings["address"]
    return (
        SocketUse(
            address=address,
            port=int(settings["command_port"]),
            what="NatNet commands",
            peer="any client that asks, as NatNet servers do: poses only",
        ),
        SocketUse(
            address=address,
            port=0,
            what="NatNet frames, sent from here",
            peer="no one: this socket only sends",
        ),
    )


def parse_client(text: str) -> dict[str, Any]:
    server, _, transport = text.partition(":")
    try:
        ipaddress.IPv4Address(server)
    except ValueError:
        server = ""
    if not server or transport not in ("", "multicast", "unicast"):
        raise InputError(
            f"got natnet:{text}, expected natnet:ADDRESS[:multicast|unicast], as in natnet:10.0.0.5"
        )
    return {
        "kind": "natnet",
        "server": server,
        "local": None,
        "transport": transport or "multicast",
        "group": group_for(server),
        "command_port": COMMAND_PORT,
        "data_port": DATA_PORT,
    }


def _common(keys: Settings) -> dict[str, Any]:
    return {key: keys[key] for key in ("transport", "command_port", "data_port")}


def _emulator_group(keys: Settings, address: str) -> str:
    """Return the multicast group to which the emulator sends frames.

    With a real NatNet server, the group in the YAML belongs to that server, so the emulator uses another group.
    """
    explicit = None if keys["source"] == "natnet" else keys["group"]
    return str(explicit or group_for(address))
