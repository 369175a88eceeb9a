"""The table of motion-capture vendors: {vendor: package with its settings, client and emulated server}.

Each row names the package that contains everything specific to one vendor. Such a package has three modules:

- `settings`, described by `VendorSettings`: converts YAML values to settings and lists sockets. Pure.
- `client` with `open_client(settings) -> MocapClient`, see `arena.mocap.client`.
- `server` with `open_server(settings) -> MocapServer`, see `arena.mocap.emulator`.

The other packages of arena use this table only; they never import a vendor's package.
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
    """A socket that a motion-capture client or server opens, as an entry of the list of open ports.

    port: 0 if the kernel chooses the port.
    what: what the socket carries, as shown to the user.
    peer: which senders are accepted or answered.
    shared: several processes of one computer bind the port.
    always: open during the whole run; False if the socket opens only for some servers.
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
    """Interface of a vendor's module `settings`, which converts the YAML's `mocap:` to client and server settings.

    keys: the values under `mocap:` in the YAML, defaults included.
    PORTS: YAML keys that are UDP ports -> purpose of the port.
    """

    PORTS: Mapping[str, str]

    def derived_keys(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return the values under `mocap:` that depend on other values, such as the multicast group.

        address: numeric IPv4 address that the processes of this arena bind (YAML key `address`)
        """

    def problems(self, keys: Settings) -> Iterator[tuple[str, str]]:
        """Yield (YAML key, message) for each value under `mocap:` that contradicts another value.

        The message says what the user must do.
        """

    def client_settings(self, keys: Settings) -> dict[str, Any]:
        """Return the settings for a client that connects to the vendor's real server.

        The caller adds the list of requested `bodies`.
        """

    def emulator_client_settings(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return the settings for a client that connects to the emulator at `address`.

        The caller adds the list of requested `bodies`.
        """

    def server_settings(self, keys: Settings, address: str) -> dict[str, Any]:
        """Return the settings of the emulated server of this vendor at `address`."""

    def client_sockets(self, settings: Settings) -> tuple[SocketUse, ...]:
        """Return the sockets that a client with these settings opens."""

    def server_sockets(self, settings: Settings) -> tuple[SocketUse, ...]:
        """Return the sockets that the emulated server with these settings opens."""

    def parse_client(self, text: str) -> dict[str, Any]:
        """Convert the text after `VENDOR:` in the option `--capture` to client settings.

        Return the settings of a motion-capture client. Raises InputError.
        """


def vendor_settings(vendor: str) -> VendorSettings:
    """Return the module `settings` of a vendor. Raises InputError for an unknown vendor."""
    return cast(VendorSettings, load_vendor(vendor, "settings"))


def load_vendor(vendor: str, module: str) -> Any:
    """Import a module of a vendor's package, such as `client`. Raises InputError for an unknown vendor."""
    if vendor not in VENDORS:
        raise InputError(f"motion capture: got vendor {vendor!r}, expected one of {', '.join(VENDORS)}")
    return importlib.import_module(f"{VENDORS[vendor]}.{module}")
