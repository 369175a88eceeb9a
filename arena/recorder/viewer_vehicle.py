"""Output channels of one vehicle for Foxglove and PlotJuggler.

They convert MAVLink datagrams, captured poses and true states to messages. The kernel `viewer_telemetry` converts the frequent messages.

Messages of a topic with a limited rate are decoded only when they are published. No sockets, no clocks.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from foxglove.messages import Log
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.kernels.viewer_meters import GapMeter
from arena.kernels.viewer_telemetry import FREQUENT, KINDS, PayloadReader, PoseOutput, ViewerTelemetry
from arena.recorder.mcap_file import MakeChannel
from arena.recorder.viewer_log import TextAssembler, log_of_text
from arena.recorder.viewer_output import Output
from arena.recorder.viewer_poses import ROOT
from arena.recorder.viewer_scene import VehicleShape, path_piece, planned_path, vehicle_model
from arena.wire.mavlink_frame import AUTOPILOT, PARSER, Frame, parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.mavlink_layout import decoder, layout, payload_bytes
from arena.wire.mavlink_pressure import pressure_pa
from arena.wire.planned_path import PATH_MESSAGE, PathAssembler, may_contain_path
from arena.wire.px4_mode import mode_words
from arena.wire.viewer_messages import pack_state
from arena.wire.viewer_topics import VEHICLE_TOPICS, Content

if TYPE_CHECKING:
    from arena.kernels.mavlink_framing import Fields

_REFERENCE = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
_NAN = math.nan
_HEALTH = {
    number: entry.name.removeprefix("MAV_STATE_")
    for number, entry in mavlink.enums["MAV_STATE"].items()
    if not entry.name.endswith("ENUM_END")
}
_UNKNOWN_VOLTAGE = 65535
_VELOCITY, _RATES = ("vx", "vy", "vz"), ("rollspeed", "pitchspeed", "yawspeed")
_FIELDS: dict[str, tuple[str, ...]] = {
    "LOCAL_POSITION_NED": ("x", "y", "z", *_VELOCITY),
    "ATTITUDE_QUATERNION": ("q1", "q2", "q3", "q4", *_RATES),
    "POSITION_TARGET_LOCAL_NED": ("x", "y", "z", *_VELOCITY, "yaw", "type_mask"),
    "ATTITUDE_TARGET": ("q", "body_roll_rate", "body_pitch_rate", "body_yaw_rate", "thrust"),
    "SERVO_OUTPUT_RAW": tuple(f"servo{k}_raw" for k in range(1, MAX_ROTORS + 1)),
    "ACTUATOR_CONTROL_TARGET": ("controls",),
    "HIGHRES_IMU": (
        *(f"{axis}{name}" for name in ("acc", "gyro", "mag") for axis in "xyz"),
        *("abs_pressure", "pressure_alt", "temperature"),
    ),
}
"""Message -> the fields that the kernel `viewer_telemetry` reads, in this order."""

SendLog = Callable[[Log, float], None]
_Due = Callable[[float], bool]
_Decode = Callable[[bytes, Frame], Any]
_Handler = Callable[[Any, float], None]


class VehicleChannels:
    """Output channels of one vehicle for viewers.

    channel: creates a channel in the record.  name, system_id: name and MAV_SYS_ID of the vehicle.
    shape: its dimensions; None without a model.
    transforms: channel for frames of all vehicles.  send_log: function that sends a log line at a time [s].
    poses: counter of the captured poses.
    telemetry: publishes the content of the vehicle's datagrams.
    on_pose, on_truth: publish a captured or a true pose: position [m] [NED] (3,), attitude [-] wxyz (4,), log time [ns].
    """

    def __init__(
        self,
        channel: MakeChannel,
        name: str,
        system_id: int,
        shape: VehicleShape | None,
        transforms: Output,
        send_log: SendLog,
    ) -> None:
        self._name, self._system, self._shape = name, system_id, shape
        self._out = {content: Output(channel, content, name) for content in VEHICLE_TOPICS}
        self._send_log = send_log
        self._texts = TextAssembler()
        self._handlers = _handlers(self)
        self._poses: dict[str, PoseOutput] = {
            Content.ESTIMATED_POSE: self._pose_output(Content.ESTIMATED_POSE, name, transforms),
            Content.CAPTURED_POSE: self._pose_output(Content.CAPTURED_POSE, f"{name}/mocap", transforms),
            Content.TRUE_POSE: self._pose_output(Content.TRUE_POSE, f"{name}/truth", transforms),
            Content.SETPOINT_POSE: self._pose_output(Content.SETPOINT_POSE, "", None),
        }
        self.on_pose = self._poses[Content.CAPTURED_POSE].send
        self.on_truth = self._poses[Content.TRUE_POSE].send
        self.telemetry = ViewerTelemetry(
            (system_id, AUTOPILOT),
            PARSER,
            _readers(),
            {content: out.numbers for content, out in self._out.items() if out.numbers is not None},
            self._poses,
            list(self._handlers),
            self._on_rare,
            pressure_pa,
            (_REFERENCE, PATH_MESSAGE),
            self._on_up,
        )
        self._mode, self._health = "", ""
        self._armed = self._landed = False
        self._sent_state: tuple[object, ...] = ()
        self.poses = GapMeter()
        self._plan, self._plan_changed = PathAssembler(system_id), False

    def _pose_output(self, content: Content, frame: str, transforms: Output | None) -> PoseOutput:
        out = self._out[content]
        return PoseOutput(out.limit, out.log, None if transforms is None else transforms.log, ROOT, frame)

    # -- received data

    def _on_up(self, data: bytes, time_s: float) -> None:
        """Publish the reference state or the planned path in a datagram of a user program, to show it in viewers.

        time_s: time of reception [s].
        """
        if may_contain_path(data):
            self._plan_changed |= self._plan.on_datagram(data)
            return
        for frame in parse_frames(data).frames:
            if (frame.msgid, frame.compid, frame.sysid) == (_REFERENCE, PROGRAM_COMPONENT, self._system):
                self.telemetry.on_reference(data, frame.payload, frame.size, time_s)

    def output(self, content: Content) -> Output:
        """Return the output channel for one kind of content, such as the attitude."""
        return self._out[content]

    def send_model(self, time_s: float) -> None:
        """Publish the 3D model of the vehicle. The next `send_rates` then publishes its planned path again.

        Without a known shape, no model is published.

        time_s: log time [s].
        """
        self._plan_changed |= bool(self._plan.points)
        if self._shape is not None:
            self._out[Content.MODEL].send(vehicle_model(self._name, self._shape, time_s).encode(), time_s)

    def send_rates(self, time_s: float, period_s: float) -> None:
        """Publish to viewers: message rates, rate and age of the captured poses, and new parts of the flown and wanted path.

        period_s: time since the last call [s].
        """
        self._out[Content.LINK].send_numbers(time_s, *self.telemetry.traffic.take(period_s))
        poses = self.poses
        if not math.isnan(poses.newest_s):
            age = time_s - poses.newest_s
            rate, gap = poses.take(period_s)
            self._out[Content.BODY_HEALTH].send_numbers(time_s, rate, age, max(gap, age))
        for path, desired in ((self.telemetry.flown, False), (self.telemetry.desired, True)):
            if len(points := path.take()) > 1:
                piece = path_piece(self._name, path.pieces, points, time_s, desired=desired)
                self._out[Content.PATH].send(piece.encode(), time_s)
        if self._plan_changed:
            self._plan_changed = False
            self._out[Content.PATH].send(planned_path(self._name, self._plan.points, time_s).encode(), time_s)
        if self._mode:
            self._send_state(time_s)

    # -- messages of the autopilot

    def _on_rare(self, data: bytes, fields: Fields, time_s: float) -> None:
        """Publish a message that the kernel does not read.

        fields: of its frame.
        """
        due, decode, publish = self._handlers[fields[6]]
        if due(time_s):
            publish(decode(data, Frame._make(fields)), time_s)

    def _sys_status(self, m: Any, time_s: float) -> None:
        voltage = _NAN if m.voltage_battery == _UNKNOWN_VOLTAGE else 1e-3 * m.voltage_battery
        current = _NAN if m.current_battery < 0 else 1e-2 * m.current_battery
        remaining = _NAN if m.battery_remaining < 0 else m.battery_remaining
        self._out[Content.BATTERY].send_numbers(time_s, voltage, current, remaining)

    def _estimator(self, m: Any, time_s: float) -> None:
        self._out[Content.ESTIMATOR].send_numbers(
            time_s,
            *(m.vel_ratio, m.pos_horiz_ratio, m.pos_vert_ratio, m.mag_ratio, m.hagl_ratio),
            *(m.pos_horiz_accuracy, m.pos_vert_accuracy, m.flags),
        )

    def _wind(self, m: Any, time_s: float) -> None:
        self._out[Content.WIND].send_numbers(time_s, m.wind_x, m.wind_y, m.wind_z)

    def _heartbeat(self, m: Any, time_s: float) -> None:
        self._mode, self._health = (
            mode_words(m.custom_mode),
            _HEALTH.get(m.system_status, str(m.system_status)),
        )
        self._armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._state_changed(time_s)

    def _extended(self, m: Any, time_s: float) -> None:
        self._landed = m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        self._state_changed(time_s)

    def _text(self, m: Any, time_s: float) -> None:
        for severity, text in self._texts.add(m):
            self._send_log(log_of_text(self._name, severity, text, time_s), time_s)

    # -- transmission

    def _state_changed(self, time_s: float) -> None:
        if self._mode and self._sent_state != (self._mode, self._armed, self._landed, self._health):
            self._send_state(time_s)

    def _send_state(self, time_s: float) -> None:
        state = self._mode, self._armed, self._landed, self._health
        self._sent_state = state
        self._out[Content.STATE].send(pack_state(*state), time_s)


@cache
def _readers() -> tuple[PayloadReader, ...]:
    """Return the readers of the frequent messages, which all vehicles share."""
    return tuple(_reader(name) for name in FREQUENT)


def _reader(message: str) -> PayloadReader:
    number = int(getattr(mavlink, f"MAVLINK_MSG_ID_{message}"))
    places, found = layout(number), []
    for name in _FIELDS[message]:
        field = places[name]
        first = field.offset // struct.calcsize(f"<{field.code}")
        found += [(KINDS.index(field.code), first + k) for k in range(field.elements)]
    return PayloadReader(number, payload_bytes(number), found)


def _always(time_s: float) -> bool:
    return True


def _handlers(v: VehicleChannels) -> dict[int, tuple[_Due, _Decode, _Handler]]:
    """Return the rare messages: message id -> (rate limit, decoder, function that publishes the message)."""

    def limited(content: Content, handler: _Handler) -> tuple[_Due, _Handler]:
        return v.output(content).limit.due, handler

    found: dict[int, tuple[_Due, _Handler]] = {
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: limited(Content.BATTERY, v._sys_status),
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: limited(Content.ESTIMATOR, v._estimator),
        mavlink.MAVLINK_MSG_ID_WIND_COV: limited(Content.WIND, v._wind),
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: (_always, v._heartbeat),
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (_always, v._extended),
        mavlink.MAVLINK_MSG_ID_STATUSTEXT: (_always, v._text),
    }
    return {message: (due, decoder(message), publish) for message, (due, publish) in found.items()}
