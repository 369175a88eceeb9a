"""The toy vendor's settings: one port, to which the server sends every frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from arena.mocap.vendors import Settings, SocketUse

PORTS = {"toy_port": "the toy's frames"}


def derived_keys(keys: Settings, address: str) -> dict[str, Any]:
    return {}


def problems(keys: Settings) -> Iterator[tuple[str, str]]:
    if keys["toy_port"] == 13:
        yield "toy_port", "got 13, expected another port. Try 7777."


def client_settings(keys: Settings) -> dict[str, Any]:
    return {"kind": "toy", "server": keys["server"], "local": keys["local"], "port": keys["toy_port"]}


def emulator_client_settings(keys: Settings, address: str) -> dict[str, Any]:
    return {"kind": "toy", "server": address, "local": address, "port": keys["toy_port"]}


def server_settings(keys: Settings, address: str) -> dict[str, Any]:
    return {"kind": "toy", "address": address, "port": keys["toy_port"]}


def client_sockets(settings: Settings) -> tuple[SocketUse, ...]:
    server, local = settings["server"], settings["local"]
    return (SocketUse(address=local, port=settings["port"], what="toy frames", peer=f"{server} only"),)


def server_sockets(settings: Settings) -> tuple[SocketUse, ...]:
    return (SocketUse(address=settings["address"], port=0, what="toy frames leave", peer="nobody: it sends"),)


def parse_client(text: str) -> dict[str, Any]:
    server, _, port = text.partition(":")
    return {"kind": "toy", "server": server, "local": None, "port": int(port or 7777)}
