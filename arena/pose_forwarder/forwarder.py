"""Converts motion-capture frames to MAVLink messages for the autopilot (external vision).

Opens no sockets and reads no clock: received data and times are arguments.

A pose is forwarded only if it is new, tracked, not frozen and not late. Every other pose is dropped and
counted by its reason.
The autopilot uses the arrival time as the time of the pose. This process never answers TIMESYNC, because PX4
would then compensate the delay twice.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.constants import REORDERED_MS
from arena.geometry import globe_from_local
from arena.kernels.pose_selection import PoseSelection
from arena.mocap.client import CapturedFrame, Pose
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT
from arena.wire.mavlink_ids import FORWARDER_COMPONENT
from arena.wire.mavlink_layout import decoder
from arena.wire.mavlink_records import odometry_frames
from arena.wire.px4_mode import mode_words

_NAN = math.nan
_SAME_ORIGIN_E7 = 10
_SILENT_S = 3.0
_MAVLINK_2 = 0xFD  # first byte of a frame
_MIN_WITHOUT_GAP, _MAX_LOST = 50, 8  # messages, see `_follow_sequence`
_ORIGIN_TRIES = 5
_ORIGIN_WAIT_S, _ORIGIN_WAIT_UNKNOWN_S = 3.0, 0.3
_POSITION_ESTIMATE = 43003  # MAV_CMD_EXTERNAL_POSITION_ESTIMATE, not in every version's dialect
_DIAGONAL = (0, 6, 11, 15, 18, 20)
_READ = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    }
)
"""Messages of the autopilot whose content the forwarder uses."""
_MODES_WITHOUT_ARMING = frozenset({"AUTO.LAND", "AUTO.RTL", "TERMINATION"})


@dataclass(slots=True)
class Autopilot:
    """State of the autopilot, read from the MAVLink messages that the pose forwarder receives.

    Times are by the caller's clock [s].

    selection: selects the poses to forward.  last_heartbeat: time of the last heartbeat. since: time of the first message.
    on_ground: None before it is reported.
    has_position: the autopilot has acknowledged its global position. may_arm: its pre-arm checks pass.
    """

    selection: PoseSelection
    last_heartbeat: float = -math.inf
    since: float = math.inf
    on_ground: bool | None = None
    has_position: bool = False
    may_arm: bool = False
    mode: str = ""
    boot_ms: int = 0
    has_origin: bool = False

    @property
    def armed(self) -> bool:
        """Armed flag of the last heartbeat. It is kept in `selection`, which needs it for each frame."""
        return self.selection.flying

    @armed.setter
    def armed(self, armed: bool) -> None:
        self.selection.flying = armed


class Forwarder:
    """Converter of one vehicle's captured poses to ODOMETRY messages. It also sets the autopilot's origin.

    settings: configuration (slice) of the process `forward.<vehicle>`.
    wait_s: longest time for which the first pose is held back if the autopilot has sent no message [s].
    selection: selects the poses to forward.
    """

    def __init__(self, settings: Mapping[str, Any], wait_s: float = 0.0) -> None:
        self._wait_s, self._waiting_since = wait_s, math.inf
        self.system = int(settings["id"])
        self._origin = settings["origin"]
        self._origin_alt_m = float(settings.get("origin_alt_m", 0.0))
        noise = settings["noise"]
        var_p, var_a = float(noise["position_m"]) ** 2, math.radians(float(noise["rotation_deg"])) ** 2
        self._covariance = [0.0] * 21
        for place, variance in zip(_DIAGONAL, (var_p,) * 3 + (var_a,) * 3, strict=True):
            self._covariance[place] = variance
        self._odometry = odometry_frames(self._covariance, self.system, FORWARDER_COMPONENT)
        self._codec = Codec(self.system, FORWARDER_COMPONENT)
        self.counts: Counter[str] = Counter()
        self.garbled = self._codec.counts
        self.poses = 0
        self.last_pose = -math.inf
        self.selection = PoseSelection(
            str(settings["body"]),
            round(float(settings["frame_rate_hz"]) / float(settings["rate_hz"])),
            float(settings["stale_s"]),
            var_p > 0.0 or var_a > 0.0 or settings.get("simulated") is not True,  # real cameras have noise
            self.counts,
        )
        self.lateness, self.autopilot = self.selection.lateness, Autopilot(self.selection)
        self._newest: Pose | None = None
        self._beat = self._heartbeat_requested = -math.inf
        self._origin_sent, self._origin_tries = -math.inf, 0
        self._next_number = self._without_gap = 0
        self._restarted = False

    # -- capture -------------------------------------------------------------------------------------------------------

    @property
    def late_s(self) -> float:
        """Delay of the last frame compared with the fastest frames [s]."""
        return self.selection.late_s

    def on_frame(self, frame: CapturedFrame, now: float) -> bytes | None:
        """Return the ODOMETRY message for a new motion-capture frame, or None if no pose is forwarded.

        now: time of arrival [s].
        """
        return self.on_frames([frame], now)

    def on_frames(self, frames: Sequence[CapturedFrame], now: float) -> bytes | None:
        """Return an ODOMETRY message with the newest of several received poses; None if no pose is sent.

        Only the newest pose of the vehicle is sent, because the autopilot uses the arrival time as the time of the pose.
        frames: oldest first. now: [s].
        """
        pose = self.selection.newest(frames, now)
        return None if pose is None else self.on_pose(pose, now)

    def on_pose(self, pose: Pose, now: float) -> bytes | None:
        """Return the ODOMETRY message for a selected pose, or None if it must wait for the origin.

        now: time of arrival [s].
        """
        self._newest = pose
        if self._waits_for_origin(now):
            self.counts["held for the origin"] += 1
            return None
        self.poses, self.last_pose = self.poses + 1, now
        sequence = self._codec.take_sequence(1)
        return self._odometry.frame(sequence, int(now * 1e6), pose.p_n, pose.q_nb, self.selection.resets)

    # -- the autopilot -------------------------------------------------------------------------------------------------

    @property
    def serving(self) -> bool:
        """Return whether the forwarder is ready: a pose was forwarded, and the vehicle is armed or can be armed.

        True also in modes that do not allow arming, because the autopilot stays in AUTO.LAND on the ground
        after a landing.
        """
        a = self.autopilot
        return self.poses > 0 and (a.may_arm or a.armed or a.mode in _MODES_WITHOUT_ARMING)

    def on_mavlink(self, data: bytes, now: float) -> None:
        """Update the state of the autopilot from a received MAVLink datagram."""
        for at in self._codec.frames(data):
            of_autopilot = at.sysid == self.system and at.compid == AUTOPILOT
            if of_autopilot:
                self._follow_sequence(data[at.start + (4 if data[at.start] == _MAVLINK_2 else 2)])
            if at.msgid in _READ and of_autopilot:
                self._on_message(at.msgid, decoder(at.msgid)(data, at), now)
                continue
            m = self._codec.decode(data, at)  # counts the messages that it cannot decode
            if m is None:
                continue
            if m.get_srcSystem() == self.system and m.get_srcComponent() == AUTOPILOT:
                self.autopilot.since = min(self.autopilot.since, now)
            else:
                self.counts["foreign message"] += 1

    def _follow_sequence(self, number: int) -> None:
        """Find a restart of the autopilot by the MAVLink sequence numbers, which begin at 0 again.

        A PX4 in lockstep restarts so quickly that no heartbeat is missing, and its time since boot is the simulation time. Only a
        jump to 0 over many numbers, after many numbers without a gap, counts, because messages can be lost, or filtered by a link.
        If the vehicle was armed, the restart takes effect when a heartbeat reports it as disarmed, as a restarted PX4 is.
        """
        skipped = (number - self._next_number) % 256
        self._restarted |= number == 0 and skipped > _MAX_LOST and self._without_gap >= _MIN_WITHOUT_GAP
        self._without_gap = self._without_gap + 1 if skipped == 0 else 0
        self._next_number = (number + 1) % 256
        if self._restarted and not self.autopilot.armed:
            self._restarted = False
            self._on_autopilot_restart()

    def _on_message(self, msgid: int, m: Any, now: float) -> None:
        a = self.autopilot
        if msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT and now - a.last_heartbeat > _SILENT_S:
            self._on_autopilot_restart()
        a.since = min(a.since, now)
        if msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            a.last_heartbeat, a.armed = now, bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            a.mode = mode_words(m.custom_mode)
            self._restarted &= not a.armed
        elif msgid == mavlink.MAVLINK_MSG_ID_SYS_STATUS:
            bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
            a.may_arm = bool(
                m.onboard_control_sensors_health & bit
            )  # PX4 sets this bit in the health field only
        elif msgid == mavlink.MAVLINK_MSG_ID_SYSTEM_TIME:
            if m.time_boot_ms < a.boot_ms - REORDERED_MS:
                self._on_autopilot_restart()
            a.boot_ms = m.time_boot_ms
        elif msgid == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            a.on_ground = m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        elif msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            a.has_position = a.has_position or (
                m.command == _POSITION_ESTIMATE and m.target_component in (0, FORWARDER_COMPONENT)
            )
        elif msgid == mavlink.MAVLINK_MSG_ID_HOME_POSITION or self._is_own_origin(m):
            a.has_origin = self._origin_tries > 0  # an origin reported before the request may be another one

    def _is_own_origin(self, m: Any) -> bool:
        o = self._origin
        return (
            o is not None
            and max(abs(m.latitude - o["lat_deg"] * 1e7), abs(m.longitude - o["lon_deg"] * 1e7))
            < _SAME_ORIGIN_E7
        )

    def _on_autopilot_restart(self) -> None:
        """Reset the stored state of the autopilot after its restart.

        The autopilot then has no origin, and may not be ready to arm.
        """
        a = self.autopilot
        a.has_origin = a.may_arm = a.has_position = False
        a.since, a.on_ground = math.inf, None
        self._origin_tries = 0

    def _waits_for_origin(self, now: float) -> bool:
        """Return whether poses must wait, because the autopilot has no origin or global position yet.

        This is only the case while the vehicle is on the ground.

        If PX4's estimator already uses poses, it takes the jump to a new origin as an error of thousands of
        km and rejects poses for one second. If the origin is set without a global position, the estimator's
        first pose has the same error, and the preflight check "horizontal position unstable" fails for two
        seconds.
        """
        a = self.autopilot
        if self._origin is None or a.has_position or a.has_origin or a.armed or a.on_ground is False:
            return False
        if a.since == math.inf:
            self._waiting_since = min(self._waiting_since, now)
            return 0.0 <= now - self._waiting_since < self._wait_s
        return 0.0 <= now - a.since < (_ORIGIN_WAIT_S if a.on_ground else _ORIGIN_WAIT_UNKNOWN_S)

    def tick(self, now: float) -> list[bytes]:
        """Return the MAVLink messages that must be sent to the autopilot now. now: time [s].

        - HEARTBEAT of the pose forwarder, once a second.
        - MAV_CMD_REQUEST_MESSAGE, once a second until the first HEARTBEAT of the autopilot has arrived.
        - The origin and the global position, once a second until the autopilot has reported the origin, at most _ORIGIN_TRIES times.
        """
        due = []
        if now - self._beat >= 1.0:
            self._beat = now
            due.append(self._codec.onboard_heartbeat())
        a = self.autopilot
        if a.since <= now and a.last_heartbeat == -math.inf and now - self._heartbeat_requested >= 1.0:
            self._heartbeat_requested = now
            due.append(self._codec.pack(self._heartbeat_request()))
        sends_origin = (
            self._origin is not None
            and not a.has_origin
            and not a.armed
            and self._origin_tries < _ORIGIN_TRIES
        )
        if (
            sends_origin
            and self._newest is not None
            and now - a.last_heartbeat < _SILENT_S
            and now - self._origin_sent >= 1.0
        ):
            self._origin_sent, self._origin_tries = now, self._origin_tries + 1
            due += self._global_position(self._newest)
        return due

    def _heartbeat_request(self) -> Any:
        """Return a message that requests a HEARTBEAT from the autopilot at once.

        The origin is sent after the first HEARTBEAT, and the first pose after the origin. Without the request, both would
        be delayed by up to 1 s.
        """
        return mavlink.MAVLink_command_long_message(
            self.system,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_CMD_REQUEST_MESSAGE,
            0,
            float(mavlink.MAVLINK_MSG_ID_HEARTBEAT),
            *(0.0,) * 6,
        )

    def _global_position(self, pose: Pose) -> list[bytes]:
        """Return the two messages that set the autopilot's origin and its global position.

        The global position is computed from `pose`.

        PX4 gets an origin at altitude 0 (sea level): after a gap its estimator resets its height from the first pose as if the
        origin's altitude were 0. With any other altitude the height would jump by that value.
        """
        assert self._origin is not None
        lat, lon = self._origin["lat_deg"], self._origin["lon_deg"]
        north, east, _ = pose.p_n
        there = globe_from_local(lat, lon, north, east)
        accuracy_m = max(math.sqrt(self._covariance[0]), 0.01)
        origin = mavlink.MAVLink_set_gps_global_origin_message(
            self.system, round(lat * 1e7), round(lon * 1e7), round(self._origin_alt_m * 1e3), 0
        )
        place = mavlink.MAVLink_command_int_message(
            self.system,
            1,
            mavlink.MAV_FRAME_GLOBAL,
            _POSITION_ESTIMATE,
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
