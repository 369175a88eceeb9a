"""The motion-capture emulator without sockets or clocks: truth in, NatNet packets out, requests answered.

A frame is exposed at k / rate and leaves one latency later. Noise is drawn on a copy of the truth, fresh for every frame; an
occluded body is still sent, at its last pose, with its tracking-valid bit cleared, as the real system does. A delay on purpose
comes on top of the latency: what has been exposed stays as it is, and leaves in its order.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.errors import WireError
from arena.geometry import (
    q_wf_from_q_nb,
    quat_exp,
    quat_from_euler,
    quat_multiply,
    world_from_ned,
    xyzw_from_wxyz,
)
from arena.mocap.emulator.unicast_clients import Address, Clients
from arena.wire import natnet
from arena.wire.truth_page import Truth

CLOCK_HZ = 10_000_000
_SILENT = (natnet.KEEPALIVE, natnet.DISCONNECT)  # never answered
# The conversions are linear, so each is the matrix of its action on a basis: one product a frame instead of a dozen calls.
_W_N, _XYZW_NB = world_from_ned(np.eye(3)), xyzw_from_wxyz(q_wf_from_q_nb(np.eye(4)))
_VERSIONS: dict[str, natnet.Version] = {"3.1": (3, 1), "4.1": (4, 1)}


_SOON_S = 1e-6  # a clock that wakes by steps may tell a time a little before the one asked for


class Emulator:
    """settings: the `mocap` slice. counts: frames sent, requests answered, datagrams not understood. delay_s: on purpose, more
    than the latency; may be changed at any time.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.version = _VERSIONS[settings["version"]]
        self.rate_hz, self.latency_s = float(settings["rate_hz"]), float(settings["latency_ms"]) * 1e-3
        self._bodies = settings["bodies"]
        self._rows = np.array([b["index"] for b in self._bodies], int)
        self._off_n, self._turned = (
            np.zeros((len(self._bodies), 3)),
            np.tile([1.0, 0.0, 0.0, 0.0], (len(self._bodies), 1)),
        )
        self._jumped = False
        self._swapped: list[frozenset[str]] = []
        self._shown = self._rows
        self.delay_s = 0.0
        self._held: deque[natnet.Frame] = deque()
        self._index = {str(b["name"]): i for i, b in enumerate(self._bodies)}
        self._sigma_m = float(settings["noise"]["position_m"])
        self._sigma_rad = math.radians(float(settings["noise"]["rotation_deg"]))
        self._rng = np.random.default_rng([int(settings["seed"]), 180])
        self._unicast = settings["transport"] == "unicast"
        self._data_port = int(settings["data_port"])
        self._group: Address = (settings["group"], self._data_port)
        self._occluded: set[str] = set()
        self._frozen: set[str] = set()
        self._last: dict[str, natnet.Body] = {}
        self._clients = Clients(self._data_port)
        self.counts: Counter[str] = Counter()

    @property
    def bodies(self) -> tuple[str, ...]:
        return tuple(self._index)

    # -- frames --------------------------------------------------------------------------------------------------------

    def exposure(self, number: int) -> float:
        """When frame `number` is exposed [s]."""
        return number / self.rate_hz

    def due(self, number: int) -> float:
        """When there is something to do next [s]: to take frame `number`, or to let one go that is held."""
        takes = self.exposure(number) + self.latency_s
        return min(takes, self._leaves(self._held[0])) if self._held else takes

    def take(self, number: int, truth: Truth) -> None:
        """Frame `number` has been worked out, one latency after its exposure. truth: the world at its exposure."""
        self._held.append(self._expose(number, truth))

    def leaving(self, now: float) -> list[bytes]:
        """The packets that leave now [s], oldest first."""
        packets = []
        while self._held and self._leaves(self._held[0]) <= now + _SOON_S:
            packets.append(self._packet(self._held.popleft(), now))
        return packets

    def frame(self, number: int, truth: Truth, sent: float | None = None) -> bytes:
        """The packet of one frame, past those that are held. sent: when it leaves [s], when it should unless told."""
        frame = self._expose(number, truth)
        return self._packet(frame, self._leaves(frame) if sent is None else sent)

    def _leaves(self, frame: natnet.Frame) -> float:
        return frame.timestamp_s + self.latency_s + self.delay_s

    def _packet(self, frame: natnet.Frame, sent: float) -> bytes:
        self.counts["frames"] += 1
        return natnet.encode_frame(dataclasses.replace(frame, transmit_ticks=_ticks(sent)), self.version)

    def _expose(self, number: int, truth: Truth) -> natnet.Frame:
        count = len(self._rows)
        p_n = truth.p_n[self._shown] + self._rng.normal(0.0, self._sigma_m, (count, 3))
        q_nb = quat_multiply(
            truth.q_nb[self._shown], quat_exp(self._rng.normal(0.0, self._sigma_rad, (count, 3)))
        )
        if self._jumped:
            p_n, q_nb = p_n + self._off_n, quat_multiply(self._turned, q_nb)
        places, quats = (p_n @ _W_N).tolist(), (q_nb @ _XYZW_NB).tolist()
        bodies = tuple(self._body(b, p, q) for b, p, q in zip(self._bodies, places, quats, strict=True))
        self._last = {b["name"]: body for b, body in zip(self._bodies, bodies, strict=True)}
        exposed = self.exposure(number)
        return natnet.Frame(
            number=number,
            timestamp_s=exposed,
            exposure_ticks=_ticks(exposed),
            transmit_ticks=0,
            bodies=bodies,
        )

    def _body(self, body: Mapping[str, Any], position: list[float], quat_xyzw: list[float]) -> natnet.Body:
        name = body["name"]
        seen = self._last.get(name)
        if seen is not None and name in self._occluded:
            return dataclasses.replace(seen, tracked=False)
        if seen is not None and name in self._frozen:
            return seen
        (x, y, z), (qx, qy, qz, qw) = position, quat_xyzw
        return natnet.Body(
            streaming_id=body["streaming_id"],
            position=(x, y, z),
            quat_xyzw=(qx, qy, qz, qw),
            mean_error_m=self._sigma_m,
            tracked=name not in self._occluded,
        )

    def occlude(self, body: str, hidden: bool) -> None:
        """The cameras lose a body, or find it again."""
        (self._occluded.add if hidden else self._occluded.discard)(body)

    def freeze(self, body: str, stuck: bool) -> None:
        """A body keeps its last pose and still says that it is tracked."""
        (self._frozen.add if stuck else self._frozen.discard)(body)

    def jump(self, body: str, by_n: Sequence[float], yaw_rad: float) -> None:
        """From now on a body is seen so far from where it is [m] [NED] (3,), and turned to the right about the vertical there."""
        i = self._index[body]
        self._off_n[i], self._turned[i] = by_n, quat_from_euler([0.0, 0.0, yaw_rad])
        self._jumped = bool(self._off_n.any() or self._turned[:, 1:].any())

    def swap(self, a: str, b: str, on: bool) -> None:
        """Two bodies are taken for each other, or no longer."""
        pair = frozenset((a, b))
        self._swapped = [p for p in self._swapped if p != pair] + [pair] * on
        self._shown = self._rows.copy()
        for swapped in self._swapped:
            i, k = (self._index[name] for name in swapped)
            self._shown[[i, k]] = self._shown[[k, i]]

    def destinations(self, now: float) -> list[Address]:
        """Where a frame goes. now: wall time [s]."""
        return self._clients.destinations(now) if self._unicast else [self._group]

    # -- requests ------------------------------------------------------------------------------------------------------

    def hear(self, data: bytes, sender: Address, now: float) -> bytes | None:
        """One datagram on the command port -> its reply, or None. Keepalives are never answered."""
        try:
            message = natnet.message_of(data)
        except WireError:
            self.counts["malformed"] += 1
            return None
        self._clients.heard(message, sender, now)
        if message == natnet.CONNECT:
            self.counts["connects"] += 1
            return self._server_info()
        if message == natnet.REQUEST_MODELDEF:
            return natnet.encode_models([(b["streaming_id"], b["name"]) for b in self._bodies], self.version)
        if message not in _SILENT:
            self.counts["not understood"] += 1
        return natnet.packet(natnet.UNRECOGNIZED) if message == natnet.REQUEST else None

    def _server_info(self) -> bytes:
        return natnet.encode_server_info(
            natnet.ServerInfo(
                name="arena",
                app_version=(self.version[0], self.version[1], 0, 0),
                version=self.version,
                clock_hz=CLOCK_HZ,
                data_port=self._data_port,
                group="" if self._unicast else self._group[0],
            )
        )


def _ticks(time_s: float) -> int:
    return round(time_s * CLOCK_HZ)
