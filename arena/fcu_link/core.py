"""Core of the link to a flight controller: routes frames between the vehicle and its UDP links. Pure.

vehicle -> router     everything
vehicle -> vision     the messages that the pose forwarder reads
vehicle -> panic      everything, while land-all sends
vehicle -> simulator  HIL_ACTUATOR_CONTROLS only, for hardware in the loop (HITL)
links -> vehicle      everything except refused requests to arm, commands of senders that must not command the vehicle now
(arena.authority), poses and position resets that are not from the pose forwarder, and TIMESYNC replies, because with these
PX4 would shift the time stamps of poses
Nothing is carried to or from an autopilot that has not sent the hardware uid of the vehicle (identity.py).
simulator -> vehicle  the sensors, but not HIL_STATE_QUATERNION, which PX4 in HITL would use as its own estimate
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import MESSAGES, CommandGate, command_of, role_on_link
from arena.constants import REORDERED_MS
from arena.fcu_link.arm_permit import ArmPermit
from arena.fcu_link.arming_guard import needs_checks, sticks_can_arm
from arena.fcu_link.axes_check import AxesCheck
from arena.fcu_link.axes_record import AxesRecord
from arena.fcu_link.foreign_poses import ForeignPoses
from arena.fcu_link.identity import SILENT_S, Identity
from arena.fcu_link.message_sets import ACTUATORS, DECODED, IMU, SENSORS, TIMESYNC, VISION_MESSAGES
from arena.fcu_link.own_requests import OwnRequests
from arena.fcu_link.param_check import ParamCheck
from arena.fcu_link.preflight_checks import CONNECTION_TIMEOUT_S, PreflightChecks, sentence
from arena.fcu_link.radio_check import RadioCheck
from arena.fcu_link.refusal_replies import RefusalReplies
from arena.fcu_link.send_queue import Priority, SendQueue
from arena.fcu_link.settings import Settings
from arena.fcu_link.silence_report import SilenceReport
from arena.fcu_link.stream_requests import WIDE_BAUD, StreamRequests
from arena.transport import Source
from arena.wire.age_limits import SHORTEST_LIMIT_S, without_old_frames
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, ParsedFrames, parse_frames
from arena.wire.mavlink_ids import LINK_COMPONENT
from arena.wire.mavlink_params import parse_error, parse_value
from arena.wire.px4_mode import mode_words

SIMULATOR = "simulator"
PANIC_TIMEOUT_S = 5.0  # after its last frame, land-all no longer receives telemetry
_PRIORITIES = {"panic": Priority.PANIC, "router": Priority.ROUTER, "vision": Priority.VISION}

Out = list[tuple[str, bytes]]


class FcuLink:
    """Core of the link to one flight controller: filters, queues and routes frames, without sockets.

    Pass in received data with `from_vehicle`, `from_link` and `from_simulator`, call `tick`, and send the
    frames that `own.uid_requests` and `next_out` return.
    uid: hardware uid that an earlier process of this run has recorded; last_source: where the vehicle was then
    axes_record: last axes check that the vehicle has passed
    counts: number of frames that were not passed on, by reason
    flow: number of frames passed on, by direction
    """

    def __init__(
        self,
        settings: Settings,
        now: float,
        uid: str = "",
        last_source: Source | None = None,
        axes_record: AxesRecord | None = None,
    ) -> None:
        s = settings
        self.system, self._s = s.id, s
        self.counts: Counter[str] = Counter()
        self.flow: Counter[str] = Counter()
        self.queue = SendQueue(self.counts, s.preflight.pose_age_s)
        self.gate = CommandGate(s.vehicle, s.id, simulated=s.simulated, radio=s.preflight.radio is not None)
        self.identity = Identity(s.id, s.uid or uid, last_source, needs_uid=not s.simulated)
        self.permit = ArmPermit(s.vehicle, needed=not s.simulated)
        self.checks = PreflightChecks(s.preflight)
        self.radio = RadioCheck(s.preflight.radio)
        self.foreign = ForeignPoses(s.id, forwarded=s.preflight.poses)
        self.axes = AxesCheck(s, axes_record)
        self.params = ParamCheck(s.params, "/".join(s.params_file.split("/")[-2:]), self.radio.params)
        wide = s.connection.kind != "serial" or s.connection.baud >= WIDE_BAUD
        self._streams = StreamRequests(wide=wide, radio=self.radio.required)
        self._codec, self._autopilot_codec = Codec(s.id, LINK_COMPONENT), Codec(s.id, AUTOPILOT)
        self._replies = RefusalReplies(self._autopilot_codec)
        self.own = OwnRequests(s.id, self._codec, self.identity, self.params, self._streams, self.axes)
        self._events: list[str] = []
        self._panic_received_at = -math.inf
        self._boot_ms, self._was_armed = 0, False
        self.signing_problem = ""  # why messages of the vehicle are not used, if it has a signing key
        self.missing_reboot: list[str] = []  # why arming is forbidden after a parameter push
        self._silence = SilenceReport(s.connection, s.id, LINK_COMPONENT, self.counts, now)

    # -- from the vehicle ----------------------------------------------------------------------------------------------

    @property
    def ever_connected(self) -> bool:
        """True after the first heartbeat of the vehicle's autopilot."""
        return self.checks.heartbeat_at > -math.inf

    def alive(self, now: float) -> bool:
        return now - self.checks.received_at <= CONNECTION_TIMEOUT_S

    def armed(self, now: float) -> bool:
        """Return whether the vehicle is armed.

        A real vehicle that sends nothing keeps its last state, also over a restart of this
        process, because it may still fly. A simulated vehicle counts as disarmed after 5 s without data: its process has ended.
        """
        armed = self.checks.armed or (self._was_armed and not self.ever_connected)
        return armed and (not self._s.simulated or now - self.checks.received_at < 5.0)

    def from_vehicle(
        self, data: Buffer, found: ParsedFrames, now: float, source: Source = "the vehicle"
    ) -> Out:
        """Process received data of the vehicle. Return the datagrams to send as (receiver, datagram).

        source: UDP address or serial device of the sender. The result is empty if the sender is not the
        vehicle.
        """
        self._silence.on_data(data, found)
        if not self._identify(source, data, found, now):
            self.counts["from the vehicle: unknown sender"] += 1
            return []
        parts: dict[str, list[Buffer]] = {}
        for frame in found.frames:
            if frame.sysid != self.system:
                self.counts["from the vehicle: foreign system"] += 1
                continue
            self.flow["from_vehicle"] += 1
            if frame.compid == AUTOPILOT:
                self._on_autopilot(data, frame, now)
            for end in self._links_for(frame, now):
                parts.setdefault(end, []).append(data[frame.start : frame.end])
        return [(end, b"".join(frames)) for end, frames in parts.items()]

    def on_opened(self) -> None:
        """Require the hardware uid again after the serial device was opened: the vehicle may have changed."""
        self.identity.release()
        self.queue.clear()
        self.permit.on_interruption("its device was unplugged")

    def on_foreign_datagram(self, data: Buffer, found: ParsedFrames) -> None:
        """Count a datagram from an address that is not the address of the vehicle."""
        self.counts["from the vehicle: unknown sender"] += 1
        self._silence.on_data(data, found)

    def _identify(self, source: Source, data: Buffer, found: ParsedFrames, now: float) -> bool:
        """Return whether data come from the vehicle, which is identified by its hardware uid."""
        before, uid = self.identity.source, self.identity.uid
        accepted = self.identity.accepts(source, data, found.frames, now)
        if self.identity.source != before:
            self.queue.clear()  # the frames are for the old address or device
        if self.identity.uid != uid:
            self._boot_ms = 0
            self._restart_checks()
        if accepted and self.identity.source != before:  # its mode must be known before the first command
            for frame in parse_frames(self.identity.heartbeat).frames:
                self._on_autopilot(self.identity.heartbeat, frame, now)
        return accepted

    def _links_for(self, frame: Frame, now: float) -> list[str]:
        if frame.msgid == ACTUATORS and self._s.simulator is not None:
            return [SIMULATOR]
        if frame.msgid == TIMESYNC and self.axes.running:
            return []  # an answer to the check would confuse others
        panic = ["panic"] if now - self._panic_received_at <= PANIC_TIMEOUT_S else []
        vision = ["vision"] if frame.msgid in VISION_MESSAGES and frame.compid == AUTOPILOT else []
        return ["router", *vision, *panic]

    def _on_autopilot(self, data: Buffer, frame: Frame, now: float) -> None:
        """Process a frame of the autopilot: update stream rates, parameter check and preflight checks."""
        if now - self.checks.received_at > SILENT_S:
            self._streams.restart()
            self.permit.on_interruption(f"no telemetry for {SILENT_S:g} s")
            if not self.checks.armed:  # somebody may have worked on the vehicle meanwhile
                self._restart_setup()
        self.checks.received_at = now
        self._streams.on_message(frame.msgid, now)
        if frame.msgid == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
            self.params.on_value(value := parse_value(data, frame))
            self.axes.on_param(value.name, value.value)
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_PARAM_ERROR and frame.target_comp == LINK_COMPONENT:
            self.params.on_error(*parse_error(data, frame)[:2])
        elif frame.msgid in DECODED and not (frame.msgid == IMU and self.checks.armed):
            for m in self._codec.parse(data[frame.start : frame.end]):
                self._on_message(m, now)

    def _on_message(self, m: Any, now: float) -> None:
        kind = m.get_type()
        if kind == "SYSTEM_TIME":
            if m.time_boot_ms < self._boot_ms - REORDERED_MS:
                self._rebooted()
            self._boot_ms = m.time_boot_ms
            self.axes.on_boot_time(m.time_boot_ms / 1e3, now)
        elif kind == "COMMAND_ACK":
            ours = (m.target_system, m.target_component) == (self.system, LINK_COMPONENT)
            if ours and m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._streams.on_ack(m.result, now)
        else:
            if kind == "HEARTBEAT":
                armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self.gate.on_state(armed, mode_words(m.custom_mode), now)
                self._on_heartbeat(armed, now)
            if kind == "RC_CHANNELS" and m.chancount > 0:
                self.gate.authority.on_manual_input(now)
            self.checks.on_autopilot(m, now)
            self.radio.on_autopilot(m, now)
            self.axes.on_autopilot(m, now)

    def _on_heartbeat(self, armed: bool, now: float) -> None:
        if not self.ever_connected:
            self._say("connected")
        elif now - self.checks.heartbeat_at > SILENT_S:
            self._say(f"connected again after {now - self.checks.heartbeat_at:.0f} s")
        self.permit.on_heartbeat(armed)
        if armed:
            self.identity.fix()
            self.axes.stop("the vehicle was armed")
        if armed and not self.checks.armed and (reasons := self.reasons(now)):
            self._say(f"is armed although a preflight check fails: {'; '.join(reasons)}")

    def _rebooted(self) -> None:
        self._say("has rebooted: reading its parameters again")
        self.identity.release()
        self.permit.on_interruption("it has rebooted")
        self._restart_checks()

    def _restart_checks(self) -> None:
        self.axes.on_reboot()
        self.checks.reset()
        self._restart_setup()
        self._streams.restart()

    def _restart_setup(self) -> None:
        """Repeat the checks of parameters, kill switch and captured attitude: the vehicle may have been exchanged."""
        self.params.restart()
        self.radio.reset()
        self.checks.restart_motion()

    # -- to the vehicle ------------------------------------------------------------------------------------------------

    def reasons(self, now: float) -> list[str]:
        """Return why the vehicle must not be armed now; empty if arming is allowed."""
        identity = self.identity.problem(now)
        radio = self.radio.reasons(now, self.params.values()) if self.alive(now) else []
        found = [*map(sentence, [*([identity] if identity else []), *self.axes.reasons(self.identity.uid)])]
        found += self.checks.reasons(now, [*radio, *self.params.reasons(), *self.missing_reboot])
        return [*found, *map(sentence, self.permit.reasons)]

    def from_link(self, link: str, data: Buffer, now: float, age_s: float = 0.0) -> Out:
        """Process a datagram from a UDP link to the vehicle. Return the replies as (link, datagram).

        link: "router" (MAVLink router), "vision" (pose forwarder) or "panic" (land-all, kill-all)
        age_s: time since this computer received the datagram [s]; frames older than their limit are dropped
        """
        if age_s > SHORTEST_LIMIT_S:
            data, dropped = without_old_frames(data, age_s)
            self.counts[f"from {link}: waited too long"] += dropped
        if (found := parse_frames(data)).garbage:
            self.counts[f"from {link}: garbage bytes"] += found.garbage
        if link == "panic" and found.frames:
            self._panic_received_at = now
        out: Out = []
        armed, on_ground = self.checks.armed, self.checks.on_ground(now)
        flying = armed and self.alive(now) and not on_ground
        for frame in found.frames:
            if frame.msgid == TIMESYNC and any(data[frame.payload : frame.payload + min(8, frame.size)]):
                self.counts["to the vehicle: TIMESYNC reply"] += 1
            elif why := self.foreign.refusal(link, data, frame, armed=self.armed(now)):
                self.counts[f"to the vehicle: {why}"] += 1
                if command_of(data, frame):
                    out.append((link, self._replies.reply(link, data, frame, (f"refused: {why}",), now)))
            elif needs_checks(data, frame, self.system, flying=flying):
                out += self._guard(link, data, frame, now, age_s)
            elif sticks_can_arm(data, frame, armed=armed, on_ground=on_ground) and self.reasons(now):
                self.counts["to the vehicle: sticks refused"] += 1
            else:
                out += self._pass(link, data, frame, now, age_s)
        return out

    def from_simulator(self, data: Buffer, found: ParsedFrames, now: float) -> None:
        """Process data from the simulator: queue its sensor messages for the flight controller."""
        for frame in found.frames:
            if self.identity.source is None:
                self.counts["to the vehicle: not connected (simulator)"] += 1
            elif frame.msgid in SENSORS:
                self.queue.put(Priority.SIMULATOR, bytes(data[frame.start : frame.end]), frame.msgid, now)
            else:
                self.counts["from the simulator: not for a controller in the loop"] += 1

    def next_out(self, now: float) -> bytes | None:
        """Return the next frame to send to the vehicle; None if there is none."""
        if (queued := self.queue.take(now)) is None:
            return None
        self.flow["to_vehicle"] += 1
        # only a pose that is sent counts for the preflight checks: older poses in the queue may be dropped
        if queued.priority is Priority.VISION and queued.msgid == mavlink.MAVLINK_MSG_ID_ODOMETRY:
            for m in self._codec.parse(queued.frame):
                self.flow["poses"] += 1
                self.checks.on_pose(m, now)
                self.axes.on_pose(m, now)
        return queued.frame

    def _pass(self, link: str, data: Buffer, frame: Frame, now: float, age_s: float) -> Out:
        """Queue an allowed frame for the vehicle. For a frame that is not allowed, return the reply to its sender."""
        if self.identity.source is None:
            self.counts[f"to the vehicle: not connected ({link})"] += 1
            return []
        if (refused := self._refuse(link, data, frame, now, sent=True)) is not None:
            return refused
        self.queue.put(_PRIORITIES[link], bytes(data[frame.start : frame.end]), frame.msgid, now - age_s)
        self.params.on_command(command_of(data, frame), now)
        return []

    def _refuse(self, link: str, data: Buffer, frame: Frame, now: float, *, sent: bool) -> Out | None:
        """Return the reply (link, datagram) to the sender of a frame that is not allowed; None if it is allowed.

        A frame is not allowed if the sender has no control authority. The result is empty if no reply is needed.

        sent: False if the caller does not send even an allowed frame, so that it does not count as a command of its sender.
        """
        role = role_on_link(link, frame.sysid, self.system)
        origin = "panic link" if link == "panic" else ""  # the router records its clients
        commands = frame.msgid in MESSAGES and frame.target_sys in (0, self.system)
        refusal = self.gate.refusal(role, data, frame, now, origin, sent=sent) if commands else None
        if refusal is None:
            return None
        self.counts[f"to the vehicle: refused: {refusal.why}"] += 1
        return [(link, reply)] if (reply := refusal.reply(self._autopilot_codec)) else []

    def _guard(self, link: str, data: Buffer, frame: Frame, now: float, age_s: float) -> Out:
        """Pass on a request to arm or to spin a motor, or refuse it because a preflight check fails.

        Return the refusal as (link, datagram), for the requesting link and for the router, whose ground stations show it.
        """
        reasons = self.reasons(now)
        if not reasons:
            return self._pass(link, data, frame, now, age_s)
        if (refused := self._refuse(link, data, frame, now, sent=False)) is not None:
            return refused  # a final refusal: the sender must not wait for the checks
        self.counts["to the vehicle: arming refused"] += 1
        if text := self._replies.text(data, frame, reasons, now):
            self._say(text)
        answer = self._replies.reply(link, data, frame, reasons, now)
        return [(end, answer) for end in dict.fromkeys((link, "router"))]

    # -- periodic -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Queue heartbeat and requests, and report a silent vehicle. Call this twenty times a second."""
        if now - self.checks.received_at > SILENT_S:
            self.permit.on_interruption(f"no telemetry for {SILENT_S:g} s")
        self.axes.tick(now)
        connected = self._connected(now)
        for msgid, message in self.own.due(now, connected=connected):
            self.queue.put(Priority.ROUTER, message, msgid, now)
        if connected:
            self._silence.restart(now)
        elif text := self._silence.text(self.identity.problem(now) or self.signing_problem, now):
            self._say(text)

    def on_request(self, request: Mapping[str, Any], now: float) -> None:
        """Process a request of the supervisor, such as a new arm permit (see `process_context`)."""
        self.gate.on_request(request, now)
        if request.get("vehicle") != self._s.vehicle:
            return
        connected = self._connected(now)
        refusal = "" if connected else self.identity.problem(now) or "the vehicle is not connected"
        self.axes.on_request(request, now, refusal, self.identity.uid, armed=self.armed(now))
        if self.axes.running:
            self.permit.on_interruption("somebody carries it for its axes check")
        self._was_armed = self._was_armed or request.get("do") == "was_armed"
        if request.get("do") == "permit":
            self.permit.grant(str(request.get("by")), now, connected=connected, carried=self.axes.running)
            if self.permit.by:
                self.identity.fix()

    def _connected(self, now: float) -> bool:
        """Return whether the vehicle is identified and has sent data recently."""
        return self.identity.source is not None and self.alive(now)

    def _say(self, text: str) -> None:
        self._events.append(f"{self._s.vehicle}: {text}")

    def events(self) -> list[str]:
        """Return the new messages for the user, each only once and with the vehicle's name."""
        for source in (self.identity, self.permit, self.axes, self.params, self._streams, self.foreign):
            for text in source.events:
                self._say(text)
            source.events.clear()
        found, self._events, gated = self._events, [], self.gate.events()
        return found if self._s.simulated else [*found, *gated]  # the router reports simulated vehicles
