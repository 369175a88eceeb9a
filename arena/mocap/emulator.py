"""The motion-capture emulator without sockets or clocks: truth in, NatNet packets out, requests answered.

A frame is exposed at k / rate and leaves one latency later. Noise is drawn on a copy of the truth, fresh for every frame; an
occluded body is still sent, at its last pose, with its tracking-valid bit cleared, as the real system does.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from arena.errors import WireError
from arena.geometry import Array, q_wf_from_q_nb, quat_exp, quat_multiply, world_from_ned, xyzw_from_wxyz
from arena.wire import natnet
from arena.wire.truth import Truth

Address = tuple[str, int]

CLOCK_HZ = 10_000_000
_CLIENT_S = 10.0  # a unicast client that says nothing for so long is forgotten
_MOST_CLIENTS = 64
_QUIET_S = 0.5
_VERSIONS: dict[str, natnet.Version] = {"3.1": (3, 1), "4.1": (4, 1)}


class Emulator:
    """settings: the `mocap` slice. counts: frames sent, requests answered, datagrams not understood."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.version = _VERSIONS[settings["version"]]
        self.rate_hz, self.latency_s = float(settings["rate_hz"]), float(settings["latency_ms"]) * 1e-3
        self._bodies = settings["bodies"]
        self._rows = [b["index"] for b in self._bodies]
        self._sigma_m = float(settings["noise"]["position_m"])
        self._sigma_rad = math.radians(float(settings["noise"]["rotation_deg"]))
        self._rng = np.random.default_rng([int(settings["seed"]), 180])
        self._unicast = settings["transport"] == "unicast"
        self._data_port = int(settings["data_port"])
        self._group: Address = (settings["group"], self._data_port)
        self._occluded: set[str] = set()
        self._frozen: dict[str, natnet.Body] = {}
        self._last: dict[str, natnet.Body] = {}
        self._clients: dict[Address, float] = {}
        self._asked: dict[Address, float] = {}
        self.counts: Counter[str] = Counter()

    # -- frames --------------------------------------------------------------------------------------------------------

    def exposure(self, number: int) -> float:
        """When frame `number` is exposed [s]."""
        return number / self.rate_hz

    def frame(self, number: int, truth: Truth) -> bytes:
        """The packet of one frame. truth: the world at its exposure."""
        count = len(self._rows)
        p_n = truth.p_n[self._rows] + self._rng.normal(0.0, self._sigma_m, (count, 3))
        turn = quat_exp(self._rng.normal(0.0, self._sigma_rad, (count, 3)))
        position = world_from_ned(p_n)
        quat = xyzw_from_wxyz(q_wf_from_q_nb(quat_multiply(truth.q_nb[self._rows], turn)))
        bodies = tuple(self._body(b, position[i], quat[i]) for i, b in enumerate(self._bodies))
        self._last = {b["name"]: body for b, body in zip(self._bodies, bodies, strict=True)}
        self.counts["frames"] += 1
        exposed = self.exposure(number)
        return natnet.encode_frame(
            natnet.Frame(number=number, timestamp_s=exposed, exposure_ticks=int(exposed * CLOCK_HZ), bodies=bodies), self.version
        )

    def _body(self, body: Mapping[str, Any], position: Array, quat: Array) -> natnet.Body:
        name = body["name"]
        if name in self._frozen:
            return self._frozen[name]
        if name in self._occluded and name in self._last:
            seen = self._last[name]
            return natnet.Body(streaming_id=seen.streaming_id, position=seen.position, quat_xyzw=seen.quat_xyzw, tracked=False)
        x, y, z = position.tolist()
        qx, qy, qz, qw = quat.tolist()
        return natnet.Body(
            streaming_id=body["streaming_id"], position=(x, y, z), quat_xyzw=(qx, qy, qz, qw), mean_error_m=self._sigma_m,
            tracked=name not in self._occluded,
        )  # fmt: skip

    def occlude(self, body: str, hidden: bool) -> None:
        """The cameras lose a body, or find it again."""
        (self._occluded.add if hidden else self._occluded.discard)(body)

    def freeze(self, body: str, stuck: bool) -> None:
        """A body keeps its last pose and still says that it is tracked."""
        if stuck and body in self._last:
            self._frozen[body] = self._last[body]
        elif not stuck:
            self._frozen.pop(body, None)

    def destinations(self, now: float) -> list[Address]:
        """Where a frame goes. Unicast: to each client's data port, and to the port it asked from, for clients differ in where
        they listen. now: wall time [s].
        """
        if not self._unicast:
            return [self._group]
        self._clients = {a: t for a, t in self._clients.items() if now - t < _CLIENT_S}
        self._asked = {a: t for a, t in self._asked.items() if a in self._clients}
        ports = [(host, self._data_port) for host, _ in self._clients]
        ports += [a for a in self._clients if now - self._asked.get(a, -_QUIET_S) >= _QUIET_S]
        return list(dict.fromkeys(ports))

    # -- requests ------------------------------------------------------------------------------------------------------

    def hear(self, data: bytes, sender: Address, now: float) -> bytes | None:
        """One datagram on the command port -> its reply, or None. Keepalives are never answered."""
        try:
            message = natnet.message_of(data)
        except WireError:
            self.counts["malformed"] += 1
            return None
        if message in (natnet.CONNECT, natnet.KEEPALIVE) and (sender in self._clients or len(self._clients) < _MOST_CLIENTS):
            self._clients[sender] = now
        if message in (natnet.CONNECT, natnet.REQUEST_MODELDEF) and sender in self._clients:
            self._asked[sender] = now
        if message == natnet.CONNECT:
            self.counts["connects"] += 1
            return self._server_info()
        if message == natnet.REQUEST_MODELDEF:
            return natnet.encode_models([(b["streaming_id"], b["name"]) for b in self._bodies], self.version)
        if message != natnet.KEEPALIVE:
            self.counts["not understood"] += 1
        return natnet.packet(natnet.UNRECOGNIZED) if message == natnet.REQUEST else None

    def _server_info(self) -> bytes:
        return natnet.encode_server_info(
            natnet.ServerInfo(
                name="arena", app_version=(self.version[0], self.version[1], 0, 0), version=self.version, clock_hz=CLOCK_HZ,
                data_port=self._data_port, group="" if self._unicast else self._group[0],
            )
        )  # fmt: skip
