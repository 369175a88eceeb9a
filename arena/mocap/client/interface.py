"""Interface of a motion-capture client, and the function that opens the client of a given vendor."""

from __future__ import annotations

from collections import Counter
from typing import Protocol, cast

from arena.mocap.client.pose import CapturedFrame
from arena.mocap.vendors import Settings, load_vendor


class MocapClient(Protocol):
    """Interface of a client of one motion-capture server. The client receives the poses of the bodies in its settings.

    The vendor's settings module lists the sockets of the client: `client_sockets`.
    """

    @property
    def counts(self) -> Counter[str]:
        """Counters: frames returned by `poll` (key `frames`), and dropped datagrams, one key for each reason."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when `poll` has something to read."""

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the frames that have arrived, oldest first. Never blocks.

        Call `poll` when `fileno` is readable, and also a few times a second so that the client can reconnect.
        now: time by the caller's clock [s].
        """

    def definition(self, body: str) -> str:
        """Return a text that changes when the rigid body is defined again, such as a hash of its markers; "" if unknown yet.

        For a server that does not describe its bodies, return their names.
        """

    def refresh_definitions(self) -> None:
        """Request the descriptions of the bodies again, because a server may change them without notice."""

    def diagnosis(self) -> str:
        """Return one sentence on why poses are missing and what to check; "" if poses arrive.

        Returns "" in the first seconds too, because the server may still answer. Call it about once a second.
        """

    def close(self) -> None:
        """Close the sockets."""


def open_client(settings: Settings) -> MocapClient:
    """Open a client from the `capture` object of a process's configuration file; the key `kind` names the vendor.

    Without a network the client opens its sockets later, as soon as there is a route. Raises InputError for
    settings that cannot work.

    The optional key `stamps` is for a client that calls `poll` at fixed times, not when a frame arrives: the frames get the time of
    their arrival (`CapturedFrame.arrived_s`), if the vendor's client supports it.
    """
    return cast(MocapClient, load_vendor(settings["kind"], "client").open_client(settings))
