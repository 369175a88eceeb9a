"""The toy vendor's client: a frame's JSON -> poses in NED."""

from __future__ import annotations

import json
import time
from collections import Counter

from arena.mocap.client.diagnosis import no_pose
from arena.mocap.client.pose import CapturedFrame, pose_ned
from arena.mocap.client.reception import Reception
from arena.mocap.client.sockets import ServerSockets
from arena.mocap.vendors import Settings


def open_client(settings: Settings) -> ToyClient:
    return ToyClient(settings)


class ToyClient:
    def __init__(self, settings: Settings) -> None:
        self.counts: Counter[str] = Counter()
        self._server, self._bodies = settings["server"], settings["bodies"]
        self._reception = Reception(time.monotonic())
        address = self._server, settings["port"]
        self._sockets = ServerSockets(address, settings["local"], None, self._reception, self.counts)
        self._served: Counter[str] = Counter()
        if self._sockets.open(time.monotonic()):
            self._sockets.listen_on(settings["port"])

    def fileno(self) -> int:
        return self._sockets.fileno()

    def poll(self, now: float) -> list[CapturedFrame]:
        wall = time.monotonic()
        frames = [self._decode(json.loads(data)) for data in self._sockets.read(wall)]
        self._reception.update_frames(self.counts["frames"], frames, wall)
        return frames

    def add_body(self, body: str) -> None:
        self._bodies = [*self._bodies, body]

    def definition(self, body: str) -> str:
        return f"name {body}"

    def refresh_definitions(self) -> None:
        """Do nothing: the toy never changes."""

    def diagnosis(self) -> str:
        now = time.monotonic()
        if not self._reception.streaming(now):
            return f"motion capture: no frame from {self._server}: is the toy switched on?"
        return no_pose(self._server, self._reception.body_status(self._served, self._bodies, now))

    def close(self) -> None:
        self._sockets.close()

    def _decode(self, frame: dict) -> CapturedFrame:
        self.counts["frames"] += 1
        bodies = {b["name"]: b for b in frame["bodies"]}
        self._served = Counter(list(bodies))
        seen = {n: b for n, b in bodies.items() if n in self._bodies and b["tracked"]}
        poses = (pose_ned(name, tuple(b["position"]), tuple(b["quat_xyzw"])) for name, b in seen.items())
        untracked = tuple(n for n in self._bodies if n in bodies and n not in seen)
        return CapturedFrame(frame["number"], frame["time_s"], tuple(p for p in poses if p), untracked)
