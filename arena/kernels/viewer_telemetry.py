"""Converts the frequent MAVLink messages of one vehicle to messages for viewers.

`arena.recorder.viewer_vehicle` makes the tables of the MAVLink fields, and publishes the rare messages.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.viewer_messages import NumberMessages, PoseMessages
from arena.kernels.viewer_meters import PathPieces, Period, Throttle, TrafficMeter, nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from arena.kernels.arrays import Floats, Integers
    from arena.kernels.mavlink_framing import FrameParser
    from arena.kernels.viewer_meters import Datagram

    Log = Callable[..., None]
    OnRare = Callable[[bytes, Any, float], None]
    OnUp = Callable[[bytes, float], None]
    Position = tuple[float, float, float]
    Quaternion = tuple[float, float, float, float]

KINDS = "BbHhIiQqf"
"""Types of fields that can be read, as codes of the module `struct`. The tables contain positions in this text."""
_UINT8, _INT8, _UINT16, _INT16, _UINT32, _INT32, _UINT64, _INT64 = range(8)
FREQUENT = (
    "LOCAL_POSITION_NED",
    "ATTITUDE_QUATERNION",
    "POSITION_TARGET_LOCAL_NED",
    "ATTITUDE_TARGET",
    "SERVO_OUTPUT_RAW",
    "ACTUATOR_CONTROL_TARGET",
    "HIGHRES_IMU",
)
"""MAVLink messages that this module reads. Their positions are the kinds of messages."""
_LOCAL, _ATTITUDE, _POSITION_TARGET, _ATTITUDE_TARGET, _SERVOS, _CONTROLS, _IMU = range(7)
_RARE, _IGNORED = 7, 8  # kinds of all other messages
_MOST_BYTES = 256  # more than every payload
_V2, _HEAD, _CRC, _SIGNATURE, _SIGNED = 0xFD, 10, 2, 13, 0x01
_NO_YAW = 1 << 10  # bit of the type_mask in POSITION_TARGET_LOCAL_NED
_MESSAGES = 256  # ids below this number have a kind
_PWM_MIN_US, _PWM_SPAN_US = 1000.0, 1000.0
_HPA_PER_PA = 0.01
_NAN = float("nan")


class NumberOutput:
    """Output of one topic whose messages are float32 numbers.

    due: limit of its rate.  log: function that sends a message at a log time [ns].  messages: encoder.
    """

    def __init__(self, due: Throttle, log: Log, count: int) -> None:
        """count: number of fields of a message."""
        self.due, self.log, self.messages = due, log, NumberMessages(count)

    def send(self, log_time: int) -> None:
        """Send the values that are stored in `messages`. log_time: log time [ns]."""
        self.log(self.messages.message(), log_time)


class PoseOutput:
    """Output of the poses of one body frame: a topic, and the transform of the frame in a topic of all vehicles.

    due: limit of its rate.
    """

    def __init__(self, due: Throttle, log: Log, log_transform: Log | None, root: str, frame: str) -> None:
        """Create the output.

        log, log_transform: functions that send a message at a log time [ns]. None: no transforms are sent.
        root, frame: names of the root frame and of the body frame.
        """
        self.due, self._log, self._log_transform = due, log, log_transform
        self._messages = PoseMessages(root, frame)

    def send(self, p_n: Position, q_nb: Quaternion, log_time: int) -> None:
        """Send a pose, and its transform if all numbers are finite. With a transform, other poses are not sent.

        p_n: position of the body origin [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).  log_time: log time [ns].
        """
        messages = self._messages
        if self._log_transform is None:
            messages.set(p_n, q_nb, log_time)
            self._log(messages.pose(), log_time)
        elif math.isfinite(p_n[0] + p_n[1] + p_n[2] + q_nb[0] + q_nb[1] + q_nb[2] + q_nb[3]):
            messages.set(p_n, q_nb, log_time)
            self._log(messages.pose(), log_time)
            self._log_transform(messages.transform(), log_time)


class PayloadReader:
    """Reader of the numbers in the payloads of one MAVLink message.

    number: message id.  values: the numbers of the payload that was read last (F,).
    """

    def __init__(self, number: int, size: int, fields: Sequence[tuple[int, int]]) -> None:
        """Create the reader for one message.

        size: number of bytes of the complete payload.
        fields: for each number: its type as position in `KINDS`, and its offset in units of the type's size (F, 2)
        """
        self.number, self._size, self._count = number, size, len(fields)
        self._kinds, self._places = _integers(len(fields)), _integers(len(fields))
        for k, (kind, place) in enumerate(fields):
            self._kinds[k], self._places[k] = kind, place
        self.values = memoryview(bytearray(8 * len(fields))).cast("d")
        raw = memoryview(bytearray(_MOST_BYTES))
        self._u8, self._i8, self._u16, self._i16 = raw, raw.cast("b"), raw.cast("H"), raw.cast("h")
        self._u32, self._i32 = raw.cast("I"), raw.cast("i")
        self._u64, self._i64, self._f32 = raw.cast("Q"), raw.cast("q"), raw.cast("f")

    def read(self, data: bytes, at: int, size: int) -> Floats:
        """Read the numbers of a payload into `values`. Bytes beyond its end are 0, because MAVLink 2 truncates zeros.

        at: position of the payload in `data`.  size: number of its bytes.
        """
        size = min(size, self._size)
        for k in range(size):
            self._u8[k] = data[at + k]
        for k in range(size, self._size):
            self._u8[k] = 0
        for k in range(self._count):
            self.values[k] = self._number(self._kinds[k], self._places[k])
        return self.values

    def _number(self, kind: int, at: int) -> float:
        if kind > _INT64:
            return self._f32[at]
        if kind == _UINT8:
            return self._u8[at]
        if kind == _INT8:
            return self._i8[at]
        if kind == _UINT16:
            return self._u16[at]
        if kind == _INT16:
            return self._i16[at]
        if kind == _UINT32:
            return self._u32[at]
        if kind == _INT32:
            return self._i32[at]
        return self._u64[at] if kind == _UINT64 else self._i64[at]


class ViewerTelemetry:
    """Publishes the content of the MAVLink datagrams of one vehicle to viewers.

    A message is decoded only if it is published.

    traffic: counter of the datagrams.  flown, desired: positions of the vehicle and of its setpoints.
    """

    def __init__(
        self,
        sender: tuple[int, int],
        frames: FrameParser,
        readers: Sequence[PayloadReader],
        numbers: Mapping[str, NumberOutput],
        poses: Mapping[str, PoseOutput],
        rare: Sequence[int],
        on_rare: OnRare,
        pressure_pa: Callable[[float], float],
        up: Sequence[int],
        on_up: OnUp,
    ) -> None:
        """Create the converter of one vehicle.

        sender: system and component of the autopilot.  frames: finds the frames in a datagram.
        readers: one per message of `FREQUENT`.
        numbers, poses: outputs by names of topics.
        rare, on_rare: ids of other messages, and the function that gets them: datagram, frame (fields of `Frame`), time [s].
        pressure_pa: converts `abs_pressure` of HIGHRES_IMU to pascal.
        up: ids of the messages to the vehicle that are shown in viewers.
        on_up: function that gets (data, time [s]) of each datagram that may contain one of them.
        """
        self._system, self._component = sender
        self._frames, self._readers = frames, list(readers)
        self._kinds = _integers(_MESSAGES)
        for k in range(_MESSAGES):
            self._kinds[k] = _IGNORED
        for number in rare:
            self._kinds[number] = _RARE
        for kind, reader in enumerate(readers):
            self._kinds[reader.number] = kind
        self._local, self._attitude = numbers["local_position"], numbers["attitude"]
        self._position_setpoint, self._program = numbers["position_setpoint"], numbers["program_reference"]
        self._attitude_setpoint, self._actuators = numbers["attitude_setpoint"], numbers["actuators"]
        self._imu = numbers["imu"]
        self._pose, self._setpoint_pose = poses["estimate/pose"], poses["setpoint/pose"]
        self._on_rare, self._pressure_pa = on_rare, pressure_pa
        self._up_messages, self._on_up = frozenset(up), on_up
        self.traffic, self.flown, self.desired = TrafficMeter(), PathPieces(), PathPieces()
        self._has_position = False
        self._position = (0.0, 0.0, 0.0)
        self._q_nb = (1.0, 0.0, 0.0, 0.0)

    def on_datagram(self, data: bytes, time_s: float) -> None:
        """Publish the content of a datagram from the vehicle.

        time_s: time of reception [s].
        """
        size = len(data)
        self.traffic.count(False, size)
        at = last = 0
        wanted = False
        while at < size:
            end = self._end(data, at, size)
            if end < 0 or (self._is_wanted(data, at, time_s) and not self._crc_fits(data, at, size)):
                self._take_frames(data, time_s)
                return
            wanted = wanted or self._is_wanted(data, at, time_s)
            last, at = at, end
        if size and self._is_from_autopilot(data[5], data[6]):
            self.traffic.sequence(data[4], data[last + 4])
        at = 0
        while wanted and at < size:
            end = self._end(data, at, size)
            if self._is_wanted(data, at, time_s):
                number = data[at + 7] + (data[at + 8] << 8) + (data[at + 9] << 16)
                self._publish(data, at, at + _HEAD, data[at + 1], number, time_s)
            at = end

    def on_datagram_up(self, data: bytes, time_s: float) -> None:
        """Count a datagram that was sent to the vehicle, and pass it to `on_up` if it may contain anything for viewers.

        time_s: time of reception [s].
        """
        self.traffic.count(True, len(data))
        if self._may_be_for_viewers(data):
            self._on_up(data, time_s)

    def _may_be_for_viewers(self, data: bytes) -> bool:
        """Return False for a single MAVLink 2 frame of a message that is not for viewers, such as a setpoint."""
        size = len(data)
        if self._end(data, 0, size) != size or data[2]:
            return True
        number = data[7] + (data[8] << 8) + (data[9] << 16)
        return number in self._up_messages

    def on_reference(self, data: bytes, at: int, size: int, time_s: float) -> None:
        """Publish a POSITION_TARGET_LOCAL_NED of a user program, which describes the reference that the program follows.

        at, size: position and number of bytes of the payload.
        """
        if self._program.due.due(time_s):
            self._send_target(self._program, data, at, size, time_s)

    def _end(self, data: bytes, at: int, size: int) -> int:
        """Return the end of the MAVLink 2 frame at a position; -1 if no whole frame begins there."""
        if at + _HEAD + _CRC > size or data[at] != _V2 or data[at + 2] > _SIGNED or data[at + 5] == 0:
            return -1
        end = at + _HEAD + data[at + 1] + _CRC + (_SIGNATURE if data[at + 2] == _SIGNED else 0)
        return end if end <= size else -1

    def _kind(self, number: int) -> int:
        return self._kinds[number] if number < _MESSAGES else _IGNORED

    def _is_from_autopilot(self, system: int, component: int) -> bool:
        return system == self._system and component == self._component

    def _is_wanted(self, data: bytes, at: int, time_s: float) -> bool:
        """Return whether the MAVLink 2 frame at a position is to be published at this time [s]."""
        if data[at + 8] or data[at + 9] or not self._is_from_autopilot(data[at + 5], data[at + 6]):
            return False
        kind = self._kind(data[at + 7])
        if kind >= _RARE:
            return kind == _RARE
        return self._limit(kind).is_due(time_s)

    def _limit(self, kind: int) -> Throttle:
        """Return the rate limit of one kind of messages."""
        if kind == _LOCAL:
            return self._local.due
        if kind == _ATTITUDE:
            return self._attitude.due
        if kind == _POSITION_TARGET:
            return self._position_setpoint.due
        if kind == _ATTITUDE_TARGET:
            return self._attitude_setpoint.due
        if kind == _IMU:
            return self._imu.due
        return self._actuators.due

    def _crc_fits(self, data: bytes, at: int, size: int) -> bool:
        frame = self._frames.frame_at(data, at, size)
        return frame is not None and self._frames.crc_fits(data, frame)

    def _take_frames(self, data: bytes, time_s: float) -> None:
        """Publish the content of a datagram that contains more than whole MAVLink 2 frames, such as MAVLink 1 or garbage."""
        frames = self._frames.parse(data).frames
        if not frames:
            return
        if self._is_from_autopilot(frames[0][4], frames[0][5]):
            self.traffic.sequence(_sequence(data, frames[0][0]), _sequence(data, frames[len(frames) - 1][0]))
        for frame in frames:
            if self._is_from_autopilot(frame[4], frame[5]):
                self._publish(data, frame[0], frame[2], frame[3], frame[6], time_s)

    def _publish(self, data: bytes, start: int, at: int, size: int, number: int, time_s: float) -> None:
        """Publish a message of the autopilot, if the rate limit of its topic allows it.

        start: position of its frame.  at, size: position and number of bytes of its payload.  number: message id.
        """
        kind = self._kind(number)
        if kind == _RARE:
            self._on_rare(data, self._frames.frame_at(data, start, len(data)), time_s)
        if kind >= _RARE or not self._limit(kind).due(time_s):
            return
        if kind == _POSITION_TARGET:
            self._send_target(self._position_setpoint, data, at, size, time_s)
            return
        log_time = nanoseconds(time_s)
        reader: PayloadReader = self._readers[kind]
        values = reader.read(data, at, size)
        if kind == _LOCAL:
            self._send_local(values, time_s, log_time)
        elif kind == _ATTITUDE:
            self._send_attitude(values, time_s, log_time)
        elif kind == _ATTITUDE_TARGET:
            self._send_attitude_target(values, log_time)
        elif kind == _IMU:
            values[9] = _HPA_PER_PA * self._pressure_pa(values[9])
            self._send_all(self._imu, values, log_time)
        else:
            if kind == _SERVOS:
                for k in range(len(values)):
                    values[k] = _motor_output(values[k])
            self._send_all(self._actuators, values, log_time)

    def _send_all(self, output: NumberOutput, values: Floats, log_time: int) -> None:
        for k in range(len(values)):
            output.messages.set(k, values[k])
        output.send(log_time)

    def _send_local(self, values: Floats, time_s: float, log_time: int) -> None:
        self._position, self._has_position = (values[0], values[1], values[2]), True
        self._send_all(self._local, values, log_time)
        self.flown.add(values[0], values[1], values[2], time_s)

    def _send_attitude(self, values: Floats, time_s: float, log_time: int) -> None:
        self._q_nb = (values[0], values[1], values[2], values[3])
        self._store_attitude(self._attitude, values)
        self._attitude.send(log_time)
        if self._has_position and self._pose.due.due(time_s):
            self._pose.send(self._position, self._q_nb, log_time)

    def _send_attitude_target(self, values: Floats, log_time: int) -> None:
        self._store_attitude(self._attitude_setpoint, values)
        self._attitude_setpoint.messages.set(10, values[7])  # thrust
        self._attitude_setpoint.send(log_time)

    def _store_attitude(self, output: NumberOutput, values: Floats) -> None:
        """Store an attitude in a message: quaternion, Euler angles and body rates. values: quaternion, body rates."""
        roll, pitch, yaw = rotations.euler((values[0], values[1], values[2], values[3]))
        for k in range(4):
            output.messages.set(k, values[k])
        output.messages.set(4, roll)
        output.messages.set(5, pitch)
        output.messages.set(6, yaw)
        for k in range(3):
            output.messages.set(7 + k, values[4 + k])

    def _send_target(self, output: NumberOutput, data: bytes, at: int, size: int, time_s: float) -> None:
        """Send a POSITION_TARGET_LOCAL_NED. Its values that are not controlled become NaN."""
        reader: PayloadReader = self._readers[_POSITION_TARGET]
        values = reader.read(data, at, size)
        mask, log_time = int(values[7]), nanoseconds(time_s)
        for k in range(6):
            if mask >> k & 1:
                values[k] = _NAN
            output.messages.set(k, values[k])
        yaw = _NAN if mask & _NO_YAW else values[6]
        output.messages.set(6, yaw)
        output.send(log_time)
        north, east, down = values[0], values[1], values[2]
        if output is self._program or not (
            math.isfinite(north) and math.isfinite(east) and math.isfinite(down)
        ):
            return
        if not math.isfinite(yaw):
            _, _, yaw = rotations.euler(self._q_nb)
        self._setpoint_pose.send(
            (north, east, down), (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)), log_time
        )
        self.desired.add(north, east, down, time_s)


def publish_datagrams(
    datagrams: list[Datagram],
    vehicles: Mapping[str, ViewerTelemetry],
    period: Period,
    on_period: Callable[[float], None],
) -> None:
    """Publish the content of datagrams to viewers.

    datagrams: (vehicle, up, data, time of reception [s]) of each.  vehicles: converter of each vehicle, by name.
    on_period: function that publishes the periodic messages at a time [s]; it is called when `period` has ended.
    """
    for vehicle, up, data, time_s in datagrams:
        if period.ended(time_s):
            on_period(time_s)
        telemetry = vehicles[vehicle]
        if up:
            telemetry.on_datagram_up(data, time_s)
        else:
            telemetry.on_datagram(data, time_s)


def _motor_output(pwm_us: float) -> float:
    """Convert a pulse width [us] to a motor output 0..1, or to NaN for an unused output (pulse width 0)."""
    if pwm_us == 0.0:
        return _NAN
    return min(max((pwm_us - _PWM_MIN_US) / _PWM_SPAN_US, 0.0), 1.0)


def _sequence(data: bytes, start: int) -> int:
    """Return the MAVLink sequence number of the frame at a position."""
    return data[start + (4 if data[start] == _V2 else 2)]


def _integers(count: int) -> Integers:
    return memoryview(bytearray(8 * count)).cast("l")
