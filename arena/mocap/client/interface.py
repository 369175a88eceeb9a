"""The interface of a motion-capture client, and the function that opens one by its vendor's name."""

from __future__ import annotations

from collections import Counter
from typing import Protocol, cast

from arena.mocap.client.pose import CapturedFrame
from arena.mocap.vendors import Settings, load_vendor


class MocapClient(Protocol):
    """A client of one motion-capture server, for the bodies that its settings name.

    The sockets that it needs are listed by `client_sockets` of the vendor's settings.
    """

    @property
    def counts(self) -> Counter[str]:
        """Datagrams and frames received, and those dropped with the reason."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when `poll` has something to read."""

    def poll(self, now: float) -> list[CapturedFrame]:
        """Return the frames that have arrived, oldest first. Never blocks.

        Call it when `fileno` is readable, and a few times a second anyway, so that it can reconnect.
        now: the caller's time [s].
        """

    def diagnosis(self) -> str:
        """Return one sentence on why poses are missing and what to check; "" when nothing is wrong.

        Also "" during the first seconds, while an answer may still come. Call it about once a second.
        """

    def close(self) -> None:
        """Close the sockets."""


def open_client(settings: Settings) -> MocapClient:
    """Open a client for a `capture` object of a slice; its key `kind` names the vendor.

    Without a network the sockets open later, when it is there. Raises InputError for settings that cannot work.
    """
    return cast(MocapClient, load_vendor(settings["kind"], "client").open_client(settings))
