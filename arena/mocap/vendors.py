"""The table of motion-capture vendors.

One row names the package that holds everything about one vendor. Such a package has three modules:

- `settings`, described by `VendorSettings`: turns YAML values into settings and lists sockets. Pure.
- `client` with `open_client(settings) -> MocapClient`, see `arena.mocap.client`.
- `server` with `open_server(settings) -> MocapServer`, see `arena.mocap.emulator`.

The rest of arena finds a vendor through this table only and never imports a vendor's package.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, cast

from arena.errors import InputError

VENDORS: dict[str, str] = {
    "natnet": "arena.mocap.natnet",
}
DEFAULT_VENDOR: Literal["natnet"] = (
    "natnet"  # the emulator serves this vendor's protocol unless the YAML names another one
)

Settings = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class SocketUse:
    """A socket of a client or server, for the list of open ports.

    port: 0 when the kernel chooses it.
    what: what the socket carries, as shown to a person.
    peer: whose datagrams are accepted, or who is answered.
    shared: several processes of one computer bind the port.
    always: open during the whole run; False for a socket that some servers only make necessary.
    interface: address of the interface on which a multicast group is joined.
    """

    address: str
    port: int
    what: str
    peer: str
    protocol: Literal["udp", "tcp"] = "udp"
    shared: bool = False
    always: bool = True
    interface: str = ""


class VendorSettings(Protocol):
    """The module `settings` of a vendor's package.

    keys: the values under `mocap:` in the YAML, defaults included.
    PORTS: YAML keys that hold UDP ports -> what the port is for.
    """

    PORTS: Mapping[str, str]

    def derived_keys(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return the YAML values that follow from others by rule. address: the arena's address."""

    def problems(self, keys: Settings) -> Iterator[tuple[str, str]]:
        """Yield (YAML key, what is wrong and what to do) for values that cannot work together."""

    def client_settings(self, keys: Settings) -> dict[str, Any]:
        """Return how a client reaches the vendor's own server, without the bodies it wants."""

    def emulator_client_settings(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return how a client reaches the emulator at `address`, without the bodies it wants."""

    def server_settings(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return what the emulator needs to serve this vendor's protocol at `address`."""

    def client_sockets(self, settings: Settings) -> tuple[SocketUse, ...]:
        """Return the sockets that a client with these settings opens."""

    def server_sockets(self, settings: Settings) -> tuple[SocketUse, ...]:
        """Return the sockets that the emulator with these settings opens."""

    def parse_client(self, text: str) -> dict[str, Any]:
        """Return client settings from what follows `VENDOR:` on a command line. Raises InputError."""


def vendor_settings(vendor: str) -> VendorSettings:
    """Return the module `settings` of a vendor. Raises InputError for an unknown vendor."""
    return cast(VendorSettings, load_vendor(vendor, "settings"))


def load_vendor(vendor: str, module: str) -> Any:
    """Import one module of a vendor's package. Raises InputError for an unknown vendor."""
    if vendor not in VENDORS:
        raise InputError(f"motion capture: got vendor {vendor!r}, expected one of {', '.join(VENDORS)}")
    return importlib.import_module(f"{VENDORS[vendor]}.{module}")
