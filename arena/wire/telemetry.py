"""Telemetry of a PX4-style autopilot: decodes datagrams and keeps the newest values, such as the attitude.

No sockets, no clocks.

Only the messages in `_HANDLERS` are decoded. Other messages are more than half of an
onboard stream; only their checksum is checked. Units are SI and radians, frames NED and FRD, quaternions wxyz. Each value contains
the time at which it was received.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Generic, Self, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.newest_frames import NewestFrames
from arena.wire.mavlink_frame import AUTOPILOT, PARSER, Frame
from arena.wire.mavlink_layout import decoder
from arena.wire.mavlink_pressure import HIGHEST_HPA, HPA_PA, pressure_pa
from arena.wire.px4_mode import mode_words
from arena.wire.telemetry_values import (
    Ack,
    Actuators,
    Array,
    Attitude,
    AttitudeReference,
    Baro,
    Gps,
    Ground,
    HeartbeatState,
    Imu,
    Local,
    Mag,
    Reference,
    Status,
    Text,
)

GAUSS_T = 1e-4
HIGHRES_MAG, HIGHRES_BARO = 0x01C0, 0x1A00
"""Bits of `fields_updated` in HIGHRES_IMU."""


_Handler = Callable[["Telemetry", Any, float], None]
T = TypeVar("T")

_HIGHRES, _SERVOS = mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
_FIELDS_UPDATED = 60  # offset of this field in the payload of HIGHRES_IMU
_SLOTS = {
    number: number
    for number in (
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
        _HIGHRES,
        _SERVOS,
    )
} | {mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET: _SERVOS}
"""Messages that are decoded only when a program reads their value: message id -> slot, in which a newer frame replaces an older
one. Not every HIGHRES_IMU has new values of magnetometer and barometer: the newest frame of each combination is kept."""


def pressures_pa(abs_pressure: ArrayLike) -> Array:
    """Convert values of the field `abs_pressure` of HIGHRES_IMU to pascal, as `pressure_pa` converts one value."""
    given = np.asarray(abs_pressure, float)
    return np.where(given > HIGHEST_HPA, given, given * HPA_PA)


class _Newest(Generic[T]):
    """Attribute of `Telemetry` with the newest value of one kind of data, such as the attitude. It is decoded when it is read.

    slot: key in `Telemetry.waiting` of the frames that contain the value.
    """

    def __init__(self, slot: int) -> None:
        self._slot = slot

    def __set_name__(self, owner: type[Telemetry], name: str) -> None:
        self._name = f"_{name}"

    @overload
    def __get__(self, telemetry: None, owner: type[Telemetry]) -> Self: ...

    @overload
    def __get__(self, telemetry: Telemetry, owner: type[Telemetry]) -> T | None: ...

    def __get__(self, telemetry: Telemetry | None, owner: type[Telemetry]) -> T | Self | None:
        if telemetry is None:
            return self
        if self._slot in telemetry.waiting:
            telemetry.decode_waiting(self._slot)
        value: T | None = telemetry.__dict__.get(self._name)
        return value

    def __set__(self, telemetry: Telemetry, value: T | None) -> None:
        telemetry.__dict__[self._name] = value


class Telemetry:
    """Decoder that keeps the newest value of each kind of data, such as `local` or `attitude`.

    A value is None before the first message.

    A new message replaces the whole value. Frequent messages are decoded when their value is read, and only the
    newest one: a program that flies many vehicles reads few of the values.
    waiting: slot -> the newest frames that are not decoded yet, with their time of arrival [s]; see `_SLOTS`
    system_id, component_id: ids of the autopilot; messages of other senders are ignored
    only: message ids to decode; None decodes all messages in `_HANDLERS`
    outside_offboard_at: time of the last heartbeat that was disarmed or not in OFFBOARD [s]
    """

    local = _Newest[Local](mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    attitude = _Newest[Attitude](mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
    imu = _Newest[Imu](_HIGHRES)
    mag = _Newest[Mag](_HIGHRES)
    baro = _Newest[Baro](_HIGHRES)
    actuators = _Newest[Actuators](_SERVOS)
    reference = _Newest[Reference](mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED)
    attitude_reference = _Newest[AttitudeReference](mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET)

    def __init__(
        self, system_id: int, only: Collection[int] | None = None, component_id: int = AUTOPILOT
    ) -> None:
        self._handlers = {
            number: handler for number, handler in _HANDLERS.items() if only is None or number in only
        }
        self.gps: Gps | None = None
        self.heartbeat: HeartbeatState | None = None
        self.status: Status | None = None
        self.ground: Ground | None = None
        self.received_at: float | None = None
        self.outside_offboard_at = -math.inf
        self.waiting: dict[int, dict[int, tuple[bytes, Frame, float]]] = {}
        self._sender = system_id, component_id
        self._newest = self._newest_frames()
        self._lock = threading.RLock()  # a background thread may receive while the program reads
        self.version: tuple[int, int, int] | None = None
        self.texts: deque[Text] = deque(maxlen=32)
        self.acks: deque[Ack] = deque(maxlen=32)
        self._text_id = 0

    def on_datagram(self, datagram: bytes, now: float) -> bool:
        """Decode a datagram. Return whether it contains a message of the autopilot.

        now: time of arrival [s], by any clock.
        """
        with self._lock:
            frames = self._newest.receive(datagram, now)
            if frames is None:
                return False
            for frame in frames:
                self._decode(datagram, frame, now)
        self.received_at = now
        return True

    def decode_waiting(self, slot: int) -> None:
        """Decode the frames that wait for it, for one kind of data such as the attitude, in the order of arrival."""
        with self._lock:
            for datagram, frame, now in self.waiting.pop(slot, {}).values():
                self._decode(datagram, frame, now)

    def __copy__(self) -> Self:
        """Return a copy of the telemetry with its present values. Later messages do not change the copy."""
        with self._lock:
            for slot in list(self.waiting):
                self.decode_waiting(slot)
            made = type(self).__new__(type(self))
            made.__dict__ |= {**self.__dict__, "waiting": {}}
            made.texts, made.acks = self.texts.copy(), self.acks.copy()
            made._newest = made._newest_frames()
        return made

    def _newest_frames(self) -> NewestFrames:
        keyed = _HIGHRES, _FIELDS_UPDATED, HIGHRES_MAG | HIGHRES_BARO
        return NewestFrames(PARSER, self._sender, self._handlers, _SLOTS, keyed, self.waiting)

    def _decode(self, datagram: bytes, frame: Frame, now: float) -> None:
        """Decode a MAVLink frame, and store its values as the newest of their kind."""
        self._handlers[frame.msgid](self, decoder(frame.msgid)(datagram, frame), now)

    def recent_texts(self, since: float, worst: int = mavlink.MAV_SEVERITY_INFO) -> list[str]:
        """Return the STATUSTEXT messages since a time [s], each text once.

        worst: largest severity number that is returned (0 emergency .. 7 debug).
        """
        return list(
            dict.fromkeys(t.text for t in self.texts if t.received_at >= since and t.severity <= worst)
        )

    def _heartbeat(self, m: Any, now: float) -> None:
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.heartbeat = HeartbeatState(received_at=now, mode=mode_words(m.custom_mode), armed=armed)
        if not armed or self.heartbeat.mode != "OFFBOARD":
            self.outside_offboard_at = now

    def _sys_status(self, m: Any, now: float) -> None:
        battery = float(m.battery_remaining) if m.battery_remaining >= 0 else np.nan
        # PX4 sets this bit only in the health field, never in the sensors present.
        prearm = bool(m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        self.status = Status(received_at=now, prearm=prearm, battery=battery)

    def _extended(self, m: Any, now: float) -> None:
        self.ground = Ground(received_at=now, landed=m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND)

    def _local(self, m: Any, now: float) -> None:
        self.local = Local(
            received_at=now,
            boot_s=m.time_boot_ms * 1e-3,
            pos=np.array((m.x, m.y, m.z)),
            vel=np.array((m.vx, m.vy, m.vz)),
        )

    def _attitude(self, m: Any, now: float) -> None:
        self.attitude = Attitude(
            received_at=now,
            boot_s=m.time_boot_ms * 1e-3,
            q_nb=np.array((m.q1, m.q2, m.q3, m.q4)),
            ang_vel=np.array((m.rollspeed, m.pitchspeed, m.yawspeed)),
        )

    def _highres(self, m: Any, now: float) -> None:
        self.imu = Imu(
            received_at=now,
            boot_s=m.time_usec * 1e-6,
            acc_body=np.array((m.xacc, m.yacc, m.zacc)),
            ang_vel=np.array((m.xgyro, m.ygyro, m.zgyro)),
        )
        if m.fields_updated & HIGHRES_MAG:
            self.mag = Mag(received_at=now, mag=np.array((m.xmag, m.ymag, m.zmag)) * GAUSS_T)
        if m.fields_updated & HIGHRES_BARO:
            self.baro = Baro(
                received_at=now,
                pressure=pressure_pa(m.abs_pressure),
                temperature=m.temperature,
                alt=m.pressure_alt,
            )

    def _gps(self, m: Any, now: float) -> None:
        if m.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX:
            self.gps = Gps(received_at=now, pos=np.array((m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3)))

    def _servos(self, m: Any, now: float) -> None:
        raw = np.array([getattr(m, f"servo{i}_raw") for i in range(1, 9)], float)
        self.actuators = Actuators(
            received_at=now, group=m.port, output=np.clip((raw - 1000.0) / 1000.0, 0.0, 1.0)
        )

    def _controls(self, m: Any, now: float) -> None:
        self.actuators = Actuators(received_at=now, group=m.group_mlx, output=np.array(m.controls, float))

    def _reference(self, m: Any, now: float) -> None:
        ignored = [bool(m.type_mask & 1 << bit) for bit in range(12)]
        pos = np.where(ignored[0:3], np.nan, (m.x, m.y, m.z))
        vel = np.where(ignored[3:6], np.nan, (m.vx, m.vy, m.vz))
        yaw = np.nan if ignored[10] else m.yaw
        self.reference = Reference(received_at=now, boot_s=m.time_boot_ms * 1e-3, pos=pos, vel=vel, yaw=yaw)

    def _attitude_reference(self, m: Any, now: float) -> None:
        rates = np.array((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
        self.attitude_reference = AttitudeReference(
            received_at=now, boot_s=m.time_boot_ms * 1e-3, q_nb=np.array(m.q), ang_vel=rates, thrust=m.thrust
        )

    def _text(self, m: Any, now: float) -> None:
        text = m.text.split(b"\0", 1)[0].decode("ascii", errors="replace").rstrip("\t")
        if m.id and m.id == self._text_id and m.chunk_seq and self.texts:
            text = self.texts.pop().text + text
        self._text_id = m.id
        self.texts.append(Text(received_at=now, severity=m.severity, text=text))

    def _ack(self, m: Any, now: float) -> None:
        target = m.target_system, m.target_component
        self.acks.append(Ack(received_at=now, command=m.command, result=m.result, target=target))

    def _version(self, m: Any, now: float) -> None:
        number = m.flight_sw_version
        self.version = number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF


_HANDLERS: dict[int, _Handler] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Telemetry._heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Telemetry._sys_status,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: Telemetry._gps,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: Telemetry._attitude,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: Telemetry._local,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: Telemetry._servos,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: Telemetry._ack,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: Telemetry._attitude_reference,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: Telemetry._reference,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: Telemetry._highres,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET: Telemetry._controls,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: Telemetry._version,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Telemetry._extended,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: Telemetry._text,
}
