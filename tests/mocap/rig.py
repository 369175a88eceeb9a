"""Emulated cameras with a NatNet server, in one object, for tests."""

from __future__ import annotations

import numpy as np

from arena.kernels.arrays import view
from arena.mocap.emulator.core import EmulatedCameras
from arena.mocap.natnet.server import NatNetServer
from arena.wire.truth_page import Truth
from arena.wire.truth_rows import PER_VEHICLE

ADDRESS = ("127.0.0.1", 4000)


def settings(**changes):
    """Return a `mocap` slice without what only the process needs."""
    return {
        "kind": "natnet",
        "version": "3.1",
        "rate_hz": 180,
        "latency_ms": 10,
        "bodies": [{"name": "uav1", "number": 4, "index": 0}],
        "noise": {"position_m": 0.002, "rotation_deg": 0.5},
        "seed": 1,
        "transport": "multicast",
        "data_port": 1511,
        "group": "239.255.42.99",
        **changes,
    }


def row(truth: Truth) -> memoryview[float]:
    """Return true states as a row of the truth page."""
    values = np.zeros(1 + len(truth.p_n) * PER_VEHICLE)
    values[0] = truth.time_s
    for stored, given in zip(Truth.from_row(values)[1:], truth[1:], strict=True):
        stored[:, : given.shape[1]] = given
    return view(values)


class NatNetRig:
    """The cameras and the NatNet server of one slice."""

    def __init__(self, slice_: dict) -> None:
        self.cameras, self.server = EmulatedCameras(slice_), NatNetServer(slice_)

    def packet(self, number: int, truth: Truth, sent_s: float | None = None) -> bytes:
        """Return the packet of one frame, sent when it is due unless `sent_s` says otherwise."""
        frame = self.cameras.measure(number, row(truth))
        sent_s = self.cameras.leaves_at(frame) if sent_s is None else sent_s
        self.server.begin(sent_s)
        return self.server.encode(frame, sent_s)

    def reply(self, request: bytes) -> bytes:
        reply = self.server.reply(request, ADDRESS, 0.0)
        assert reply is not None
        return reply
