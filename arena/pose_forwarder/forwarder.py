"""The pose forwarder without sockets or clocks: captured frames in, MAVLink for the autopilot's vision link out.

A pose goes on only when it is new, tracked, moving as a measured pose does, and fresh; every other one is dropped and counted
by its reason, never sent again. Poses are stamped on arrival by the autopilot, and this process never answers TIMESYNC: with
the filter locked PX4 would count the delay twice.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import globe_from_local
from arena.mocap.client import CapturedFrame, Pose
from arena.mocap.client.frame_order import FrameOrder
from arena.pose_forwarder.lateness import Lateness
from arena.wire.mavlink_codec import Codec
from arena.wire.px4_mode import mode_words

COMPONENT = 197  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
_NAN = math.nan
_UNKNOWN = [_NAN] * 21
_FAR_M = 1e4
_REORDERED_MS = 500  # an autopilot's time that runs back by less came out of order
_SAME_PLACE_E7 = 10
_SILENT_S = 3.0
_ORIGIN_TRIES = 5
_HOLD_S, _HOLD_UNKNOWN_S = 3.0, 0.3
_PLACE = 43003  # MAV_CMD_EXTERNAL_POSITION_ESTIMATE, not in every version's dialect
_DIAGONAL = (0, 6, 11, 15, 18, 20)
_NOBODY_ARMS_IN = frozenset({"AUTO.LAND", "AUTO.RTL", "TERMINATION"})


@dataclass(slots=True)
class Autopilot:
    """What the vision link has told of the autopilot. Times are the caller's [s].

    since: when it was first heard. on_ground: its own word, None before. placed: it has answered where it is on the globe.
    """

    heard: float = -math.inf
    since: float = math.inf
    armed: bool = False
    on_ground: bool | None = None
    placed: bool = False
    may_arm: bool = False
    mode: str = ""
    boot_ms: int = 0
    has_origin: bool = False


class Forwarder:
    """settings: the `forward` slice. listen_s: how long the first pose waits for a word of the autopilot [s]."""

    def __init__(self, settings: Mapping[str, Any], listen_s: float = 0.0) -> None:
        self._listen_s, self._listening_since = listen_s, math.inf
        self.system = int(settings["id"])
        self._body, self._origin = settings["body"], settings["origin"]
        self._every = round(float(settings["frame_rate_hz"]) / float(settings["rate_hz"]))
        self._stale_s = float(settings["stale_s"])
        noise = settings["noise"]
        var_p, var_a = float(noise["position_m"]) ** 2, math.radians(float(noise["rotation_deg"])) ** 2
        # Without noise a body at rest repeats its pose to the last bit, and is not frozen for that.
        self._noisy = var_p > 0.0 or var_a > 0.0
        self._covariance = [0.0] * 21
        for place, variance in zip(_DIAGONAL, (var_p,) * 3 + (var_a,) * 3, strict=True):
            self._covariance[place] = variance
        self._codec = Codec(self.system, COMPONENT)
        self.autopilot = Autopilot()
        self.counts: Counter[str] = Counter()
        self.garbled = self._codec.counts
        self.poses = 0
        self.last_pose = -math.inf
        self._order, self._lateness = FrameOrder(), Lateness(self._stale_s)
        self._turn: int | None = None
        self._last: Pose | None = None
        self._newest: Pose | None = None
        self._resets = 0
        self._beat = -math.inf
        self._origin_asked, self._origin_tries = -math.inf, 0

    # -- capture -------------------------------------------------------------------------------------------------------

    def on_frame(self, frame: CapturedFrame, now: float) -> bytes | None:
        """A frame that has just arrived -> ODOMETRY to send, or None. now: [s]."""
        return self.on_frames([frame], now)

    def on_frames(self, frames: Sequence[CapturedFrame], now: float) -> bytes | None:
        """Frames that were found waiting together, oldest first. The newest pose alone goes on: the autopilot dates them all on
        arrival, and of two at once would keep either.
        """
        best: Pose | None = None
        for frame in frames:
            pose = self._take(frame, now)
            if pose is not None:
                if best is not None:
                    self.counts["superseded"] += 1
                best = pose
        if best is None:
            return None
        self._newest = best
        if self._holds_back(now):
            self.counts["held for the origin"] += 1
            return None
        self.poses, self.last_pose = self.poses + 1, now
        return self._odometry(best, now)

    def _take(self, frame: CapturedFrame, now: float) -> Pose | None:
        """The pose to send on, or None with its reason counted."""
        place = self._order.place(frame.number)
        if place == "repeated":
            self.counts["repeated frame"] += 1
            return None
        if place == "restarted":
            self._capture_restarted()
        late = self._lateness.of(frame.time_s, now, self.autopilot.armed)
        pose = next((p for p in frame.poses if p.body == self._body), None)
        wrong = self._wrong(frame, pose, late)
        if wrong:
            self.counts[wrong] += 1
            return None
        # One pose of each `every` frames, by their numbers: the second stands in for a first that was lost, and the next ones
        # keep their turn.
        turn = frame.number // self._every
        if turn == self._turn:
            return None
        self._turn = turn
        return pose

    def _wrong(self, frame: CapturedFrame, pose: Pose | None, late: float) -> str:
        """Why the pose of a frame must not go on; empty when it may."""
        if pose is None:
            return "untracked" if self._body in frame.untracked else "body not in frame"
        last, self._last = self._last, pose
        if not _is_pose(pose):
            return "no pose"
        if self._noisy and last is not None and (pose.p_n, pose.q_nb) == (last.p_n, last.q_nb):
            return "frozen"
        return "stale" if late > self._stale_s else ""

    def _capture_restarted(self) -> None:
        """Other numbers, another clock, perhaps another origin: the autopilot is told by the reset counter."""
        self.counts["capture restarts"] += 1
        self._lateness.forget()
        self._turn = self._last = None
        self._resets = (self._resets + 1) % 256

    def _odometry(self, pose: Pose, now: float) -> bytes:
        m = mavlink.MAVLink_odometry_message(
            int(now * 1e6),
            mavlink.MAV_FRAME_LOCAL_NED,
            mavlink.MAV_FRAME_BODY_FRD,
            *pose.p_n,
            pose.q_nb,
            _NAN,
            _NAN,
            _NAN,
            _NAN,
            _NAN,
            _NAN,
            self._covariance,
            _UNKNOWN,
            self._resets,
            mavlink.MAV_ESTIMATOR_TYPE_VISION,
            100,
        )
        return self._codec.pack(m)

    # -- the autopilot -------------------------------------------------------------------------------------------------

    @property
    def serving(self) -> bool:
        """Poses arrive at an autopilot that may arm on them, is armed already, or denies arming for its mode alone: one that was
        told to land stays in that mode on the ground.
        """
        a = self.autopilot
        return self.poses > 0 and (a.may_arm or a.armed or a.mode in _NOBODY_ARMS_IN)

    def on_mavlink(self, data: bytes, now: float) -> None:
        """A datagram from the autopilot."""
        for m in self._codec.parse(data):
            if m.get_srcSystem() == self.system and m.get_srcComponent() == 1:
                self._hear(m, now)
            else:
                self.counts["foreign message"] += 1

    def _hear(self, m: Any, now: float) -> None:
        a, kind = self.autopilot, m.get_type()
        if kind == "HEARTBEAT" and now - a.heard > _SILENT_S:
            self._restarted()
        a.since = min(a.since, now)
        if kind == "HEARTBEAT":
            a.heard, a.armed = now, bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            a.mode = mode_words(m.custom_mode)
        elif kind == "SYS_STATUS":
            bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
            a.may_arm = bool(m.onboard_control_sensors_health & bit)  # PX4 sets this bit in the health alone
        elif kind == "SYSTEM_TIME":
            if m.time_boot_ms < a.boot_ms - _REORDERED_MS:
                self._restarted()
            a.boot_ms = m.time_boot_ms
        elif kind == "EXTENDED_SYS_STATE":
            a.on_ground = m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        elif kind == "COMMAND_ACK":
            a.placed = a.placed or (m.command == _PLACE and m.target_component in (0, COMPONENT))
        elif kind == "HOME_POSITION" or (kind == "GPS_GLOBAL_ORIGIN" and self._is_ours(m)):
            a.has_origin = self._origin_tries > 0  # what it said before it was asked may be another place

    def _is_ours(self, m: Any) -> bool:
        o = self._origin
        return (
            o is not None
            and max(abs(m.latitude - o["lat_deg"] * 1e7), abs(m.longitude - o["lon_deg"] * 1e7))
            < _SAME_PLACE_E7
        )

    def _restarted(self) -> None:
        """A new autopilot knows no origin and may not arm yet."""
        a = self.autopilot
        a.has_origin = a.may_arm = a.placed = False
        a.since, a.on_ground = math.inf, None
        self._origin_tries = 0

    def _holds_back(self, now: float) -> bool:
        """On the ground the origin and the place go before the first pose.

        PX4's estimator begins where its charts begin. One that already follows poses takes the jump to a new origin for an error
        of theirs, of thousands of km, and refuses them for a second; its first pose after a lone origin is as far off, and fails
        the preflight check "horizontal position unstable" for two.
        """
        a = self.autopilot
        if self._origin is None or a.placed or a.has_origin or a.armed or a.on_ground is False:
            return False
        if a.since == math.inf:
            self._listening_since = min(self._listening_since, now)
            return 0.0 <= now - self._listening_since < self._listen_s
        return 0.0 <= now - a.since < (_HOLD_S if a.on_ground else _HOLD_UNKNOWN_S)

    def tick(self, now: float) -> list[bytes]:
        """What is due: the heartbeat, and the origin until it is known."""
        due = []
        if now - self._beat >= 1.0:
            self._beat = now
            due.append(self._codec.onboard_heartbeat())
        a = self.autopilot
        asks = (
            self._origin is not None
            and not a.has_origin
            and not a.armed
            and self._origin_tries < _ORIGIN_TRIES
        )
        if (
            asks
            and self._newest is not None
            and now - a.heard < _SILENT_S
            and now - self._origin_asked >= 1.0
        ):
            self._origin_asked, self._origin_tries = now, self._origin_tries + 1
            due += self._where(self._newest)
        return due

    def _where(self, pose: Pose) -> list[bytes]:
        """The origin, and where on the globe this pose is.

        Both on sea level, wherever the arena is: after a gap PX4's estimator takes its height anew from the first pose as if
        the origin's altitude were 0, and with another one it would believe to be so much lower all at once.
        """
        assert self._origin is not None
        lat, lon = self._origin["lat_deg"], self._origin["lon_deg"]
        north, east, _ = pose.p_n
        there = globe_from_local(lat, lon, north, east)
        accuracy_m = max(math.sqrt(self._covariance[0]), 0.01)
        origin = mavlink.MAVLink_set_gps_global_origin_message(
            self.system, round(lat * 1e7), round(lon * 1e7), 0, 0
        )
        place = mavlink.MAVLink_command_int_message(
            self.system,
            1,
            mavlink.MAV_FRAME_GLOBAL,
            _PLACE,
            0,
            0,
            0.0,
            0.0,
            accuracy_m,
            0.0,
            round(there[0] * 1e7),
            round(there[1] * 1e7),
            _NAN,
        )
        return [self._codec.pack(origin), self._codec.pack(place)]


def _is_pose(pose: Pose) -> bool:
    norm = math.sqrt(sum(x * x for x in pose.q_nb))
    return 0.9 < norm < 1.1 and all(abs(x) < _FAR_M for x in pose.p_n)
