"""The pose forwarder without sockets or clocks: captured frames in, MAVLink for the autopilot's vision link out.

A pose goes on only when it is new, tracked, moving as a measured pose does, and fresh; every other one is dropped and counted
by its reason, never sent again. Poses are stamped on arrival by the autopilot, and this process never answers TIMESYNC: with
the filter locked PX4 would count the delay twice.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.capture import CapturedFrame, Pose
from arena.wire.codec import Codec

COMPONENT = 197  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
_NAN = math.nan
_UNKNOWN = [_NAN] * 21
_SILENT_S = 3.0
_ORIGIN_TRIES = 5
_DIAGONAL = (0, 6, 11, 15, 18, 20)


@dataclass(slots=True)
class Autopilot:
    """What the vision link has told of the autopilot. Times are the caller's [s]."""

    heard: float = -math.inf
    armed: bool = False
    may_arm: bool = False
    boot_ms: int = 0
    has_origin: bool = False


class Forwarder:
    """settings: the `forward` slice."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.system = int(settings["id"])
        self._body, self._origin = settings["body"], settings["origin"]
        every = float(settings["frame_rate_hz"]) / float(settings["rate_hz"])
        self._every = round(every)
        self._stale_s = float(settings["stale_s"])
        noise = settings["noise"]
        var_p, var_a = float(noise["position_m"]) ** 2, math.radians(float(noise["rotation_deg"])) ** 2
        self._covariance = list(_UNKNOWN)
        for place, variance in zip(_DIAGONAL, (var_p,) * 3 + (var_a,) * 3, strict=True):
            self._covariance[place] = variance
        self._codec = Codec(self.system, COMPONENT)
        self.autopilot = Autopilot()
        self.counts: Counter[str] = Counter()
        self.garbled = self._codec.counts
        self.poses = 0
        self.last_pose = -math.inf
        self._number: int | None = None
        self._server_offset = math.inf
        self._last: Pose | None = None
        self._beat = -math.inf
        self._origin_asked, self._origin_tries = -math.inf, 0

    # -- capture -------------------------------------------------------------------------------------------------------

    def on_frame(self, frame: CapturedFrame, now: float) -> bytes | None:
        """A frame that has just arrived -> ODOMETRY to send, or None. now: [s]."""
        if self._number is not None and 0 <= self._number - frame.number < 10_000:
            self.counts["repeated frame"] += 1
            return None
        self._number = frame.number
        late = self._lateness(frame.time_s, now)
        pose = next((p for p in frame.poses if p.body == self._body), None)
        if pose is None:
            self.counts["untracked" if self._body in frame.untracked else "body not in frame"] += 1
            return None
        frozen = self._last is not None and pose.p_n == self._last.p_n and pose.q_nb == self._last.q_nb
        self._last = pose
        # By number, so that a lost frame does not shift the others' turn.
        if frame.number % self._every:
            return None
        if frozen:
            self.counts["frozen"] += 1
            return None
        if late > self._stale_s:
            self.counts["stale"] += 1
            return None
        self.poses, self.last_pose = self.poses + 1, now
        return self._odometry(pose, now)

    def _lateness(self, stamp_s: float, now: float) -> float:
        """How much later than the promptest frame so far this one came [s]. The server's clock may drift: the promptest ages."""
        offset = now - stamp_s
        if offset < self._server_offset or offset - self._server_offset > 10.0:
            self._server_offset = offset
        late = offset - self._server_offset
        self._server_offset += 1e-4 * min(late, 0.01)
        return late

    def _odometry(self, pose: Pose, now: float) -> bytes:
        m = mavlink.MAVLink_odometry_message(
            int(now * 1e6), mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, *pose.p_n, pose.q_nb, _NAN, _NAN, _NAN, _NAN, _NAN,
            _NAN, self._covariance, _UNKNOWN, 0, mavlink.MAV_ESTIMATOR_TYPE_VISION, 100,
        )  # fmt: skip
        return self._codec.pack(m)

    # -- the autopilot -------------------------------------------------------------------------------------------------

    @property
    def serving(self) -> bool:
        """Poses arrive at an autopilot that may arm on them, or is armed already."""
        return self.poses > 0 and (self.autopilot.may_arm or self.autopilot.armed)

    def on_mavlink(self, data: bytes, now: float) -> None:
        """A datagram from the autopilot."""
        for m in self._codec.parse(data):
            if m.get_srcSystem() == self.system and m.get_srcComponent() == 1:
                self._hear(m, now)
            else:
                self.counts["foreign message"] += 1

    def _hear(self, m: Any, now: float) -> None:
        a, kind = self.autopilot, m.get_type()
        if kind == "HEARTBEAT":
            if now - a.heard > _SILENT_S:
                self._restarted()
            a.heard, a.armed = now, bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == "SYS_STATUS":
            bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
            a.may_arm = bool(m.onboard_control_sensors_enabled & m.onboard_control_sensors_health & bit)
        elif kind == "SYSTEM_TIME":
            if m.time_boot_ms < a.boot_ms:
                self._restarted()
            a.boot_ms = m.time_boot_ms
        elif kind in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION"):
            a.has_origin = True

    def _restarted(self) -> None:
        """A new autopilot knows no origin and may not arm yet."""
        self.autopilot.has_origin = self.autopilot.may_arm = False
        self._origin_tries = 0

    def tick(self, now: float) -> list[bytes]:
        """What is due: the heartbeat, and the origin until it is known."""
        due = []
        if now - self._beat >= 1.0:
            self._beat = now
            m = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
            due.append(self._codec.pack(m))
        a = self.autopilot
        asks = self._origin is not None and not a.has_origin and not a.armed and self._origin_tries < _ORIGIN_TRIES
        if asks and now - a.heard < _SILENT_S and now - self._origin_asked >= 1.0:
            self._origin_asked, self._origin_tries = now, self._origin_tries + 1
            o = self._origin
            due.append(self._codec.pack(mavlink.MAVLink_set_gps_global_origin_message(
                self.system, round(o["lat_deg"] * 1e7), round(o["lon_deg"] * 1e7), round(o["alt_m"] * 1e3), 0
            )))  # fmt: skip
        return due
