"""One vehicle's MAVLink face: bytes in per link, bytes out per link, nothing else. No sockets, no clock.

What it hears becomes calls on the commander, parameter writes, offboard setpoints and vision samples; what it says are the
streams, acknowledgements and texts. Anything may arrive: what cannot be parsed, is not for this vehicle or is not understood
is counted, and never raises.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.commander import CRITICAL, Commander, Limits, Sensed
from arena.autopilot.injected_failures import Failures
from arena.autopilot.manual_control import Sticks
from arena.autopilot.mavlink import (
    command_handlers,
    offboard_setpoints,
    param_protocol,
    streams,
    telemetry_batch,
)
from arena.autopilot.mavlink import mission_protocol as missions
from arena.autopilot.mavlink.external_vision import Vision, from_odometry, from_vision_estimate
from arena.autopilot.mavlink.telemetry_state import Snapshot
from arena.autopilot.navigation.mission_items import local
from arena.autopilot.param_table import Params
from arena.wire import mavlink_records
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Frame
from arena.wire.px4_mode import split_mode

_QUEUE_LIMIT = 256
_TEXT_BYTES = 50
_LATE_S = 0.1  # that a stream catches up
_TICK_S = 1e-6  # of rounding in a time that is a sum
_LOWEST_M, _HIGHEST_M = -12_000.0, 100_000.0  # of an origin, as PX4
Wgs = tuple[float, float, float]


@dataclass(slots=True)
class Link:
    """One MAVLink channel. due: heap of (time, message id), one entry for each that is sent by itself."""

    name: str
    codec: Codec
    out: list[bytes] = field(default_factory=list)
    due: list[tuple[float, int]] = field(default_factory=list)
    interval: dict[int, float] = field(default_factory=dict)
    gcs_heard: float = -1e9


class Face:
    """i: row in the fleet; system: MAV_SYS_ID. `vision` and `setpoint` are the newest heard, for the fleet to take."""

    def __init__(self, i: int, name: str, system: int, params: Params) -> None:
        self.i, self.system, self.params = i, system, params
        self.commander = Commander(name)
        self.vision: Vision | None = None
        self._seen: Vision | None = None
        self.setpoint: offboard_setpoints.Offboard | None = None
        self.setpoint_at = -1e9
        self.takeoff_d = math.nan
        self.origin: Wgs | None = None
        self.home_n: list[float] | None = None
        self.home_yaw = 0.0
        self.missions = missions.Missions(tuple(streams.LINK_RATES))
        self.goto: tuple[float, float, float, float] | None = (
            None  # latitude, longitude [deg], altitude [m], yaw [rad]
        )
        self.speed_asked = math.nan
        self.failures = Failures()
        self.sticks = Sticks()
        self.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND
        self.ready_to_arm = False
        self.aligned = False
        self.pings = 0
        self.reboot_asked = False
        self.counts: Counter[str] = Counter()
        self.sensed: Sensed | None = None
        self.limits: Limits | None = None
        self._q_nb = [1.0, 0.0, 0.0, 0.0]
        self.now = 0.0
        self.param_server = param_protocol.ParamServer(i, params)
        self.newest: Snapshot | None = None  # the fleet's, at its last step
        self._quiet_until = 0.0  # [s]
        self._text_id = 0
        self._links = {name: self._open(name) for name in streams.LINK_RATES}

    def _open(self, name: str) -> Link:
        link = Link(name, Codec(self.system, 1))
        # All streams of a vehicle in phase, so that what is due together leaves in one datagram; the vehicles out of phase.
        for msgid, hz in streams.LINK_RATES[name].items():
            self.schedule(link, msgid, 1.0 / hz, first=0.004 * (self.i % 5))
        return link

    def schedule(self, link: Link, msgid: int, interval_s: float, first: float | None = None) -> None:
        """Send a message by itself every interval_s [s], 0 for not; first: when to begin, one interval from now unless told."""
        self._quiet_until = 0.0
        link.interval[msgid] = interval_s
        link.due = [entry for entry in link.due if entry[1] != msgid]
        if interval_s > 0:
            link.due.append((self.now + interval_s if first is None else first, msgid))
        heapq.heapify(link.due)

    # -- hearing -------------------------------------------------------------------------------------------------------

    def receive(self, link_name: str, data: bytes, now: float, q_nb: list[float]) -> None:
        """One datagram. now: [s]; q_nb: attitude now, for setpoints in body axes."""
        link = self._links[link_name]
        self.now, self._q_nb = now, q_nb
        for at in link.codec.frames(data):
            if at.msgid in _OFTEN_HEARD:
                self._hear_often(data, at)
            elif (message := link.codec.decode(data, at)) is not None:
                self._hear(link, message)

    def _hear_often(self, data: bytes, at: Frame) -> None:
        """What comes many times a second is read without a message object, by the rules of all others."""
        if at.target_sys not in (0, self.system) or at.target_comp not in (0, 1):
            self.counts["other target"] += 1
        elif at.sysid == self.system and at.compid == 1:
            self.counts["own echo"] += 1
        elif at.msgid == mavlink_records.ODOMETRY:
            self._take_vision(from_odometry(mavlink_records.Odometry.read(data, at)))
        else:
            self._take_setpoint(
                offboard_setpoints.from_position_target(
                    mavlink_records.PositionTarget.read(data, at), self._q_nb
                )
            )

    def _hear(self, link: Link, m: Any) -> None:
        self._quiet_until = 0.0
        handler = _HANDLERS.get(m.get_msgId())
        if m.get_msgId() in missions.HEARD:
            self._hear_mission(link, m)
        elif handler is None:
            self.counts["not for us"] += 1
        elif not self._is_meant(m):
            self.counts["other target"] += 1
        elif m.get_srcSystem() == self.system and m.get_srcComponent() == 1:
            self.counts["own echo"] += 1
        else:
            handler(self, link, m)

    def _is_meant(self, m: Any) -> bool:
        system = getattr(m, "target_system", None)
        named = system is None or system == self.system or (system == 0 and m.get_msgId() in _FOR_ALL)
        return named and getattr(m, "target_component", 0) in (0, 1)

    def _on_heartbeat(self, link: Link, m: Any) -> None:
        if m.type == mavlink.MAV_TYPE_GCS:
            link.gcs_heard = self.now

    def _on_radio(self, link: Link, m: Any) -> None:
        self.sticks.hear("radio", self.now)

    def _on_joystick(self, link: Link, m: Any) -> None:
        if m.target in (0, self.system):
            self.sticks.hear("joystick", self.now)

    def _on_global_target(self, link: Link, m: Any) -> None:
        home_down = self.home_n[2] if self.home_n else None
        self._take_setpoint(offboard_setpoints.from_global_target(m, self.local_from_global, home_down))

    def _on_attitude_target(self, link: Link, m: Any) -> None:
        self._take_setpoint(offboard_setpoints.from_attitude_target(m))

    def _take_setpoint(self, found: offboard_setpoints.Offboard | str) -> None:
        if isinstance(found, str):
            self.counts["refused setpoint"] += 1
            if found and self.counts["refused setpoint"] % 100 == 1:
                self.commander.say(CRITICAL, f"Setpoint ignored: {found}")
            return
        self.setpoint, self.setpoint_at = found, self.now

    def _on_vision_estimate(self, link: Link, m: Any) -> None:
        self._take_vision(from_vision_estimate(m))

    def _take_vision(self, found: Vision | None) -> None:
        """In the air no measured pose is the same to the last bit as the one before: a repeated one says nothing of now."""
        flying = self.sensed is not None and self.sensed.flying
        if found and flying and self._seen and (found.p_n, found.q_nb) == (self._seen.p_n, self._seen.q_nb):
            self.counts["vision repeated"] += 1
            return
        self.counts["vision" if found else "vision refused"] += 1
        if found:
            self.vision = self._seen = found

    def _on_origin(self, link: Link, m: Any) -> None:
        lat, lon, alt = m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3
        on_earth = abs(lat) <= 90.0 and abs(lon) <= 180.0 and _LOWEST_M < alt < _HIGHEST_M
        if on_earth and not self.commander.armed:
            self.origin = (lat, lon, alt)
        self.send(
            link, streams.gps_global_origin(self, _stamp(self.now))
        )  # whether it was taken or not: what holds

    def _on_timesync(self, link: Link, m: Any) -> None:
        if m.tc1 == 0:
            self.send(link, mavlink.MAVLink_timesync_message(int(self.now * 1e9), m.ts1))

    def _on_ping(self, link: Link, m: Any) -> None:
        if m.target_system == 0:
            self.send(
                link,
                mavlink.MAVLink_ping_message(m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent()),
            )

    def _hear_mission(self, link: Link, m: Any) -> None:
        """By the system's own number alone, as PX4; the autopilot, the mission planner and all are the same component here."""
        own = m.get_srcSystem() == self.system and m.get_srcComponent() == 1
        if own or m.target_system != self.system or m.target_component not in _PLANNERS:
            self.counts["own echo" if own else "other target"] += 1
            return
        self.missions.hear(link.name, m, self.now)
        self._speak_missions()

    def _speak_missions(self) -> None:
        for name, message in self.missions.take_out():
            self.send(self._links[name], message)
        self.commander.texts += self.missions.texts
        self.missions.texts = []

    # -- parameters and commands ---------------------------------------------------------------------------------------

    def _on_param(self, link: Link, m: Any) -> None:
        for message in self.param_server.hear(link.name, m):
            self.send(link, message)
        for sentence in self.param_server.refused:
            self.commander.say(CRITICAL, sentence)
        self.param_server.refused.clear()

    def _on_command(self, link: Link, m: Any) -> None:
        result = self._obey(link, m.command, command_handlers.parameters_of(m))
        self.send(
            link,
            mavlink.MAVLink_command_ack_message(
                m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            ),
        )

    def _on_set_mode(self, link: Link, m: Any) -> None:
        """The message of old, which does what MAV_CMD_DO_SET_MODE does."""
        main, sub = split_mode(m.custom_mode)
        command = mavlink.MAV_CMD_DO_SET_MODE
        result = self._obey(link, command, (float(m.base_mode), float(main), float(sub), 0.0, 0.0, 0.0, 0.0))
        self.send(
            link,
            mavlink.MAVLink_command_ack_message(
                command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            ),
        )

    def _obey(self, link: Link, number: int, p: tuple[float, ...]) -> int:
        if self.sensed is not None:
            # Decided every few steps; a setpoint heard since then counts, for clients ask for OFFBOARD right after their first.
            self.sensed.offboard_age = self.now - self.setpoint_at
            self.sensed.offboard_needs_position = self.setpoint is not None and self.setpoint.needs_position
        return command_handlers.obey(self, link, number, p)

    def set_home_here(self) -> bool:
        """False while the position is not known."""
        s = self.newest
        if s is None or self.origin is None or not s.xy_valid[self.i]:
            return False
        self.home_n, self.home_yaw = s.p_n[self.i].tolist(), float(s.rpy[self.i, 2])
        return True

    def set_home_there(self, lat: float, lon: float, alt: float) -> bool:
        """latitude, longitude [deg], altitude [m]; False without an origin."""
        place = self.local_from_global(lat, lon, alt)
        self.home_n = list(place) if place else self.home_n
        return place is not None

    def tell_now(self, link: Link, msgid: int) -> bool:
        """One message on request; False when it is not there, or has nothing to say now."""
        s = self.newest
        return s is not None and self.tell(link, msgid, s, telemetry_batch.payloads([(self, msgid)], s))

    # -- speaking ------------------------------------------------------------------------------------------------------

    def send(self, link: Link, message: Any) -> None:
        if message is not None and len(link.out) < _QUEUE_LIMIT:
            link.out.append(link.codec.pack(message))
            self._quiet_until = 0.0

    def tell(self, link: Link, msgid: int, s: Snapshot, payloads: Mapping[int, Mapping[int, bytes]]) -> bool:
        """Put a message on a link; False when it is not there, or has nothing to say now. payloads: see often.payloads."""
        if msgid in payloads:
            payload = payloads[msgid].get(self.i)
            if payload is None:
                return False
            if len(link.out) < _QUEUE_LIMIT:
                link.out.append(link.codec.frame(msgid, payload))
            return True
        builder = streams.BUILDERS.get(msgid)
        message = builder(self, s) if builder else None
        self.send(link, message)
        return message is not None

    def has_to_speak(self, now: float) -> bool:
        """Is anything due, or waiting to be taken out?"""
        return now >= self._quiet_until or now >= self.missions.due or bool(self.commander.texts)

    def speak(self, now: float) -> list[tuple[Link, int]]:
        """Put on each link what this vehicle has to say for itself -> the messages due at this step, for the fleet to fill in."""
        if now >= self.missions.due:
            self.missions.speak(now)
            self._speak_missions()
        if self.commander.texts:
            self._say_texts(now)
        if self.param_server.busy:
            for link in self._links.values():
                for message in self.param_server.speak(link.name):
                    self.send(link, message)
        return [(link, msgid) for link in self._links.values() for msgid in _due(link, now)]

    def _say_texts(self, now: float) -> None:
        texts, self.commander.texts = self.commander.texts, []
        for link in self._links.values():
            if now - link.gcs_heard < 10.0:
                for severity, text in texts:
                    self._say(link, severity, text)

    def _say(self, link: Link, severity: int, text: str) -> None:
        """A text longer than one message holds goes out in numbered chunks, as the STATUSTEXT of MAVLink 2 allows."""
        raw = text.encode(errors="replace")
        chunks = [raw[k : k + _TEXT_BYTES] for k in range(0, len(raw), _TEXT_BYTES)]
        self._text_id = self._text_id % 65535 + 1
        for k, chunk in enumerate(chunks):
            self.send(
                link,
                mavlink.MAVLink_statustext_message(
                    severity, chunk, self._text_id if len(chunks) > 1 else 0, k
                ),
            )

    def take_out(self) -> list[tuple[str, bytes]]:
        """What to send now: one datagram a link."""
        found = []
        for name, link in self._links.items():
            if link.out:
                found.append((name, b"".join(link.out)))
                link.out = []
        self._quiet_until = 0.0 if self.param_server.busy else self._next_due() - _TICK_S
        return found

    def _next_due(self) -> float:
        return min([link.due[0][0] for link in self._links.values() if link.due], default=math.inf)

    def garbled(self) -> Counter[str]:
        """What was heard and could not be read, over all links."""
        return sum((link.codec.counts for link in self._links.values()), Counter())

    def gcs_age(self, now: float) -> float:
        """Since the last ground-station heartbeat on any link [s]."""
        return now - max([link.gcs_heard for link in self._links.values()])

    def local_from_global(self, lat: float, lon: float, alt: float) -> tuple[float, float, float] | None:
        """Latitude, longitude [deg], altitude AMSL [m] -> p_n [m] [NED]; None without an origin."""
        if self.origin is None:
            return None
        n, e = local(self.origin, lat, lon)
        return n, e, self.origin[2] - alt


def _due(link: Link, now: float) -> list[int]:
    """The messages whose time has come, each set to its next."""
    due, soon, late, found = link.due, now + _TICK_S, now - _LATE_S, []
    while due and due[0][0] <= soon:
        when, msgid = due[0]
        found.append(msgid)
        after = when + link.interval[msgid]
        heapq.heapreplace(due, (after if after > late else late, msgid))
    return found


def _stamp(now: float) -> Any:
    """A stand-in snapshot for builders that read nothing but the time."""

    class Stamp:
        now_s = now

    return Stamp


_OFTEN_HEARD = (
    mavlink_records.ODOMETRY,
    mavlink_records.SET_POSITION_TARGET,
)  # by everybody where they name nobody
_PLANNERS = (0, 1, mavlink.MAV_COMP_ID_MISSIONPLANNER)
_HANDLERS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Face._on_heartbeat,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: Face._on_command,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: Face._on_command,
    mavlink.MAVLINK_MSG_ID_SET_MODE: Face._on_set_mode,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: Face._on_global_target,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: Face._on_attitude_target,
    mavlink.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: Face._on_vision_estimate,
    mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: Face._on_origin,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: Face._on_timesync,
    mavlink.MAVLINK_MSG_ID_PING: Face._on_ping,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: Face._on_radio,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: Face._on_joystick,
    **dict.fromkeys(param_protocol.HEARD, Face._on_param),
}
# These are heard by everybody where they name nobody, the rest by whom they name alone: as PX4, which no broadcast arms.
_FOR_ALL = {
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_PING,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
}
