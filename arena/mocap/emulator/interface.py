"""Interface of an emulated motion-capture server, and the frames that it sends."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple, Protocol, cast

from arena.kernels.capture_types import MeasuredBody
from arena.mocap.vendors import Settings, load_vendor

__all__ = ["MeasuredBody", "MeasuredFrame", "MocapServer", "open_server"]


class MeasuredFrame(NamedTuple):
    """Poses of all bodies that the emulated cameras measure at one exposure.

    number: frame number. exposed_s: time of the exposure [s].
    """

    number: int
    exposed_s: float
    bodies: tuple[MeasuredBody, ...]


class MocapServer(Protocol):
    """Interface of an emulated motion-capture server for the protocol of one vendor.

    The server opens its sockets itself and never blocks.

    counts: number of frames sent, of requests answered, and of datagrams dropped for each reason.
    """

    @property
    def counts(self) -> Counter[str]: ...

    def send(self, frame: MeasuredFrame, sent_s: float, wall: float) -> int:
        """Send one frame to every client. Return the number of clients to which the frame could not be sent.

        sent_s: simulation time of sending [s]. wall: monotonic wall time [s].
        """

    def answer(self, wall: float) -> None:
        """Reply to the requests that clients have sent. wall: monotonic wall time [s]."""

    def search_receivers(self) -> None:
        """Search again for programs that receive frames without a request, because one may have been started."""

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a request has arrived."""

    def close(self) -> None:
        """Close the sockets of the server."""


def open_server(settings: Settings) -> MocapServer:
    """Open the emulated server of the vendor that the settings name.

    settings: configuration of the `mocap` process; the key `kind` names the vendor. Raises RunError if a port is in use.
    """
    return cast(MocapServer, load_vendor(settings["kind"], "server").open_server(settings))
