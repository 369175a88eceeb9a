"""Pose forwarder of one vehicle, as a member of the fused arena."""

from __future__ import annotations

import time as wall_time

from arena.fused.member import MemberContext
from arena.fused.memory_links import Inbox, MemoryCapture, VisionLink, address
from arena.fused.step_time import StepTime
from arena.mocap.client import Pose
from arena.pose_forwarder.shell import ForwarderShell

READY_TIMEOUT_S = 30.0
"""Longest time for which the program of a PX4 vehicle waits until the vehicle can be armed, in wall time [s]. It is longer in a
simulation that is slower than real time."""


class ForwarderMember:
    """Pose forwarder of one vehicle, as a part of the fused arena instead of a process of its own.

    capture: motion-capture client of all forwarders. The caller selects one pose per vehicle with `newest_poses`, and calls `send_pose`.
    vehicle: index in the world.  inbox: list that receives the datagrams for its autopilot; None: PX4, whose link is a socket.
    ready_limit_s: longest wall time until the forwarder of a PX4 is ready [s].
    selection: selects the poses to forward.  has_socket: the link to the autopilot is a socket.
    """

    def __init__(
        self,
        context: MemberContext,
        time: StepTime,
        capture: MemoryCapture,
        vehicle: int,
        inbox: Inbox | None,
        ready_limit_s: float,
    ) -> None:
        self._ready_limit_s = ready_limit_s
        remote = address(context.settings["link"], "remote")
        self._link = None if inbox is None else VisionLink(vehicle, inbox, remote)
        self._context = context
        self._shell = ForwarderShell(context, time, capture, self._link, wall=time.now())
        self.selection, self.has_socket = self._shell.core.selection, inbox is None
        self._began = wall_time.monotonic()

    def receive(self, data: bytes) -> None:
        """Store a datagram from the built-in autopilot until `step` reads it."""
        if self._link is not None:
            self._link.waiting.append(data)

    def send_pose(self, pose: Pose, now: float) -> None:
        """Send a pose to the autopilot.

        pose: from `selection`.  now: simulation time [s].
        """
        self._shell.send_pose(pose, now)

    def step(self, now: float, due: bool) -> None:
        """Read the waiting messages of the autopilot, and do the periodic work if it is due.

        now: simulation time [s].  due: also send the messages that do not depend on poses, and report to the supervisor.
        """
        if self._link is None or self._link.waiting:
            self._shell.read_link(now)
        if due:
            self._shell.tick(now, now)
            if self._link is None and not self._context.is_ready:
                self._limit_wait()

    def close(self) -> None:
        """Close the pose forwarder's link to the autopilot."""
        self._shell.link.close()

    def _limit_wait(self) -> None:
        """Report the forwarder as ready after a limit of wall time, even if the vehicle cannot be armed.

        The user program then starts and reports why PX4 cannot be armed.
        """
        if wall_time.monotonic() - self._began > self._ready_limit_s:
            vehicle = self._context.settings["vehicle"]
            self._context.event(
                f"{vehicle}: PX4 was not ready to arm within {self._ready_limit_s:g} s; the user program starts now"
            )
            self._context.ready()
