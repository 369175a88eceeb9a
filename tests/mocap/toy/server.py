"""The toy vendor's server: a measured frame -> one JSON datagram for every client's port."""

from __future__ import annotations

import json
from collections import Counter

from arena.mocap.emulator import MeasuredFrame
from arena.mocap.emulator.udp_server import UdpServer
from arena.mocap.vendors import Settings
from arena.transport import Address


def open_server(settings: Settings) -> UdpServer:
    return UdpServer(ToyServer(settings), (settings["address"], 0), "the toy")


class ToyServer:
    def __init__(self, settings: Settings) -> None:
        self.counts: Counter[str] = Counter()
        self._names = {b["number"]: b["name"] for b in settings["bodies"]}
        self._client = settings["address"], settings["port"]

    def begin(self, sent_s: float) -> None:
        """Do nothing: a frame has its own time."""

    def encode(self, frame: MeasuredFrame, sent_s: float) -> bytes:
        bodies = [
            {
                "name": self._names[b.number],
                "position": b.position_w,
                "quat_xyzw": b.quat_xyzw_wf,
                "tracked": b.tracked,
            }
            for b in frame.bodies
        ]
        return json.dumps({"number": frame.number, "time_s": frame.exposed_s, "bodies": bodies}).encode()

    def destinations(self, wall: float) -> list[Address]:
        return [self._client]

    def reply(self, data: bytes, sender: Address, wall: float) -> bytes | None:
        return None
