"""Input and output of a pose forwarder: motion-capture frames, and MAVLink to and from the autopilot.

`forwarder.py` makes the messages. The caller of `ForwarderShell` decides when data is read and sent.
"""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Sequence
from typing import Protocol

from arena.clock import Clock, SimClock, WallClock
from arena.mocap.client import (
    CapturedFrame,
    ChangeReport,
    LateFrames,
    Lateness,
    MocapClient,
    Pose,
    open_client,
)
from arena.pose_forwarder.forwarder import Forwarder
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.transport import Address, listen_udp

TICK_S = 0.2
"""Time between two calls of `ForwarderShell.tick` [s]."""
_REFRESH_S = 5.0
_FIRST_MESSAGE_S = 0.3  # a running autopilot sends EXTENDED_SYS_STATE five times a second


class VisionLink(Protocol):
    """UDP socket of the vision link, on which ODOMETRY is sent to the autopilot. No method blocks."""

    def recvfrom(self, size: int, /) -> tuple[bytes, Address]: ...

    def sendto(self, data: bytes, to: Address, /) -> int: ...

    def fileno(self) -> int: ...

    def close(self) -> None: ...


class ForwarderShell:
    """Pose forwarder of one vehicle, with its motion-capture client and its socket to the autopilot.

    clock, capture, link: clock, motion-capture client, and socket to the autopilot (the vision link); None: opened as the
        configuration says.
    wall: present time, by the same clock as the argument `wall` of `tick` [s]; None: `time.monotonic()`.
    """

    def __init__(
        self,
        process: ProcessContext,
        clock: Clock | None = None,
        capture: MocapClient | None = None,
        link: VisionLink | None = None,
        wall: float | None = None,
    ) -> None:
        s = process.settings
        self.process, self.core = process, Forwarder(s, wait_s=_FIRST_MESSAGE_S)
        self.capture: MocapClient = open_client(s["capture"]) if capture is None else capture
        self.mocap_report, self.late_frames = ChangeReport(), LateFrames(float(s["stale_s"]))
        self.clock: Clock = _clock(process) if clock is None else clock
        self.link: VisionLink = (
            listen_udp(tuple(s["link"]["local"]), "the vision link") if link is None else link
        )
        self.remote: Address = (str(s["link"]["remote"][0]), int(s["link"]["remote"][1]))
        self.simulated, self.body = bool(s["simulated"]), str(s["body"])
        self.after = ShutdownPolicy(limit_s=60.0 if self.simulated else None)
        self.reported = self.refreshed = time.monotonic() if wall is None else wall
        self.poses_then, self.ready = 0, False
        self.poses_from: float | None = None

    def turn(self, now: float) -> bool:
        """Receive poses and MAVLink messages, and send a pose if one is due. Return True if a pose was sent.

        now: time of `clock` [s].
        """
        sent = self.forward(self.capture.poll(now), now)
        self.read_link(now)
        return sent

    def forward(self, frames: Sequence[CapturedFrame], now: float) -> bool:
        """Send the newest pose in the received frames if one is due. Return True if a pose was sent.

        frames: oldest first.  now: time of `clock` [s].
        """
        pose = self.core.selection.newest(frames, now)
        return pose is not None and self.send_pose(pose, now)

    def send_pose(self, pose: Pose, now: float) -> bool:
        """Send a selected pose, unless it must wait for the origin. Return True if it was sent.

        now: time of `clock` [s].
        """
        data = self.core.on_pose(pose, now)
        if data is not None:
            self._send(data)
        return data is not None

    def read_link(self, now: float) -> None:
        """Read the MAVLink messages that have arrived from the autopilot.

        now: time of `clock` [s].
        """
        for _ in range(64):
            try:
                data, sender = self.link.recvfrom(65535)
            except OSError:
                return
            if sender == self.remote:
                self.core.on_mavlink(data, now)
            else:
                self.core.counts["foreign datagram"] += 1

    def tick(self, now: float, wall: float) -> bool:
        """Send the MAVLink messages that are due, such as the heartbeat, and report to the supervisor.

        Return whether the process must end because the supervisor has died.

        now: time of `clock` [s].  wall: monotonic time, for rates and time limits [s].
        """
        for data in self.core.tick(now):
            self._send(data)
        if not self.ready and self.core.serving:
            self.ready = True
            self.process.ready()
        if wall - self.reported >= 1.0:
            self._report(now, wall)
            self._report_diagnosis()
        self._refresh_definition(wall)
        a = self.core.autopilot
        # A silent simulated autopilot has ended; a silent real one may be flying with a lost radio link.
        armed = a.armed and (now - a.last_heartbeat < 5.0 or not self.simulated)
        return self.after.over(orphaned=self.process.orphaned, any_armed=armed, now=wall)

    def _refresh_definition(self, wall: float) -> None:
        """Request the definition of the rigid body every 5 s, while a real vehicle is disarmed.

        A passed axes check (`arena preflight`) counts only for the definition that was checked.
        """
        if not self.simulated and not self.core.autopilot.armed and wall - self.refreshed >= _REFRESH_S:
            self.refreshed = wall
            self.capture.refresh_definitions()

    def _report(self, now: float, wall: float) -> None:
        if self.poses_from is None and self.core.poses:
            self.poses_from, self.poses_then = wall, self.core.poses
        self.reported = wall
        served_s = wall - self.poses_from if self.poses_from is not None else 0.0
        rate = (self.core.poses - self.poses_then) / served_s if served_s else 0.0
        age_ms = round(1e3 * (now - self.core.last_pose), 1) if self.core.poses else None
        dropped = {f"dropped {k}": v for k, v in self.core.counts.items()}
        received = {f"capture {k}": v for k, v in self.capture.counts.items()}
        garbled = {f"link {k}": v for k, v in self.core.garbled.items()}
        flow = {"rate_hz": round(rate, 2), "poses": self.core.poses, "pose_age_ms": age_ms}
        body = {"body_definition": self.capture.definition(self.body)}
        self.process.stats({**flow, **_latency(self.core.lateness), **body, **dropped, **received, **garbled})

    def _report_diagnosis(self) -> None:
        """Report why no poses arrive, to the supervisor and the log, when the reason changes."""
        late = self.late_frames.diagnosis(self.core.late_s)
        change = self.mocap_report.changed(self.capture.diagnosis() or late)
        if change is not None:
            self.process.event(change)
            print(f"forward: {change}", file=sys.stderr, flush=True)

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self.link.sendto(data, self.remote)


def _clock(process: ProcessContext) -> Clock:
    path = process.settings.get("clock")
    return SimClock(path, process.name) if path else WallClock()


def _latency(lateness: Lateness) -> dict[str, float | None]:
    """Return the latency from exposure to arrival of the last frame, and its largest possible error [ms].

    Both are None before the motion-capture server has answered an echo request, which measures the offset of the clocks.
    """
    if not math.isfinite(lateness.latency_s):
        return {"latency_ms": None, "latency_error_ms": None}
    return {
        "latency_ms": round(1e3 * lateness.latency_s, 1),
        "latency_error_ms": round(1e3 * lateness.clock_error_s, 1),
    }
