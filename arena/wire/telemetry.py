"""Telemetry of a PX4-style autopilot: decodes datagrams and keeps the newest values, such as the attitude. No sockets,
no clocks.

Only the messages in `_HANDLERS` are decoded. Of all other messages, more than half of an onboard stream, only
the checksum is checked. Units are SI and radians, frames NED and FRD, quaternions wxyz. Each value contains
the time at which it was received.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import AUTOPILOT, parse_frames
from arena.wire.px4_mode import mode_words

Array = NDArray[np.float64]

_GAUSS_T = 1e-4
_HPA_PA = 100.0
_HIGHRES_MAG = 0x01C0
_HIGHRES_BARO = 0x1A00


@dataclass(frozen=True, kw_only=True, slots=True)
class Local:
    """Estimated position and velocity, from LOCAL_POSITION_NED.

    received_at: time of arrival [s]. boot_s: the autopilot's time [s]. pos: [m] [NED] (3,). vel: [m/s] [NED]
    (3,).
    """

    received_at: float
    boot_s: float
    pos: Array
    vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Attitude:
    """Estimated attitude, from ATTITUDE_QUATERNION.

    q_nb: [-] wxyz (4,). ang_vel: body rates [rad/s] [FRD] (3,).
    """

    received_at: float
    boot_s: float
    q_nb: Array
    ang_vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Imu:
    """Inertial measurement, from HIGHRES_IMU.

    boot_s: the autopilot's time [s]. acc_body: specific force [m/s2] [FRD] (3,). ang_vel: [rad/s] [FRD] (3,).
    """

    received_at: float
    boot_s: float
    acc_body: Array
    ang_vel: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Mag:
    """Measured magnetic field, from HIGHRES_IMU. mag: [T] [FRD] (3,)."""

    received_at: float
    mag: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Baro:
    """Barometer, from HIGHRES_IMU. pressure: [Pa]. temperature: [deg C]. alt: pressure altitude [m]."""

    received_at: float
    pressure: float
    temperature: float
    alt: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Gps:
    """Satellite position, from GPS_RAW_INT.

    pos: latitude [deg], longitude [deg], altitude above mean sea level [m] (3,).
    """

    received_at: float
    pos: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Actuators:
    """Actuator outputs, from SERVO_OUTPUT_RAW or ACTUATOR_CONTROL_TARGET.

    group: output port or mixer group. output: 0..1 [-] (8,); unused outputs are zero.
    """

    received_at: float
    group: int
    output: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class HeartbeatState:
    """Mode and arming state, from HEARTBEAT. mode: name of the flight mode, as returned by `mode_words`."""

    received_at: float
    mode: str
    armed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Status:
    """State of the autopilot, from SYS_STATUS.

    prearm: the vehicle can be armed in its current mode. battery: remaining charge [%], or nan.
    """

    received_at: float
    prearm: bool
    battery: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Ground:
    """Landed state, from EXTENDED_SYS_STATE. landed: on the ground, according to the land detector."""

    received_at: float
    landed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Reference:
    """Position reference that the autopilot follows, from POSITION_TARGET_LOCAL_NED.

    pos: [m] [NED] (3,). vel: [m/s] [NED] (3,). yaw: [rad]. Values that are not controlled are nan.
    """

    received_at: float
    boot_s: float
    pos: Array
    vel: Array
    yaw: float


@dataclass(frozen=True, kw_only=True, slots=True)
class AttitudeReference:
    """Attitude reference that the autopilot follows, from ATTITUDE_TARGET.

    q_nb: [-] wxyz (4,). ang_vel: [rad/s] [FRD] (3,). thrust: normalised 0..1 [-].
    """

    received_at: float
    boot_s: float
    q_nb: Array
    ang_vel: Array
    thrust: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Text:
    """Message text of the autopilot, from STATUSTEXT. severity: 0 emergency .. 7 debug."""

    received_at: float
    severity: int
    text: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Ack:
    """Reply to a command, from COMMAND_ACK. target: (system, component) that sent the command."""

    received_at: float
    command: int
    result: int
    target: tuple[int, int]


class Telemetry:
    """Decoder that keeps the newest value of each group, such as `local` or `attitude`; None before the first message.

    A new message replaces the whole value of its group.
    system_id, component_id: ids of the autopilot; messages of other senders are ignored
    only: message ids to decode; None decodes all messages that belong to a group
    refused: number of frames with a wrong checksum or layout
    """

    def __init__(
        self, system_id: int, only: Collection[int] | None = None, component_id: int = AUTOPILOT
    ) -> None:
        self._system, self._component = system_id, component_id
        self._handlers = {
            number: handler for number, handler in _HANDLERS.items() if only is None or number in only
        }
        self._codec = mavlink.MAVLink(None)
        self.received_at: float | None = None
        self.local: Local | None = None
        self.attitude: Attitude | None = None
        self.imu: Imu | None = None
        self.mag: Mag | None = None
        self.baro: Baro | None = None
        self.gps: Gps | None = None
        self.actuators: Actuators | None = None
        self.heartbeat: HeartbeatState | None = None
        self.status: Status | None = None
        self.ground: Ground | None = None
        self.reference: Reference | None = None
        self.attitude_reference: AttitudeReference | None = None
        self.version: tuple[int, int, int] | None = None
        self.texts: deque[Text] = deque(maxlen=32)
        self.acks: deque[Ack] = deque(maxlen=32)
        self.refused = 0
        self._text_id = 0

    def on_datagram(self, datagram: bytes, now: float) -> bool:
        """Decode a datagram. Return whether it contains a message of the autopilot.

        now: time of arrival [s], by any clock.
        """
        received = False
        found = parse_frames(datagram)
        self.refused += found.bad_crc
        for frame in found.frames:
            handler = self._handlers.get(frame.msgid)
            if handler is None or frame.sysid != self._system or frame.compid != self._component:
                continue
            try:
                handler(self, self._codec.decode(bytearray(datagram[frame.start : frame.end])), now)
                received = True
            except (mavlink.MAVError, ValueError, TypeError, struct.error):
                self.refused += 1  # a correct checksum, but another layout
        if received:
            self.received_at = now
        return received

    def recent_texts(self, since: float, worst: int = mavlink.MAV_SEVERITY_INFO) -> list[str]:
        """Return the STATUSTEXTs received since a time [s], each text once.

        worst: largest severity number that is returned (0 emergency .. 7 debug).
        """
        return list(
            dict.fromkeys(t.text for t in self.texts if t.received_at >= since and t.severity <= worst)
        )

    def _heartbeat(self, m: mavlink.MAVLink_heartbeat_message, now: float) -> None:
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.heartbeat = HeartbeatState(received_at=now, mode=mode_words(m.custom_mode), armed=armed)

    def _sys_status(self, m: mavlink.MAVLink_sys_status_message, now: float) -> None:
        battery = float(m.battery_remaining) if m.battery_remaining >= 0 else np.nan
        # PX4 sets this bit only in the health field, never in the sensors present.
        prearm = bool(m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        self.status = Status(received_at=now, prearm=prearm, battery=battery)

    def _extended(self, m: mavlink.MAVLink_extended_sys_state_message, now: float) -> None:
        self.ground = Ground(received_at=now, landed=m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND)

    def _local(self, m: mavlink.MAVLink_local_position_ned_message, now: float) -> None:
        self.local = Local(
            received_at=now,
            boot_s=m.time_boot_ms * 1e-3,
            pos=np.array((m.x, m.y, m.z)),
            vel=np.array((m.vx, m.vy, m.vz)),
        )

    def _attitude(self, m: mavlink.MAVLink_attitude_quaternion_message, now: float) -> None:
        self.attitude = Attitude(
            received_at=now,
            boot_s=m.time_boot_ms * 1e-3,
            q_nb=np.array((m.q1, m.q2, m.q3, m.q4)),
            ang_vel=np.array((m.rollspeed, m.pitchspeed, m.yawspeed)),
        )

    def _highres(self, m: mavlink.MAVLink_highres_imu_message, now: float) -> None:
        self.imu = Imu(
            received_at=now,
            boot_s=m.time_usec * 1e-6,
            acc_body=np.array((m.xacc, m.yacc, m.zacc)),
            ang_vel=np.array((m.xgyro, m.ygyro, m.zgyro)),
        )
        if m.fields_updated & _HIGHRES_MAG or self.mag is None:
            self.mag = Mag(received_at=now, mag=np.array((m.xmag, m.ymag, m.zmag)) * _GAUSS_T)
        if m.fields_updated & _HIGHRES_BARO or self.baro is None:
            self.baro = Baro(
                received_at=now,
                pressure=m.abs_pressure * _HPA_PA,
                temperature=m.temperature,
                alt=m.pressure_alt,
            )

    def _gps(self, m: mavlink.MAVLink_gps_raw_int_message, now: float) -> None:
        if m.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX:
            self.gps = Gps(received_at=now, pos=np.array((m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3)))

    def _servos(self, m: mavlink.MAVLink_servo_output_raw_message, now: float) -> None:
        raw = np.array([getattr(m, f"servo{i}_raw") for i in range(1, 9)], float)
        self.actuators = Actuators(
            received_at=now, group=m.port, output=np.clip((raw - 1000.0) / 1000.0, 0.0, 1.0)
        )

    def _controls(self, m: mavlink.MAVLink_actuator_control_target_message, now: float) -> None:
        self.actuators = Actuators(received_at=now, group=m.group_mlx, output=np.array(m.controls, float))

    def _reference(self, m: mavlink.MAVLink_position_target_local_ned_message, now: float) -> None:
        ignored = [bool(m.type_mask & 1 << bit) for bit in range(12)]
        pos = np.where(ignored[0:3], np.nan, (m.x, m.y, m.z))
        vel = np.where(ignored[3:6], np.nan, (m.vx, m.vy, m.vz))
        yaw = np.nan if ignored[10] else m.yaw
        self.reference = Reference(received_at=now, boot_s=m.time_boot_ms * 1e-3, pos=pos, vel=vel, yaw=yaw)

    def _attitude_reference(self, m: mavlink.MAVLink_attitude_target_message, now: float) -> None:
        rates = np.array((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate))
        self.attitude_reference = AttitudeReference(
            received_at=now, boot_s=m.time_boot_ms * 1e-3, q_nb=np.array(m.q), ang_vel=rates, thrust=m.thrust
        )

    def _text(self, m: mavlink.MAVLink_statustext_message, now: float) -> None:
        text = m.text if isinstance(m.text, str) else m.text.decode(errors="replace")
        if m.id and m.id == self._text_id and m.chunk_seq and self.texts:
            text = self.texts.pop().text + text
        self._text_id = m.id
        self.texts.append(Text(received_at=now, severity=m.severity, text=text.rstrip("\0")))

    def _ack(self, m: mavlink.MAVLink_command_ack_message, now: float) -> None:
        target = m.target_system, m.target_component
        self.acks.append(Ack(received_at=now, command=m.command, result=m.result, target=target))

    def _version(self, m: mavlink.MAVLink_autopilot_version_message, now: float) -> None:
        number = m.flight_sw_version
        self.version = number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF


_HANDLERS: dict[int, Callable[[Telemetry, mavlink.MAVLink_message, float], None]] = {
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
