"""Check that a replay can send to this computer only, and not to a flight controller. Pure."""

from __future__ import annotations

import ipaddress
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from arena.errors import InputError

_CONNECTIONS = frozenset({"wire", "serial", "url", "device", "key_file"})
"""Keys of a connection to a real flight controller in the configuration of a process."""


def check_loopback(slices: Mapping[str, Any], allowed: Collection[str] = ()) -> None:
    """Check that the processes of a replay use loopback addresses only.

    Multicast groups are allowed, because they are sent on the loopback interface.

    slices: name -> configuration.  allowed: addresses of ground stations that the user has named.
    Raises InputError for an address of another computer, for 0.0.0.0, and for a connection to a flight controller.
    """
    for path, value in _leaves(slices, ""):
        if value and not _CONNECTIONS.isdisjoint(path.split(".")):
            raise InputError(f"a replay must not connect to a real vehicle: got {path}: {value!r}")
        if isinstance(value, str) and _is_foreign(value) and value not in allowed:
            raise InputError(
                f"a replay can use only loopback addresses: got {path}: {value}, expected an address in 127.0.0.0/8"
            )


def _is_foreign(text: str) -> bool:
    try:
        address = ipaddress.IPv4Address(text)
    except ValueError:
        return False
    return not (address.is_loopback or address.is_multicast)


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _leaves(each, f"{path}.{key}".removeprefix("."))
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _leaves(each, path)
    else:
        yield path, value
