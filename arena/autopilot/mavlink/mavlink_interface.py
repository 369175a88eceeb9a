"""MAVLink interface of one vehicle: handles received messages, and sends replies and telemetry.

Received datagrams call methods of `Vehicle`. The state of the vehicle is sent as datagrams. No sockets, no
clock.

Any bytes may arrive. Frames are only counted if they cannot be decoded, address another vehicle or are not
supported. No received data raises an exception.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import MESSAGES, CommandGate, Role, role_on_link
from arena.autopilot.commander import CRITICAL, WARNING
from arena.autopilot.mavlink import (
    command_handlers,
    file_server,
    log_server,
    mission_protocol,
    param_protocol,
    streams,
)
from arena.autopilot.mavlink.event_server import EventServer, marked
from arena.autopilot.mavlink.external_vision import receive_vision_estimate
from arena.autopilot.mavlink.file_server import FileServer
from arena.autopilot.mavlink.link import MavlinkLink
from arena.autopilot.mavlink.log_server import LogServer
from arena.autopilot.mavlink.offboard_setpoints import receive_setpoint
from arena.autopilot.mavlink.telemetry import Telemetry
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.mavlink.vehicle_files import VehicleFiles
from arena.autopilot.stored_logs import LogLibrary
from arena.autopilot.vehicle import Vehicle
from arena.kernels.ordinary_messages import ODOMETRY, SET_POSITION_TARGET, OrdinaryMessages
from arena.wire import px4_messages
from arena.wire.age_limits import MANUAL_INPUTS, SETPOINTS
from arena.wire.mavlink_frame import Frame
from arena.wire.px4_mode import split_mode
from arena.wire.sticks import sticks_from_channels, sticks_from_manual_control

_GCS_TEXT_TIMEOUT_S = 10.0  # STATUSTEXT goes to links with a ground station only, as on PX4


class MavlinkInterface:
    """Receives and sends the MAVLink messages of one vehicle.

    The links are `router`, `vision`, `panic` and `ground` (see `MavlinkLink`).

    telemetry: streams of all vehicles, and the state that their messages contain
    ordinary: reads poses and setpoints
    gate: decides who may command the vehicle; None obeys every sender, as PX4 does
    on_text: called with severity (MAV_SEVERITY) and text of each message for the user
    library: the stored logs of all vehicles, None if none are written
    boot_unix_s: Unix time of the boot [s]
    """

    def __init__(
        self,
        vehicle: Vehicle,
        telemetry: Telemetry,
        ordinary: OrdinaryMessages,
        gate: CommandGate | None = None,
        on_text: Callable[[int, str], None] = lambda severity, text: None,
        library: LogLibrary | None = None,
        boot_unix_s: float = 0.0,
    ) -> None:
        self.vehicle, self._telemetry, self._ordinary, self.gate = vehicle, telemetry, ordinary, gate
        self._on_text = on_text
        self.counts: Counter[str] = Counter()
        self.mission_protocol = mission_protocol.MissionProtocol(vehicle.missions, tuple(streams.LINK_RATES))
        self.param_server = param_protocol.ParamServer(vehicle.row, vehicle.params)
        files = VehicleFiles(vehicle.commander.name, library)
        self.file_server, self.log_server = FileServer(files), LogServer(files, boot_unix_s)
        self._servers = (self.param_server, self.file_server, self.log_server)
        self.event_server = EventServer()
        telemetry.packer.set_newest_event(vehicle, *self.event_server.newest)
        self.links = telemetry.links(vehicle)

    # -- receiving -------------------------------------------------------------------------------------------

    def receive(self, link_name: str, data: bytes, now: float) -> None:
        """Decode one received datagram and act on each message in it.

        link_name: link on which it arrived
        now: time since boot [s]
        """
        link, data = self.links[link_name], bytes(data)
        self.vehicle.now = now
        for frame in link.codec.frames(data):
            if link.waiting:
                link.waiting = False
                self._telemetry.start_streams(link, now)
            if frame.msgid in MESSAGES and self._refuses(link, data, frame):
                self.counts["refused: another has control"] += 1
            elif frame.msgid in _DECODED_FAST:
                self._receive_fast(data, frame)
            elif frame.msgid == px4_messages.REQUEST_EVENT:
                self._on_event_request(link, data, frame)
            elif (message := link.codec.decode(data, frame)) is not None:
                self._receive_message(link, message)

    def _refuses(self, link: MavlinkLink, data: bytes, frame: Frame) -> bool:
        """Return whether a command is refused because its sender does not have control of the vehicle.

        Queue the reply to a refused command.
        """
        own = self.vehicle.system_id
        named = frame.target_sys == own or (
            frame.target_sys == 0 and frame.msgid in SETPOINTS | MANUAL_INPUTS
        )
        if self.gate is None or not named or frame.target_comp not in (0, 1):
            return False
        role = role_on_link(link.name, frame.sysid, own)
        is_setpoint = role is Role.PROGRAM and frame.msgid in SETPOINTS
        if is_setpoint and self.gate.authority.passes_program_setpoint(self.vehicle.now):
            return False
        refusal = self.gate.refusal(role, data, frame, self.vehicle.now)
        if refusal is None:
            return False
        self._wake()
        if reply := refusal.reply(link.codec):
            link.queue.append(reply)
        return True

    def _receive_fast(self, data: bytes, frame: Frame) -> None:
        """Process an ODOMETRY or SET_POSITION_TARGET_LOCAL_NED in a datagram that is not ordinary.

        As for all messages, one that addresses another vehicle or was sent by this vehicle is only counted.
        """
        vehicle, reader = self.vehicle, self._ordinary
        own, row = vehicle.system_id, vehicle.row
        if frame.target_sys not in (0, own) or frame.target_comp not in (0, 1):
            self.counts["other target"] += 1
        elif frame.sysid == own and frame.compid == 1:
            self.counts["own echo"] += 1
        elif frame.msgid == ODOMETRY:
            reader.read_pose(row, data, frame.payload, frame.size)
        else:
            self._finish_setpoint(reader.read_setpoint(row, data, frame.payload, frame.size, vehicle.now))

    def _receive_message(self, link: MavlinkLink, m: Any) -> None:
        self._wake()
        handler = _HANDLERS.get(m.get_msgId())
        if m.get_msgId() in mission_protocol.MESSAGE_IDS:
            self._on_mission(link, m)
        elif handler is None:
            self.counts["not for us"] += 1
        elif not self._is_addressed(m):
            self.counts["other target"] += 1
        elif self._is_own(m):
            self.counts["own echo"] += 1
        else:
            handler(self, link, m)

    def _is_addressed(self, m: Any) -> bool:
        system, own = getattr(m, "target_system", None), self.vehicle.system_id
        named = system is None or system == own or (system == 0 and m.get_msgId() in _BROADCAST)
        return named and getattr(m, "target_component", 0) in (0, 1)

    def _is_own(self, m: Any) -> bool:
        return bool(m.get_srcSystem() == self.vehicle.system_id and m.get_srcComponent() == 1)

    def _finish_setpoint(self, refusal: str | None) -> None:
        """Report a refused setpoint to the user. refusal: the reason, None if the setpoint was stored"""
        if refusal is not None:
            self.vehicle.refuse_offboard_setpoint(refusal)
            self._wake()

    def _on_heartbeat(self, link: MavlinkLink, m: Any) -> None:
        if m.type == mavlink.MAV_TYPE_GCS:
            link.gcs_heartbeat_at = self.vehicle.gcs_heartbeat_at = self.vehicle.now

    def _on_rc_override(self, link: MavlinkLink, m: Any) -> None:
        sticks = sticks_from_channels(m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw)
        self.vehicle.manual_control.receive("radio", self.vehicle.now, sticks)

    def _on_manual_control(self, link: MavlinkLink, m: Any) -> None:
        if m.target in (0, self.vehicle.system_id):
            sticks = sticks_from_manual_control(m.x, m.y, m.z, m.r)
            self.vehicle.manual_control.receive("joystick", self.vehicle.now, sticks)

    def _on_setpoint(self, link: MavlinkLink, m: Any) -> None:
        self._finish_setpoint(receive_setpoint(m, self.vehicle))

    def _on_vision_estimate(self, link: MavlinkLink, m: Any) -> None:
        receive_vision_estimate(m, self.vehicle.vision_input, self.vehicle.row)

    def _on_origin(self, link: MavlinkLink, m: Any) -> None:
        """Set the origin of the local frame from SET_GPS_GLOBAL_ORIGIN, if its values are valid.

        Reply with the origin in use in both cases.
        """
        self.vehicle.set_origin(m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3)
        link.send(streams.gps_global_origin(self.vehicle, self.vehicle.now))

    def _on_timesync(self, link: MavlinkLink, m: Any) -> None:
        if m.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(int(self.vehicle.now * 1e9), m.ts1))

    def _on_ping(self, link: MavlinkLink, m: Any) -> None:
        if m.target_system == 0:
            reply = mavlink.MAVLink_ping_message(m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent())
            link.send(reply)

    def _on_file_request(self, link: MavlinkLink, m: Any) -> None:
        for message in self.file_server.receive(link.name, m, self.vehicle.now):
            link.send(message)

    def _on_log_request(self, link: MavlinkLink, m: Any) -> None:
        self.log_server.receive(link.name, m)

    def _on_event_request(self, link: MavlinkLink, data: bytes, frame: Frame) -> None:
        """Send the requested events again, or report that they are not available."""
        asked, own = px4_messages.read_event_request(data, frame), self.vehicle.system_id
        addressed = (asked.target_system, asked.target_component) in ((own, 0), (own, 1))
        self.counts["other target"] += not addressed
        self._wake()
        for reply in self.event_server.requested(asked, frame.sysid, frame.compid) if addressed else ():
            link.send(reply)

    def _on_mission(self, link: MavlinkLink, m: Any) -> None:
        """Pass a message of the mission protocol to `MissionProtocol` if it addresses this vehicle.

        As in PX4, a broadcast is not accepted, but the component id of the mission planner is.
        """
        own = self._is_own(m)
        if own or m.target_system != self.vehicle.system_id or m.target_component not in _MISSION_COMPONENTS:
            self.counts["own echo" if own else "other target"] += 1
            return
        self.mission_protocol.receive(link.name, m, self.vehicle.now)
        self._send_mission_messages()

    def _send_mission_messages(self) -> None:
        for name, message in self.mission_protocol.take_messages():
            self.links[name].send(message)
        self.vehicle.commander.texts += self.mission_protocol.take_texts()

    def _on_param(self, link: MavlinkLink, m: Any) -> None:
        for message in self.param_server.receive(link.name, m):
            link.send(message)
        for reason in self.param_server.refused:
            self.vehicle.commander.report(CRITICAL, reason)
        self.param_server.refused.clear()
        for reason in self.param_server.without_effect:
            self.vehicle.commander.report(WARNING, reason)
        self.param_server.without_effect.clear()

    def _on_command(self, link: MavlinkLink, m: Any) -> None:
        self._run_command(link, m, m.command, command_handlers.parameters_of(m))

    def _on_set_mode(self, link: MavlinkLink, m: Any) -> None:
        """Process the deprecated message SET_MODE like the command MAV_CMD_DO_SET_MODE."""
        main, sub = split_mode(m.custom_mode)
        params = (float(m.base_mode), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
        self._run_command(link, m, mavlink.MAV_CMD_DO_SET_MODE, params)

    def _run_command(self, link: MavlinkLink, m: Any, number: int, params: tuple[float, ...]) -> None:
        request = command_handlers.Request(
            vehicle=self.vehicle,
            link=link,
            params=params,
            send_now=lambda msgid: self._send_now(link, msgid),
        )
        result = command_handlers.run(number, request)
        ack = mavlink.MAVLink_command_ack_message(
            number, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
        )
        link.send(ack)

    def _send_now(self, link: MavlinkLink, msgid: int) -> bool:
        """Send one message that a client requested. Return False if it is not supported or has no valid content."""
        state = self._telemetry.begin()
        self._telemetry.update(self.vehicle)
        return state is not None and self._telemetry.send(self.vehicle, link, [msgid], state)

    # -- sending ---------------------------------------------------------------------------------------------

    def _wake(self) -> None:
        """Request a call of `transmit` in this step, even if no message stream is due."""
        self._telemetry.wake_s[self.vehicle.row] = 0.0

    def wake_if_changed(self) -> None:
        """Request a call of `transmit` if the vehicle has a new text for the user or new mission progress."""
        if self.vehicle.commander.texts or self.mission_protocol.has_progress:
            self._wake()

    def transmit(self, now: float, state: TelemetryState) -> list[tuple[str, bytes]]:
        """Return the datagrams to send at `now` [s] as (link name, datagram), at most one per link.

        state: state of all vehicles
        """
        if now >= self.mission_protocol.due or self.mission_protocol.has_progress:
            self.mission_protocol.update(now)
            self._send_mission_messages()
        if self.vehicle.commander.texts:
            self._send_texts(now)
        for server in self._servers:
            for link in self.links.values() if server.busy else ():
                for message in server.next_messages(link.name):
                    link.send(message)
        self._telemetry.update(self.vehicle)
        for link in self.links.values():
            if due := link.streams.take_due(now):
                self._telemetry.send(self.vehicle, link, due, state)
        busy = any(server.busy for server in self._servers)
        self._telemetry.wake_s[self.vehicle.row] = 0.0 if busy else self.mission_protocol.due
        return [(link.name, link.take_datagram()) for link in self.links.values() if link.queue]

    def _send_texts(self, now: float) -> None:
        """Send new texts to links with a ground station, and new events to all links."""
        c = self.vehicle.commander
        texts, events, c.texts, c.events = c.texts, c.events, [], []
        for severity, text in texts:
            self._on_text(severity, text)
        sent, messages = marked(texts, events), self.event_server.send(events, int(now * 1e3))
        self._telemetry.packer.set_newest_event(self.vehicle, *self.event_server.newest)
        for link in self.links.values():
            for severity, text in sent if now - link.gcs_heartbeat_at < _GCS_TEXT_TIMEOUT_S else ():
                link.send_text(severity, text)
            for message in messages:
                link.send(message)

    def received_counts(self) -> Counter[str]:
        """Return the numbers of received and refused messages by kind, over all links."""
        found = self.vehicle.received_counts()
        for counts in (self.counts, *(link.codec.counts for link in self.links.values())):
            found.update(counts)  # adding Counters is slow
        return +found  # without zeros


_DECODED_FAST = (ODOMETRY, SET_POSITION_TARGET)
_MISSION_COMPONENTS = (0, 1, mavlink.MAV_COMP_ID_MISSIONPLANNER)
_HANDLERS: dict[int, Callable[[MavlinkInterface, MavlinkLink, Any], None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: MavlinkInterface._on_heartbeat,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: MavlinkInterface._on_command,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: MavlinkInterface._on_command,
    mavlink.MAVLINK_MSG_ID_SET_MODE: MavlinkInterface._on_set_mode,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: MavlinkInterface._on_setpoint,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: MavlinkInterface._on_setpoint,
    mavlink.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: MavlinkInterface._on_vision_estimate,
    mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: MavlinkInterface._on_origin,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: MavlinkInterface._on_timesync,
    mavlink.MAVLINK_MSG_ID_PING: MavlinkInterface._on_ping,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: MavlinkInterface._on_rc_override,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: MavlinkInterface._on_manual_control,
    **dict.fromkeys(file_server.MESSAGE_IDS, MavlinkInterface._on_file_request),
    **dict.fromkeys(log_server.MESSAGE_IDS, MavlinkInterface._on_log_request),
    **dict.fromkeys(param_protocol.MESSAGE_IDS, MavlinkInterface._on_param),
}
# Messages that are accepted with target_system 0 (broadcast). Every other message must be addressed to this
# system. PX4 does not run broadcast commands either.
_BROADCAST = {
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_PING,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
    *file_server.MESSAGE_IDS,
}
