"""Interface of a motion-capture client, and `open_client`, which opens the client of a vendor."""

from __future__ import annotations

from collections import Counter
from typing import Protocol, cast

from arena.mocap.client.pose import CapturedFrame
from arena.mocap.vendors import Settings, load_vendor


class MocapClient(Protocol):
    """Interface of a client that receives poses from one motion-capture server.

    The settings of the client list the requested bodies. The vendor's settings module lists the sockets of
    the client: `client_sockets`.
    """

    @property
    def counts(self) -> Counter[str]:
        """Counts since the start: frames that `poll` returned (key `frames`), and dropped datagrams by reason."""

    def fileno(self) -> int:
        """Return a file descriptor that is readable when `poll` can return new frames."""

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the frames that have arrived, oldest first. Never blocks.

        Call `poll` when `fileno` is readable, and also a few times a second so that the client can reconnect.
        now: time by the caller's clock [s].
        """

    def add_body(self, body: str) -> None:
        """Request one more rigid body. Poses of the bodies requested before continue to arrive."""

    def definition(self, body: str) -> str:
        """Return a fingerprint: a text that changes when a user redefines the rigid body on the server; "" if unknown.

        The text is, for example, a hash of the markers of the body. For a server that does not describe its
        bodies, return their names.
        """

    def refresh_definitions(self) -> None:
        """Request the descriptions (names, markers) of the rigid bodies from the server again.

        A server may change them without notice.
        """

    def diagnosis(self) -> str:
        """Return a sentence about why poses are missing and what to check; "" if poses arrive.

        Returns "" in the first seconds too, because the server may still answer. Call it about once a second.
        """

    def close(self) -> None:
        """Close the sockets of the client."""


def open_client(settings: Settings) -> MocapClient:
    """Open the motion-capture client of the vendor that the settings name.

    settings: the `capture` object of a process's configuration file; its key `kind` names the vendor. Without
    a network the client opens its sockets later, as soon as there is a route. Raises InputError for settings
    that cannot work.

    The optional key `stamps` is for a client that calls `poll` at fixed times, not when a frame arrives: the frames get the time of
    their arrival (`CapturedFrame.arrived_s`), if the vendor's client supports it.
    """
    return cast(MocapClient, load_vendor(settings["kind"], "client").open_client(settings))
