"""Motion capture for the vehicles of one process, with one client per server for all of them.

So each frame is received and decoded once per process, and not once per vehicle. In a fused arena on the simulation clock, no frame is
decoded: the poses come from shared memory.
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from arena.constants import POSE_PAGE
from arena.errors import ArenaError
from arena.uav.poses import Poses
from arena.wire.pose_page import PoseRow

if TYPE_CHECKING:
    from arena.mocap.client import MocapClient
    from arena.mocap.client import Pose as CapturedPose

Capture = Mapping[str, Any]
"""Settings of the motion-capture client. If `kind` is `POSE_PAGE`, the client is a `PageCapture`; else `arena.mocap.client.open_client`
makes it. The key `bodies` is ignored."""


class VehicleCapture(Protocol):
    """Interface of a motion capture client of one or several vehicles.

    fault: why the client failed; "" if it did not.
    """

    fault: str

    def poll(self, now: float, *, once: bool) -> None:
        """Store the newest pose that has arrived for each vehicle.

        now: time of arrival [s]. once: do nothing if this method was called at the same time before, by another vehicle.
        """

    def remove(self, poses: Poses) -> None:
        """Stop storing poses in `poses`."""


class PageCapture:
    """Motion capture of one vehicle that reads the poses from shared memory, see `arena.wire.pose_page`.

    settings: `path` of the page, and the `row` of the rigid body.  Raises RunError if there is no page.
    """

    def __init__(self, settings: Capture, body: str, poses: Poses) -> None:
        self.fault = ""
        self._row, self._body, self._poses = PoseRow(settings["path"], int(settings["row"])), body, poses

    def poll(self, now: float, *, once: bool) -> None:
        pose = self._row.new_pose()
        if pose is not None:
            self._poses.receive(self._body, pose[:3], pose[3:], now)

    def remove(self, poses: Poses) -> None:
        """Do nothing, because the page belongs to the world."""


class SharedClient:
    """Motion capture client of several vehicles. It stores the poses of each vehicle.

    client: receives the frames of one server.  fault: why the client failed; "" if it did not.
    closed: True after the last vehicle was removed.
    """

    def __init__(self, client: MocapClient) -> None:
        self.fault, self.closed = "", False
        self._client = client
        self._poses: dict[str, list[Poses]] = {}
        self._polled_at = math.nan
        self._lock = threading.Lock()

    def add(self, body: str, poses: Poses) -> bool:
        """Request one more rigid body from the server, and store its poses in `poses` from now on.

        Returns False, and does neither, if another thread has closed the client.
        """
        with self._lock:
            if self.closed:
                return False
            self._client.add_body(body)
            self._poses.setdefault(body, []).append(poses)
            return True

    def remove(self, poses: Poses) -> None:
        """Stop storing poses in `poses`. Close the client if no vehicle uses it any more."""
        with self._lock:
            left = {
                body: [each for each in found if each is not poses] for body, found in self._poses.items()
            }
            self._poses = {body: found for body, found in left.items() if found}
            if not self._poses and not self.closed:
                self.closed = True
                self._client.close()

    def poll(self, now: float, *, once: bool) -> None:
        """Store the newest pose that has arrived for each vehicle.

        now: time of arrival [s]. once: do nothing if this method was called at the same time before, by another vehicle.
        """
        with self._lock:
            if self.closed or (once and now == self._polled_at):
                return
            self._polled_at = now
            try:
                frames = self._client.poll(now)
            except (ArenaError, OSError) as error:
                self.fault = str(error)
                return
            newest: dict[str, CapturedPose] = {}
            for frame in reversed(frames):
                for pose in frame.poses:
                    if pose.body in self._poses:
                        newest.setdefault(pose.body, pose)
                if len(newest) == len(self._poses):
                    break
            for body, pose in newest.items():
                for poses in self._poses[body]:
                    poses.receive(body, pose.p_n, pose.q_nb, now)


class SharedCapture:
    """Motion capture clients of a process, one per server, or one per vehicle if they read shared memory."""

    def __init__(self) -> None:
        self._clients: dict[str, SharedClient] = {}
        self._lock = threading.Lock()

    def open(self, settings: Capture, body: str, poses: Poses) -> VehicleCapture:
        """Return the motion capture client that stores the poses of a rigid body in `poses`.

        Vehicles with the same settings share one client. Raises RunError if the shared memory with the poses is missing.
        """
        if settings.get("kind") == POSE_PAGE:
            return PageCapture(settings, body, poses)
        from arena.mocap.client import open_client

        server = json.dumps({k: v for k, v in settings.items() if k != "bodies"}, sort_keys=True)
        with self._lock:
            client = self._clients.get(server)
            if client is None or not client.add(body, poses):
                client = self._clients[server] = SharedClient(open_client({**settings, "bodies": []}))
                client.add(body, poses)
            return client
