"""The link's core: frames of the wire and datagrams of the three links in, what goes where out. No sockets, no clocks.

vehicle -> router     everything
vehicle -> vision     what the forwarder listens to
vehicle -> panic      everything, while land-all is there
vehicle -> simulator  HIL_ACTUATOR_CONTROLS alone, of a controller in the loop
partners -> vehicle   everything but TIMESYNC replies (they would move the stamps of the poses) and what a gate withholds
simulator -> vehicle  the sensors. Not HIL_STATE_QUATERNION: PX4 in HITL takes it for its own estimate (mavlink_receiver)
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.arming_guard import STICKS, asks_to_arm, command_of, refusal
from arena.fcu_link.param_check import ParamCheck
from arena.fcu_link.preflight_checks import HEARD_S, Gates
from arena.fcu_link.send_queue import Kind, Outbox
from arena.fcu_link.settings import Settings
from arena.fcu_link.stream_requests import WIDE_BAUD, Streams
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer, Frame, ParsedFrames, parse_frames
from arena.wire.mavlink_params import parse_error, parse_value

COMPONENT = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER2
AUTOPILOT = 1
SIMULATOR = "simulator"
PANIC_LIFE_S = 5.0
_SILENT_S = 3.0
_COMPLAIN_S = 10.0
_REORDERED_MS = 500  # a time since boot that runs back by less came out of order
_TEXT_AGAIN_S = 0.5
_TIMESYNC = mavlink.MAVLINK_MSG_ID_TIMESYNC
_ACTUATORS = mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
_SENSORS = (
    mavlink.MAVLINK_MSG_ID_HIL_SENSOR,
    mavlink.MAVLINK_MSG_ID_HIL_GPS,
    mavlink.MAVLINK_MSG_ID_HIL_OPTICAL_FLOW,
)
_FOR_VISION = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    }
)
_READ = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    }
)
_KINDS = {"panic": Kind.PANIC, "router": Kind.ROUTER, "vision": Kind.VISION}

Out = list[tuple[str, bytes]]


class FcuLink:
    """Feed it with `from_wire`, `from_partner`, `from_simulator` and `tick`; write out what `next_out` gives."""

    def __init__(self, settings: Settings, now: float) -> None:
        s = settings
        self.system, self._s = s.id, s
        self.counts: Counter[str] = Counter()
        self.flow: Counter[str] = Counter()
        self.outbox = Outbox(self.counts)
        self.gates = Gates(s.preflight)
        shown = "/".join(s.params_file.split("/")[-2:])
        self.params = ParamCheck(s.params, shown)
        self._streams = Streams(wide=s.connection.kind != "serial" or s.connection.baud >= WIDE_BAUD)
        self._own, self._stead = Codec(s.id, COMPONENT), Codec(s.id, AUTOPILOT)
        self._events: list[str] = []
        self._panic_heard = -math.inf
        self._beat = -math.inf
        self._boot_ms = 0
        self._complained, self._bytes, self._foreign = now, 0, 0
        self._texts_at: dict[str, float] = {}
        self._withheld_told = -math.inf

    # -- from the vehicle ----------------------------------------------------------------------------------------------

    @property
    def ever_heard(self) -> bool:
        """By its heartbeat."""
        return self.gates.beat > -math.inf

    def alive(self, now: float) -> bool:
        return now - self.gates.heard <= HEARD_S

    def armed(self, now: float) -> bool:
        """A real vehicle that fell silent while armed may be flying behind a lost radio; a simulated one has ended."""
        return self.gates.armed and (not self._s.simulated or now - self.gates.heard < 5.0)

    def has_autopilot_frame(self, frames: Sequence[Frame]) -> bool:
        """Is one of them the vehicle's autopilot's own?"""
        return any(f.sysid == self.system and f.compid == AUTOPILOT for f in frames)

    def from_wire(self, data: Buffer, found: ParsedFrames, now: float) -> Out:
        """What came in one piece. -> (router | vision | panic | simulator, datagram) for each that gets some of it."""
        self._count_noise(data, found)
        parts: dict[str, list[Buffer]] = {}
        for frame in found.frames:
            if frame.sysid != self.system:
                self.counts["from the wire: foreign system"] += 1
                self._foreign = frame.sysid << 8 | frame.compid
                continue
            self.flow["from_vehicle"] += 1
            if frame.compid == AUTOPILOT:
                self._hear(data, frame, now)
            elif frame.compid != COMPONENT:  # ours may come back
                self._foreign = frame.sysid << 8 | frame.compid
            for end in self._listeners(frame, now):
                parts.setdefault(end, []).append(data[frame.start : frame.end])
        return [(end, b"".join(frames)) for end, frames in parts.items()]

    def on_foreign_datagram(self, data: Buffer, found: ParsedFrames) -> None:
        """What came from another address than the partner's: nothing of it is used."""
        self.counts["from the wire: stranger"] += 1
        self._count_noise(data, found)
        for frame in found.frames:
            self._foreign = frame.sysid << 8 | frame.compid

    def _count_noise(self, data: Buffer, found: ParsedFrames) -> None:
        self._bytes += len(data)
        if found.garbage:
            self.counts["from the wire: garbage bytes"] += found.garbage
        if found.bad_crc:
            self.counts["from the wire: wrong CRC"] += found.bad_crc

    def _listeners(self, frame: Frame, now: float) -> list[str]:
        if frame.msgid == _ACTUATORS and self._s.simulator is not None:
            return [SIMULATOR]
        panic = ["panic"] if now - self._panic_heard <= PANIC_LIFE_S else []
        vision = ["vision"] if frame.msgid in _FOR_VISION and frame.compid == AUTOPILOT else []
        return ["router", *vision, *panic]

    def _hear(self, data: Buffer, frame: Frame, now: float) -> None:
        """The autopilot itself."""
        if now - self.gates.heard > _SILENT_S:
            self._streams.restart()
            if not self.gates.armed:  # it may have been another one in between
                self.params.restart()
        self.gates.heard = now
        self._streams.heard(frame.msgid, now)
        if frame.msgid == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
            self.params.hear(parse_value(data, frame))
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_PARAM_ERROR and frame.target_comp == COMPONENT:
            name, error, _ = parse_error(data, frame)
            self.params.refuse(name, error)
        elif frame.msgid in _READ:
            for m in self._own.parse(data[frame.start : frame.end]):
                self._take(m, now)

    def _take(self, m: Any, now: float) -> None:
        kind = m.get_type()
        if kind == "SYSTEM_TIME":
            if m.time_boot_ms < self._boot_ms - _REORDERED_MS:
                self._rebooted()
            self._boot_ms = m.time_boot_ms
        elif kind == "COMMAND_ACK":
            ours = (m.target_system, m.target_component) == (self.system, COMPONENT)
            if ours and m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._streams.answered(m.result, now)
        else:
            if kind == "HEARTBEAT":
                self._on_heartbeat(bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED), now)
            self.gates.on_autopilot(m, now)

    def _on_heartbeat(self, armed: bool, now: float) -> None:
        if not self.ever_heard:
            self._say("heard")
        elif now - self.gates.beat > _SILENT_S:
            self._say(f"heard again after {now - self.gates.beat:.0f} s")
        if armed and not self.gates.armed and (reasons := self.reasons(now)):
            self._say(f"is armed, though: {'; '.join(reasons)}")

    def _rebooted(self) -> None:
        self._say("has started anew: its parameters are read again")
        self.gates.forget()
        self.params.restart()
        self._streams.restart()

    # -- to the vehicle ------------------------------------------------------------------------------------------------

    def reasons(self, now: float) -> list[str]:
        """Why it may not be armed now; empty when it may."""
        return self.gates.reasons(now, self.params.reasons())

    def from_partner(self, link: str, data: Buffer, now: float) -> Out:
        """A datagram of a link's fixed partner. -> answers of ours."""
        found = parse_frames(data)
        if found.garbage:
            self.counts[f"from {link}: garbage bytes"] += found.garbage
        if link == "panic" and found.frames:
            self._panic_heard = now
        out: Out = []
        for frame in found.frames:
            if frame.msgid == _TIMESYNC and any(data[frame.payload : frame.payload + min(8, frame.size)]):
                self.counts["to the vehicle: TIMESYNC reply"] += 1
            elif asks_to_arm(data, frame, self.system):
                out += self._guard(link, data, frame, now)
            elif frame.msgid in STICKS and not self.gates.armed and self.reasons(now):
                self.counts["to the vehicle: sticks withheld"] += 1
            else:
                self._pass(link, data, frame, now)
        return out

    def from_simulator(self, data: Buffer, found: ParsedFrames, now: float) -> None:
        """A piece of the world's stream, cut."""
        for frame in found.frames:
            if frame.msgid in _SENSORS:
                self.outbox.put(Kind.SIMULATOR, bytes(data[frame.start : frame.end]), frame.msgid, now)
            else:
                self.counts["from the simulator: not for a controller in the loop"] += 1

    def next_out(self, now: float) -> bytes | None:
        """The next frame for the wire. A pose counts for the gates only when it leaves."""
        waiting = self.outbox.take(now)
        if waiting is None:
            return None
        self.flow["to_vehicle"] += 1
        if waiting.kind is Kind.VISION and waiting.msgid == mavlink.MAVLINK_MSG_ID_ODOMETRY:
            for m in self._own.parse(waiting.frame):
                self.flow["poses"] += 1
                self.gates.on_pose(m, now)
        return waiting.frame

    def _pass(self, link: str, data: Buffer, frame: Frame, now: float) -> None:
        self.outbox.put(_KINDS[link], bytes(data[frame.start : frame.end]), frame.msgid, now)

    def _guard(self, link: str, data: Buffer, frame: Frame, now: float) -> Out:
        """A request to arm: passed on, or withheld and answered."""
        flies = self.gates.armed and self.alive(now)
        in_flight = (
            flies and command_of(data, frame) == mavlink.MAV_CMD_MISSION_START
        )  # then it is a change of mode
        reasons = [] if in_flight else self.reasons(now)
        if not reasons:
            self._pass(link, data, frame, now)
            return []
        self.counts["to the vehicle: arming withheld"] += 1
        if now - self._withheld_told >= 1.0:
            self._withheld_told = now
            self._say(f"arming withheld (asked by {frame.sysid}/{frame.compid}): {'; '.join(reasons)}")
        fresh = now - self._texts_at.get(link, -math.inf) >= _TEXT_AGAIN_S
        if fresh:
            self._texts_at[link] = now
        answer = refusal(self._stead, data, frame, reasons if fresh else ())
        return [(end, answer) for end in dict.fromkeys((link, "router"))]

    # -- by the clock --------------------------------------------------------------------------------------------------

    def greeting(self) -> bytes:
        """What the world hears first, in the controller's name."""
        quad, px4, hil = (
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            mavlink.MAV_MODE_FLAG_HIL_ENABLED,
        )
        return self._stead.pack(
            mavlink.MAVLink_heartbeat_message(quad, px4, hil, 0, mavlink.MAV_STATE_STANDBY, 3)
        )

    def tick(self, now: float) -> None:
        """Some twenty times a second: heartbeat, requests, complaints."""
        if now - self._beat >= 1.0:
            self._beat = now
            heartbeat = self._own.onboard_heartbeat()
            self.outbox.put(Kind.ROUTER, heartbeat, mavlink.MAVLINK_MSG_ID_HEARTBEAT, now)
        if self.alive(now):
            self._complained, self._bytes, self._foreign = now, 0, 0
            self._ask(now)
        elif now - self._complained >= _COMPLAIN_S:
            self._complain(now)

    def _ask(self, now: float) -> None:
        for name in self.params.due(now):
            self._speak(
                mavlink.MAVLink_param_request_read_message(self.system, AUTOPILOT, name.encode(), -1), now
            )
        if (wanted := self._streams.due(now)) is not None:
            number = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._speak(
                mavlink.MAVLink_command_long_message(
                    self.system, AUTOPILOT, number, 0, float(wanted[0]), wanted[1], 0, 0, 0, 0, 0
                ),
                now,
            )

    def _speak(self, message: Any, now: float) -> None:
        self.outbox.put(Kind.ROUTER, self._own.pack(message), message.get_msgId(), now)

    def _complain(self, now: float) -> None:
        """What the wire has been like since it was last told."""
        wire, since = self._s.connection, now - self._complained
        if self._foreign:
            k, others = self.system, f"system {self._foreign >> 8} component {self._foreign & 0xFF}"
            self._say(
                f"on {wire} {others} speaks, and no autopilot with id {k}: set the vehicle's MAV_SYS_ID to {k}"
            )
        elif self._bytes:
            baud = "is the baud rate right?" if wire.kind == "serial" else "does something else send here?"
            self._say(f"on {wire} bytes come but no MAVLink: {baud}")
        else:
            self._say(f"nothing heard on {wire} for {since:.0f} s: is it switched on, and does it send here?")
        self._complained, self._bytes, self._foreign = now, 0, 0

    def _say(self, text: str) -> None:
        self._events.append(f"{self._s.vehicle}: {text}")

    def events(self) -> list[str]:
        """Sentences since the last call, each with the vehicle's name."""
        for source in (self.params, self._streams):
            for text in source.events:
                self._say(text)
            source.events.clear()
        found, self._events = self._events, []
        return found
