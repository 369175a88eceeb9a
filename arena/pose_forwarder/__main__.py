"""Process of the pose forwarder of one vehicle: its motion-capture client and its vision link.

Run as `python -m arena.pose_forwarder slice.json`.
"""

from __future__ import annotations

import contextlib
import math
import selectors
import sys
import time

from arena.clock import Clock, SimClock, WallClock
from arena.mocap.client import ChangeReport, LateFrames, Lateness, MocapClient, open_client
from arena.pose_forwarder.forwarder import Forwarder
from arena.process_context import ProcessContext, ShutdownPolicy, run_process
from arena.transport import listen_udp

_TICK_S = 0.2
_REFRESH_S = 5.0
_FIRST_MESSAGE_S = 0.3  # a running autopilot sends EXTENDED_SYS_STATE five times a second


def main() -> int:
    return run_process("forward", lambda room: _ForwarderProcess(room).serve)


class _PoseGapSleep:
    """Timer for a sleep after each forwarded pose. Most camera frames are not forwarded, so the process need not wake up for each of them.

    The interval is measured, so that it is right at any speed of the simulation. period_s: longest interval
    [s].
    """

    _SHARE = 0.7
    _MIN_S = 0.003

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._sent = -1e9
        self._gap_s = 0.0

    def on_sent(self, wall: float) -> None:
        """Record that a pose has been sent. wall: monotonic wall time [s]."""
        gap = min(wall - self._sent, self._period_s)
        self._gap_s += 0.2 * (gap - self._gap_s)
        self._sent = wall

    def sleep(self) -> None:
        """Sleep until shortly before the next pose is due: 70 % of the usual interval, counted from the
        last pose. Skip a sleep below 3 ms.
        """
        pause = self._sent + self._SHARE * self._gap_s - time.monotonic()
        if pause > self._MIN_S:
            time.sleep(pause)


class _ForwarderProcess:
    def __init__(self, room: ProcessContext) -> None:
        s = room.settings
        self.room, self.core = room, Forwarder(s, wait_s=_FIRST_MESSAGE_S)
        self.capture: MocapClient = open_client(s["capture"])
        self.mocap_report, self.late_frames = ChangeReport(), LateFrames(float(s["stale_s"]))
        self.clock: Clock = SimClock(s["clock"], room.name) if s.get("clock") else WallClock()
        self.link, self.remote = (
            listen_udp(tuple(s["link"]["local"]), "the vision link"),
            tuple(s["link"]["remote"]),
        )
        self.simulated = bool(s["simulated"])
        self.vehicle, self.body = str(s["vehicle"]), str(s["body"])
        self.after = ShutdownPolicy(limit_s=60.0 if self.simulated else None)
        self.reported, self.poses_then, self.ready = time.monotonic(), 0, False
        self.refreshed = self.reported
        self.poses_from: float | None = None
        self.gap_sleep = _PoseGapSleep(1.0 / float(s["rate_hz"]))

    def serve(self) -> None:
        """Forward poses until a stop signal arrives. A real vehicle that is armed is served until it is
        disarmed. If the supervisor has died, a simulated vehicle is served in the same way.
        """
        selector = selectors.DefaultSelector()
        selector.register(self.capture, selectors.EVENT_READ)
        selector.register(self.link, selectors.EVENT_READ)
        next_tick = time.monotonic()
        while not (self.room.stopping and self.room.may_end(self._armed_real())):
            self.gap_sleep.sleep()
            selector.select(max(0.0, next_tick - time.monotonic()))
            now, wall = self.clock.now(), time.monotonic()
            pose = self.core.on_frames(self.capture.poll(now), now)
            self._send(pose)
            if pose is not None:
                self.gap_sleep.on_sent(wall)
            self._read_link(now)
            if wall >= next_tick:
                next_tick = wall + _TICK_S
                if self._tick(now, wall):
                    return

    def _armed_real(self) -> list[str]:
        """Return the name of the vehicle if it is real and its last heartbeat reported that it is armed."""
        return [self.vehicle] if self.core.autopilot.armed and not self.simulated else []

    def _tick(self, now: float, wall: float) -> bool:
        for data in self.core.tick(now):
            self._send(data)
        if not self.ready and self.core.serving:
            self.ready = True
            self.room.ready()
        if wall - self.reported >= 1.0:
            self._report(now, wall)
            self._report_diagnosis()
        self._refresh_definition(wall)
        a = self.core.autopilot
        # A silent simulated autopilot has ended; a silent real one may be flying with a lost radio link.
        armed = a.armed and (now - a.last_heartbeat < 5.0 or not self.simulated)
        return self.after.over(orphaned=self.room.orphaned, any_armed=armed, now=wall)

    def _refresh_definition(self, wall: float) -> None:
        """Request the definition of a real vehicle's body regularly while the vehicle is disarmed, because its axes check depends on it."""
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
        self.room.stats({**flow, **_latency(self.core.lateness), **body, **dropped, **received, **garbled})

    def _report_diagnosis(self) -> None:
        """Report to the supervisor and the log why no poses arrive, each time the reason changes."""
        late = self.late_frames.diagnosis(self.core.late_s)
        change = self.mocap_report.changed(self.capture.diagnosis() or late)
        if change is not None:
            self.room.event(change)
            print(f"forward: {change}", file=sys.stderr, flush=True)

    def _read_link(self, now: float) -> None:
        for _ in range(64):
            try:
                data, sender = self.link.recvfrom(65535)
            except OSError:
                return
            if sender == self.remote:
                self.core.on_mavlink(data, now)
            else:
                self.core.counts["foreign datagram"] += 1

    def _send(self, data: bytes | None) -> None:
        if data is not None:
            with contextlib.suppress(OSError):
                self.link.sendto(data, self.remote)


def _latency(lateness: Lateness) -> dict[str, float | None]:
    """Return the latency of the last frame, from exposure to arrival, and the largest possible error of this latency
    [ms]. None before the server has answered an echo request.
    """
    if not math.isfinite(lateness.latency_s):
        return {"latency_ms": None, "latency_error_ms": None}
    return {
        "latency_ms": round(1e3 * lateness.latency_s, 1),
        "latency_error_ms": round(1e3 * lateness.clock_error_s, 1),
    }


if __name__ == "__main__":
    sys.exit(main())
