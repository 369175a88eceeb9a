"""Faults on purpose: how a scenario spoils a simulated arena while it flies. One local datagram is one fault, a JSON object.

Each room that can be spoiled (the world, the motion capture, the router) listens on `<path>`, a socket in the run's private
folder, and looks at it before every step, frame or turn. A sender that is awake on a lockstep clock finds its fault in force at
the next of these: time has not moved meanwhile. Arenas with real vehicles have no such sockets: their slices name none.

    world    {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}     share of the thrust that rotor 1.. still gives
             {"do": "battery", "vehicle": "uav1", "empty_in_s": 20.0}          drawn at the pace full to empty in so long; null: as before
             {"do": "wind", "wind_m_s": [3, 0, 0]}                             [NED]
             {"do": "sticks", "vehicle": "uav1", "on": false}                  a pilot's radio
    mocap    {"do": "dropout", "body": "uav1", "on": true}                     not tracked
             {"do": "freeze", "body": "uav1", "on": true}                      the last pose again and again, as if tracked
             {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 0}   every pose is off by so much [NED]; zeros: as before
             {"do": "swap", "bodies": ["uav1", "uav2"], "on": true}            each gets the other's pose
             {"do": "delay", "ms": 200}                                        more latency
    router   {"do": "loss", "vehicle": "uav1", "share": 0.3}                   of the datagrams of its link, each way
             {"do": "delay", "vehicle": "uav1", "ms": 200}                     each way, in simulated time
             {"do": "heartbeat", "on": false}                                  of the ground station
"""

from __future__ import annotations

import contextlib
import json
import socket
from pathlib import Path
from typing import Any

from arena.errors import RunError

Fault = dict[str, Any]
_LONGEST = 4096


class Faults:
    """The listening side. path: None listens to nobody."""

    def __init__(self, path: str | Path | None) -> None:
        self._path = Path(path) if path else None
        self._socket: socket.socket | None = None
        if self._path is not None:
            self._path.unlink(missing_ok=True)
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            self._socket.bind(str(self._path))
            self._path.chmod(0o600)

    def take(self) -> list[Fault]:
        """What has arrived since the last call. Costs one system call when there is nothing."""
        found: list[Fault] = []
        while self._socket is not None:
            try:
                fault = json.loads(self._socket.recv(_LONGEST))
            except BlockingIOError:
                break
            except ValueError:
                continue
            if isinstance(fault, dict):
                found.append(fault)
        return found

    def close(self) -> None:
        if self._socket is not None and self._path is not None:
            self._socket.close()
            self._path.unlink(missing_ok=True)


def inject(path: str | Path, fault: Fault) -> None:
    """Raises RunError when nobody listens there."""
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)) as sender:
        try:
            sender.connect(str(path))
            sender.send(json.dumps(fault).encode())
        except OSError as error:
            raise RunError(f"{path}: nobody takes faults there ({error.strerror})") from error
