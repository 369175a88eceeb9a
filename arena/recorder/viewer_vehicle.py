"""Output channels of one vehicle for Foxglove and PlotJuggler.

They convert MAVLink datagrams, captured poses and true states to messages.

Messages of a topic with a limited rate are decoded only when they are published. No sockets, no clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from foxglove import Context
from foxglove.messages import Log
from pymavlink.dialects.v20 import common as mavlink

from arena.constants import MAX_ROTORS
from arena.kernels.rotations import euler
from arena.recorder.viewer_log import TextAssembler, log_of_text
from arena.recorder.viewer_meters import GapMeter, PathPieces, TrafficMeter, sequence_of
from arena.recorder.viewer_output import Output
from arena.recorder.viewer_poses import nanoseconds, pose_and_transform, pose_in_arena
from arena.recorder.viewer_scene import VehicleShape, path_piece, planned_path, vehicle_model
from arena.wire.mavlink_frame import AUTOPILOT, Frame, parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.mavlink_layout import decoder, layout
from arena.wire.mavlink_pressure import pressure_pa
from arena.wire.planned_path import PathAssembler, may_contain_path
from arena.wire.px4_mode import mode_words
from arena.wire.viewer_messages import pack_state
from arena.wire.viewer_topics import VEHICLE_TOPICS, Content

_MAGIC, _SHORTEST = 0xFD, 12  # bytes of a frame without payload
_REFERENCE = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
_NAN = math.nan
_HPA_PER_PA = 0.01
_LEVEL = (1.0, 0.0, 0.0, 0.0)
_HEALTH = {
    number: entry.name.removeprefix("MAV_STATE_")
    for number, entry in mavlink.enums["MAV_STATE"].items()
    if not entry.name.endswith("ENUM_END")
}
_UNKNOWN_VOLTAGE, _PWM_MIN, _PWM_SPAN = 65535, 1000.0, 1000.0
_FIRST_SERVO = list(layout(mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)).index("servo1_raw")
_END_SERVO = _FIRST_SERVO + MAX_ROTORS

Position = tuple[float, float, float]
Attitude = tuple[float, float, float, float]
SendLog = Callable[[Log, float], None]
_Due = Callable[[float], bool]
_Decode = Callable[[bytes, Frame], Any]
_Handler = Callable[[Any, float], None]


class VehicleChannels:
    """Output channels of one vehicle for viewers.

    context: context of foxglove-sdk.  name, system_id: name and MAV_SYS_ID of the vehicle.
    shape: its dimensions; None without a model.
    transforms: channel for frames of all vehicles.  send_log: function that sends a log line at a time [s].
    poses: counter of the captured poses.
    """

    def __init__(
        self,
        context: Context,
        name: str,
        system_id: int,
        shape: VehicleShape | None,
        transforms: Output,
        send_log: SendLog,
    ) -> None:
        self._name, self._system, self._shape = name, system_id, shape
        self._autopilot = (system_id, AUTOPILOT)
        self._out = {content: Output(context, content, name) for content in VEHICLE_TOPICS}
        self._transforms, self._send_log = transforms, send_log
        self._texts = TextAssembler()
        self._handlers = _handlers(self)
        self._position: Position | None = None
        self._attitude: Attitude = _LEVEL
        self._mode, self._health = "", ""
        self._armed = self._landed = False
        self._sent_state: tuple[object, ...] = ()
        self._traffic, self.poses = TrafficMeter(), GapMeter()
        self._flown, self._desired = PathPieces(), PathPieces()
        self._plan, self._plan_changed = PathAssembler(system_id), False

    # -- received data

    def on_datagram(self, up: bool, data: bytes, time_s: float) -> None:
        """Publish the content of a MAVLink datagram to viewers.

        up: it was sent to the vehicle.
        time_s: time of reception [s].
        """
        self._traffic.count(up, data)
        if up:
            self._take_references(data, time_s)
            return
        message = only_message(data)
        if message is not None and message not in self._handlers:
            if (data[5], data[6]) == self._autopilot:
                self._traffic.sequence(data[4], data[4])
            return
        frames = parse_frames(data).frames
        if frames and (frames[0].sysid, frames[0].compid) == self._autopilot:
            self._traffic.sequence(sequence_of(data, frames[0]), sequence_of(data, frames[-1]))
        for frame in frames:
            _, _, _, _, system, component, message, _, _ = frame
            found = self._handlers.get(message)
            if found is None or component != AUTOPILOT or system != self._system:
                continue
            due, decode, publish = found
            if due(time_s):
                publish(decode(data, frame), time_s)

    def _take_references(self, data: bytes, time_s: float) -> None:
        """Read the reference state or the planned path in a datagram of a user program, to show it in viewers."""
        if may_contain_path(data):
            self._plan_changed |= self._plan.on_datagram(data)
            return
        if only_message(data) not in (None, _REFERENCE):
            return
        for frame in parse_frames(data).frames:
            if (frame.msgid, frame.compid, frame.sysid) != (_REFERENCE, PROGRAM_COMPONENT, self._system):
                continue
            if self._out[Content.PROGRAM_REFERENCE].due(time_s):
                self._reference(decoder(_REFERENCE)(data, frame), time_s, Content.PROGRAM_REFERENCE)

    def on_pose(self, p_n: Sequence[float], q_nb: Sequence[float], time_s: float) -> None:
        """Publish a captured pose of the vehicle, at a limited rate.

        `poses` also counts the poses that are not published.

        p_n: position [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).  time_s: time of reception [s].
        """
        self._send_pose(Content.CAPTURED_POSE, f"{self._name}/mocap", p_n, q_nb, time_s)

    def on_truth(self, p_n: Sequence[float], q_nb: Sequence[float], time_s: float) -> None:
        """Publish the true pose of a simulated vehicle.

        p_n, q_nb: as in `on_pose`.
        time_s: time of the state [s].
        """
        self._send_pose(Content.TRUE_POSE, f"{self._name}/truth", p_n, q_nb, time_s)

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
            self._out[Content.MODEL].send(vehicle_model(self._name, self._shape, time_s), time_s)

    def send_rates(self, time_s: float, period_s: float) -> None:
        """Publish to viewers: message rates, rate and age of the captured poses, and new parts of the flown and wanted path.

        period_s: time since the last call [s].
        """
        self._out[Content.LINK].send_numbers(time_s, *self._traffic.take(period_s))
        poses = self.poses
        if poses.newest_s is not None:
            age = time_s - poses.newest_s
            rate, gap = poses.take(period_s)
            self._out[Content.BODY_HEALTH].send_numbers(time_s, rate, age, max(gap, age))
        for path, desired in ((self._flown, False), (self._desired, True)):
            if len(points := path.take()) > 1:
                piece = path_piece(self._name, path.pieces, points, time_s, desired=desired)
                self._out[Content.PATH].send(piece, time_s)
        if self._plan_changed:
            self._plan_changed = False
            self._out[Content.PATH].send(planned_path(self._name, self._plan.points, time_s), time_s)
        if self._mode:
            self._send_state(time_s)

    # -- messages of the autopilot

    def _local(self, m: Any, time_s: float) -> None:
        self._position = m.x, m.y, m.z
        self._out[Content.LOCAL_POSITION].send_numbers(time_s, m.x, m.y, m.z, m.vx, m.vy, m.vz)
        self._flown.add(self._position, time_s)

    def _attitude_quaternion(self, m: Any, time_s: float) -> None:
        q_nb = self._attitude = m.q1, m.q2, m.q3, m.q4
        self._out[Content.ATTITUDE].send_numbers(
            time_s, *q_nb, *euler(q_nb), m.rollspeed, m.pitchspeed, m.yawspeed
        )
        if self._position is not None and self._out[Content.ESTIMATED_POSE].due(time_s):
            self._send_pose(Content.ESTIMATED_POSE, self._name, self._position, q_nb, time_s)

    def _position_target(self, m: Any, time_s: float) -> None:
        self._reference(m, time_s, Content.POSITION_SETPOINT)

    def _reference(self, m: Any, time_s: float, content: Content) -> None:
        mask = m.type_mask
        values = [
            _NAN if mask >> bit & 1 else value for bit, value in enumerate((m.x, m.y, m.z, m.vx, m.vy, m.vz))
        ]
        yaw = _NAN if mask >> 10 & 1 else m.yaw
        self._out[content].send_numbers(time_s, *values, yaw)
        position = values[0], values[1], values[2]
        if content is Content.POSITION_SETPOINT and all(map(math.isfinite, position)):
            half = 0.5 * (yaw if math.isfinite(yaw) else euler(self._attitude)[2])
            q_nb = math.cos(half), 0.0, 0.0, math.sin(half)
            self._out[Content.SETPOINT_POSE].send(pose_in_arena(position, q_nb, time_s), time_s)
            self._desired.add(position, time_s)

    def _attitude_target(self, m: Any, time_s: float) -> None:
        rates = m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate
        self._out[Content.ATTITUDE_SETPOINT].send_numbers(time_s, *m.q, *euler(m.q), *rates, m.thrust)

    def _servos(self, m: Any, time_s: float) -> None:
        self._out[Content.ACTUATORS].send_numbers(time_s, *map(_output, m[_FIRST_SERVO:_END_SERVO]))

    def _controls(self, m: Any, time_s: float) -> None:
        self._out[Content.ACTUATORS].send_numbers(time_s, *m.controls)

    def _highres(self, m: Any, time_s: float) -> None:
        self._out[Content.IMU].send_numbers(
            time_s,
            *(m.xacc, m.yacc, m.zacc, m.xgyro, m.ygyro, m.zgyro, m.xmag, m.ymag, m.zmag),
            *(_HPA_PER_PA * pressure_pa(m.abs_pressure), m.pressure_alt, m.temperature),
        )

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

    def _send_pose(
        self, content: Content, frame: str, p_n: Sequence[float], q_nb: Sequence[float], time_s: float
    ) -> None:
        log_time = nanoseconds(time_s)
        made = pose_and_transform(frame, p_n, q_nb, log_time)
        if made is not None:
            self._out[content].log(made[0], log_time=log_time)
            self._transforms.log(made[1], log_time=log_time)


def only_message(data: bytes) -> int | None:
    """Return the message id of a datagram that contains a single unsigned MAVLink 2 frame, else None."""
    if len(data) < _SHORTEST or data[0] != _MAGIC or len(data) != _SHORTEST + data[1] or data[2]:
        return None
    return data[7] | data[8] << 8 | data[9] << 16


def _output(pwm: float) -> float:
    """Convert a pulse width [us] to a motor output 0..1, or to NaN for an unused output (pulse width 0)."""
    return min(max((pwm - _PWM_MIN) / _PWM_SPAN, 0.0), 1.0) if pwm else _NAN


def _always(time_s: float) -> bool:
    return True


def _handlers(v: VehicleChannels) -> dict[int, tuple[_Due, _Decode, _Handler]]:
    """Return a dictionary: message id -> (rate limit, decoder, function that publishes the message)."""

    def limited(content: Content, handler: _Handler) -> tuple[_Due, _Handler]:
        return v.output(content).due, handler

    found: dict[int, tuple[_Due, _Handler]] = {
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: limited(Content.LOCAL_POSITION, v._local),
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: limited(Content.ATTITUDE, v._attitude_quaternion),
        _REFERENCE: limited(Content.POSITION_SETPOINT, v._position_target),
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: limited(Content.ATTITUDE_SETPOINT, v._attitude_target),
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: limited(Content.ACTUATORS, v._servos),
        mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET: limited(Content.ACTUATORS, v._controls),
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: limited(Content.IMU, v._highres),
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: limited(Content.BATTERY, v._sys_status),
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: limited(Content.ESTIMATOR, v._estimator),
        mavlink.MAVLINK_MSG_ID_WIND_COV: limited(Content.WIND, v._wind),
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: (_always, v._heartbeat),
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (_always, v._extended),
        mavlink.MAVLINK_MSG_ID_STATUSTEXT: (_always, v._text),
    }
    return {message: (due, decoder(message), publish) for message, (due, publish) in found.items()}
