"""One vehicle's MAVLink face: bytes in per link, bytes out per link, nothing else. No sockets, no clock.

What it hears becomes calls on the commander, parameter writes, offboard setpoints and vision samples; what it says are the
streams, acknowledgements and texts. Anything may arrive: what cannot be parsed, is not for this vehicle or is not understood
is counted, and never raises.
"""

from __future__ import annotations

import heapq
import math
import struct
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import offboard, streams
from arena.autopilot.commander import CRITICAL, Commander, Limits, Mode, Sensed, mode_of
from arena.autopilot.params import SPECS, Params
from arena.autopilot.snapshot import Snapshot
from arena.autopilot.vision import Vision, from_odometry, from_vision_estimate
from arena.wire.codec import Codec

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
FORCE_MAGIC = 21196.0
_PARAMS_PER_STEP = 8
_QUEUE_LIMIT = 256
_TEXT_BYTES = 50
Wgs = tuple[float, float, float]


@dataclass(slots=True)
class _Link:
    """One MAVLink channel. due: heap of (time, message id, generation)."""

    name: str
    codec: Codec
    out: list[bytes] = field(default_factory=list)
    due: list[tuple[float, int, int]] = field(default_factory=list)
    interval: dict[int, float] = field(default_factory=dict)
    generation: dict[int, int] = field(default_factory=dict)
    params_left: deque[int] = field(default_factory=deque)
    gcs_heard: float = -1e9


class Face:
    """i: row in the fleet; system: MAV_SYS_ID. `vision` and `setpoint` are the newest heard, for the fleet to take."""

    def __init__(self, i: int, name: str, system: int, params: Params) -> None:
        self.i, self.system, self.params = i, system, params
        self.commander = Commander(name)
        self.vision: Vision | None = None
        self.setpoint: offboard.Offboard | None = None
        self.setpoint_at = -1e9
        self.takeoff_d = math.nan
        self.origin: Wgs | None = None
        self.home_n: list[float] | None = None
        self.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND
        self.ready_to_arm = False
        self.aligned = False
        self.reboot_asked = False
        self.counts: Counter[str] = Counter()
        self.sensed: Sensed | None = None
        self.limits: Limits | None = None
        self._q_nb = [1.0, 0.0, 0.0, 0.0]
        self._now = 0.0
        self._text_id = 0
        self._links = {name: self._open(name) for name in streams.LINK_RATES}

    def _open(self, name: str) -> _Link:
        link = _Link(name, Codec(self.system, 1))
        # All streams of a vehicle in phase, so that what is due together leaves in one datagram; the vehicles out of phase.
        for msgid, hz in streams.LINK_RATES[name].items():
            self._schedule(link, msgid, 1.0 / hz, first=0.004 * (self.i % 5))
        return link

    def _schedule(self, link: _Link, msgid: int, interval_s: float, first: float) -> None:
        link.interval[msgid] = interval_s
        generation = link.generation[msgid] = link.generation.get(msgid, 0) + 1
        if interval_s > 0:
            heapq.heappush(link.due, (first, msgid, generation))

    # -- hearing -------------------------------------------------------------------------------------------------------

    def receive(self, link_name: str, data: bytes, now: float, q_nb: list[float]) -> None:
        """One datagram. now: [s]; q_nb: attitude now, for setpoints in body axes."""
        link = self._links[link_name]
        self._now, self._q_nb = now, q_nb
        for message in link.codec.parse(data):
            self._hear(link, message)

    def _hear(self, link: _Link, m: Any) -> None:
        handler = _HANDLERS.get(m.get_msgId())
        if handler is None:
            self.counts["not for us"] += 1
        elif getattr(m, "target_system", 0) not in (0, self.system) or getattr(m, "target_component", 0) not in (0, 1):
            self.counts["other target"] += 1
        elif m.get_srcSystem() == self.system and m.get_srcComponent() == 1:
            self.counts["own echo"] += 1
        else:
            handler(self, link, m)

    def _on_heartbeat(self, link: _Link, m: Any) -> None:
        if m.type == mavlink.MAV_TYPE_GCS:
            link.gcs_heard = self._now

    def _on_position_target(self, link: _Link, m: Any) -> None:
        self._take_setpoint(offboard.from_position_target(m, self._q_nb))

    def _on_attitude_target(self, link: _Link, m: Any) -> None:
        self._take_setpoint(offboard.from_attitude_target(m))

    def _take_setpoint(self, found: offboard.Offboard | str) -> None:
        if isinstance(found, str):
            self.counts["refused setpoint"] += 1
            if self.counts["refused setpoint"] % 100 == 1:
                self.commander.say(CRITICAL, f"Setpoint ignored: {found}")
            return
        self.setpoint, self.setpoint_at = found, self._now

    def _on_odometry(self, link: _Link, m: Any) -> None:
        self._take_vision(from_odometry(m))

    def _on_vision_estimate(self, link: _Link, m: Any) -> None:
        self._take_vision(from_vision_estimate(m))

    def _take_vision(self, found: Vision | None) -> None:
        self.counts["vision" if found else "vision refused"] += 1
        if found:
            self.vision = found

    def _on_origin(self, link: _Link, m: Any) -> None:
        lat, lon, alt = m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3
        if abs(lat) <= 90.0 and abs(lon) <= 180.0 and not self.commander.armed:
            self.origin = (lat, lon, alt)
            self.send(link, streams.gps_global_origin(self, _stamp(self._now)))

    def _on_timesync(self, link: _Link, m: Any) -> None:
        if m.tc1 == 0:
            self.send(link, mavlink.MAVLink_timesync_message(int(self._now * 1e9), m.ts1))

    def _on_ping(self, link: _Link, m: Any) -> None:
        if m.target_system == 0:
            self.send(link, mavlink.MAVLink_ping_message(m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent()))

    def _on_mission_list(self, link: _Link, m: Any) -> None:
        self.send(link, mavlink.MAVLink_mission_count_message(m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type))

    # -- parameters ----------------------------------------------------------------------------------------------------

    def _on_param_list(self, link: _Link, m: Any) -> None:
        link.params_left = deque(range(len(self.params.names)))

    def _on_param_read(self, link: _Link, m: Any) -> None:
        if m.param_index >= 0:
            if m.param_index < len(self.params.names):
                self._send_param(link, self.params.names[m.param_index])
        elif m.param_id in self.params:
            self._send_param(link, m.param_id)
        # An unknown name is answered with silence, as PX4 does.

    def _on_param_set(self, link: _Link, m: Any) -> None:
        spec = SPECS.get(m.param_id)
        if spec is None:
            self.counts["unknown parameter"] += 1
            return
        expected = mavlink.MAV_PARAM_TYPE_INT32 if spec.type == "int32" else mavlink.MAV_PARAM_TYPE_REAL32
        if m.param_type != expected:
            self.commander.say(CRITICAL, f"Parameter {m.param_id}: wrong type")
        else:
            value = struct.unpack("<i", struct.pack("<f", m.param_value))[0] if spec.type == "int32" else m.param_value
            try:
                self.params.set(self.i, m.param_id, value)
            except ValueError as error:
                self.commander.say(CRITICAL, str(error)[:50])
        self._send_param(link, m.param_id)

    def _send_param(self, link: _Link, name: str) -> None:
        value = float(self.params[name][self.i])
        if SPECS[name].type == "int32":
            value, kind = struct.unpack("<f", struct.pack("<i", int(value)))[0], mavlink.MAV_PARAM_TYPE_INT32
        else:
            kind = mavlink.MAV_PARAM_TYPE_REAL32
        names = self.params.names
        self.send(link, mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(names), self.params.index[name]))

    # -- commands ------------------------------------------------------------------------------------------------------

    def _on_command_long(self, link: _Link, m: Any) -> None:
        self._command(link, m, (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7))

    def _on_command_int(self, link: _Link, m: Any) -> None:
        self._command(link, m, (m.param1, m.param2, m.param3, m.param4, m.x * 1e-7, m.y * 1e-7, m.z))

    def _command(self, link: _Link, m: Any, p: tuple[float, ...]) -> None:
        handler = _COMMANDS.get(m.command)
        if self.sensed is not None:
            # Decided every few steps; a setpoint heard since then counts, for clients ask for OFFBOARD right after their first.
            self.sensed.offboard_age = self._now - self.setpoint_at
            self.sensed.offboard_needs_position = self.setpoint is not None and self.setpoint.needs_position
        if self.sensed is None or self.limits is None:
            result = TEMPORARILY_REJECTED
        elif handler is None:
            result = UNSUPPORTED
            self.counts["unsupported command"] += 1
        else:
            result = handler(self, link, p)
        ack = mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent())
        self.send(link, ack)

    def _arm_disarm(self, link: _Link, p: tuple[float, ...]) -> int:
        assert self.sensed and self.limits  # _command asked
        force = p[1] == FORCE_MAGIC
        if p[0] == 1.0:
            why = self.commander.arm(self.sensed, self.limits, force=force)
        elif p[0] == 0.0:
            why = self.commander.disarm(self.sensed, force=force)
        else:
            return DENIED
        return TEMPORARILY_REJECTED if why else ACCEPTED

    def _change_mode(self, mode: Mode | None) -> int:
        assert self.sensed and self.limits
        return TEMPORARILY_REJECTED if self.commander.request_mode(mode, self.sensed, self.limits) else ACCEPTED

    def _set_mode(self, link: _Link, p: tuple[float, ...]) -> int:
        if not all(math.isfinite(x) for x in p[:3]) or not int(p[0]) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        return self._change_mode(mode_of(int(p[1]), int(p[2])))

    def _land(self, link: _Link, p: tuple[float, ...]) -> int:
        return self._change_mode(Mode.LAND)

    def _takeoff(self, link: _Link, p: tuple[float, ...]) -> int:
        self.takeoff_d = self.origin[2] - p[6] if self.origin and math.isfinite(p[6]) and p[6] != 0.0 else math.nan
        return self._change_mode(Mode.TAKEOFF)

    def _set_interval(self, link: _Link, p: tuple[float, ...]) -> int:
        if not all(math.isfinite(x) for x in p[:2]) or int(p[0]) not in streams.BUILDERS:
            return FAILED
        msgid, us = int(p[0]), p[1]
        default = streams.LINK_RATES[link.name].get(msgid, 0.0)
        interval = (1.0 / default if default else 0.0) if us == 0 else us * 1e-6 if us > 0 else 0.0
        self._schedule(link, msgid, max(interval, 0.004) if interval else 0.0, first=self._now + interval)
        return ACCEPTED

    def _get_interval(self, link: _Link, p: tuple[float, ...]) -> int:
        if not math.isfinite(p[0]) or not 0 <= p[0] < 65536:
            return DENIED
        interval = link.interval.get(int(p[0]), 0.0)
        us = int(interval * 1e6) if interval else 0 if int(p[0]) not in streams.BUILDERS else -1
        self.send(link, mavlink.MAVLink_message_interval_message(int(p[0]), us))
        return ACCEPTED

    def _request(self, link: _Link, p: tuple[float, ...]) -> int:
        if not math.isfinite(p[0]) or int(p[0]) not in streams.BUILDERS:
            return DENIED
        # Due now, once: the next transmit has the snapshot it is made from.
        heapq.heappush(link.due, (self._now, int(p[0]), -1))
        return ACCEPTED

    def _capabilities(self, link: _Link, p: tuple[float, ...]) -> int:
        return self._request(link, (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,))

    def _reboot(self, link: _Link, p: tuple[float, ...]) -> int:
        if p[0] not in (1.0, 3.0):
            return UNSUPPORTED if p[0] else ACCEPTED
        if self.commander.armed:
            return DENIED
        self.reboot_asked = True
        return ACCEPTED

    def _terminate(self, link: _Link, p: tuple[float, ...]) -> int:
        if p[0] < 1.5 and self.commander.armed:
            self.commander.terminate(self._now, "by command")
        return ACCEPTED

    # -- speaking ------------------------------------------------------------------------------------------------------

    def send(self, link: _Link, message: Any) -> None:
        if message is not None and len(link.out) < _QUEUE_LIMIT:
            link.out.append(link.codec.pack(message))

    def speak(self, s: Snapshot) -> None:
        """Put on each link what is due at this step."""
        now = s.now_s
        texts, self.commander.texts = self.commander.texts, []
        for link in self._links.values():
            if texts and now - link.gcs_heard < 10.0:
                for severity, text in texts:
                    self._say(link, severity, text)
            for _ in range(min(_PARAMS_PER_STEP, len(link.params_left))):
                self._send_param(link, self.params.names[link.params_left.popleft()])
            self._speak_due(link, s, now)

    def _say(self, link: _Link, severity: int, text: str) -> None:
        """A text longer than one message holds goes out in numbered chunks, as the STATUSTEXT of MAVLink 2 allows."""
        raw = text.encode(errors="replace")
        chunks = [raw[k : k + _TEXT_BYTES] for k in range(0, len(raw), _TEXT_BYTES)]
        self._text_id = self._text_id % 65535 + 1
        for k, chunk in enumerate(chunks):
            self.send(link, mavlink.MAVLink_statustext_message(severity, chunk, self._text_id if len(chunks) > 1 else 0, k))

    def _speak_due(self, link: _Link, s: Snapshot, now: float) -> None:
        due = link.due
        while due and due[0][0] <= now + 1e-6:
            when, msgid, generation = heapq.heappop(due)
            if generation == -1:
                self.send(link, streams.BUILDERS[msgid](self, s))
            elif generation == link.generation[msgid]:
                self.send(link, streams.BUILDERS[msgid](self, s))
                heapq.heappush(due, (max(when + link.interval[msgid], now - 0.1), msgid, generation))

    def take_out(self) -> list[tuple[str, bytes]]:
        """What to send now: one datagram a link."""
        found = []
        for name, link in self._links.items():
            if link.out:
                found.append((name, b"".join(link.out)))
                link.out = []
        return found

    def garbled(self) -> Counter[str]:
        """What was heard and could not be read, over all links."""
        return sum((link.codec.counts for link in self._links.values()), Counter())

    def gcs_age(self, now: float) -> float:
        """Since the last ground-station heartbeat on any link [s]."""
        return now - max(link.gcs_heard for link in self._links.values())

    def global_from_local(self, p_n: list[float]) -> tuple[int, int, float]:
        """p_n [m] [NED] -> latitude, longitude [1e-7 deg] and altitude AMSL [m], around the origin."""
        assert self.origin
        lat0, lon0, alt0 = self.origin
        lat = lat0 + math.degrees(p_n[0] / streams.EARTH_RADIUS_M)
        lon = lon0 + math.degrees(p_n[1] / (streams.EARTH_RADIUS_M * math.cos(math.radians(lat0))))
        return int(lat * 1e7), int(lon * 1e7), alt0 - p_n[2]


def _stamp(now: float) -> Any:
    """A stand-in snapshot for builders that read nothing but the time."""

    class Stamp:
        now_s = now

    return Stamp


_HANDLERS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Face._on_heartbeat,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: Face._on_command_long,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: Face._on_command_int,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: Face._on_position_target,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: Face._on_attitude_target,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: Face._on_odometry,
    mavlink.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: Face._on_vision_estimate,
    mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: Face._on_origin,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: Face._on_timesync,
    mavlink.MAVLINK_MSG_ID_PING: Face._on_ping,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: Face._on_param_list,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: Face._on_param_read,
    mavlink.MAVLINK_MSG_ID_PARAM_SET: Face._on_param_set,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: Face._on_mission_list,
}

_COMMANDS = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: Face._arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: Face._set_mode,
    mavlink.MAV_CMD_NAV_LAND: Face._land,
    mavlink.MAV_CMD_NAV_TAKEOFF: Face._takeoff,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: Face._set_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: Face._get_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: Face._request,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: Face._capabilities,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: Face._reboot,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: Face._terminate,
}
