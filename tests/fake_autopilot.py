"""A PX4 autopilot for tests, without sockets, clocks and threads: datagrams in, datagrams out.

It encodes with pymavlink, unlike the code under test. `served.py` connects it to sockets and serial devices.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec

MODES = {
    "AUTO.LOITER": 4 << 16 | 3 << 24,
    "OFFBOARD": 6 << 16,
    "AUTO.LAND": 4 << 16 | 6 << 24,
    "POSCTL": 3 << 16,
}
GROUND, AIR = mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_IN_AIR
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
ARM, SET_MODE, LAND = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_NAV_LAND,
)
REQUEST, REBOOT = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
FORCE = 21196
SETPOINTS = ("SET_POSITION_TARGET_LOCAL_NED", "SET_ATTITUDE_TARGET", "SET_ACTUATOR_CONTROL_TARGET")
INT32, REAL32 = 6, 9


def wire_value(value: float, kind: int) -> float:
    """Return the float whose bytes are those of an INT32 value, and a REAL32 value unchanged."""
    return struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == INT32 else value


@dataclass(kw_only=True)
class ParamServer:
    """The parameters of an autopilot, served as PX4 does.

    params: name -> (value, type)
    clamp: name -> function that changes a written value
    hidden: name -> the (name, value) of another parameter with which it exists
    refused_writes: name -> error code of the PARAM_ERROR; None: no reply
    answers: False: requests are counted, but not answered
    errors: answer unknown names with PARAM_ERROR
    list_per_turn: values of a requested list that are sent every 0.05 s
    list_left: names of a requested list that are not sent yet
    written_names: every name that was written, in order
    """

    system: int = 1
    params: dict[str, tuple[float, int]] = field(default_factory=dict)
    clamp: dict[str, Callable[[float], float]] = field(default_factory=dict)
    hidden: dict[str, tuple[str, float]] = field(default_factory=dict)
    refused_writes: dict[str, int | None] = field(default_factory=dict)
    answers: bool = True
    errors: bool = False
    list_per_turn: int = 20
    list_left: list[str] = field(default_factory=list)
    written_names: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.encoder = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._next_turn = 0.0

    def pack(self, *messages: Any) -> bytes:
        """Return messages as one datagram of this vehicle."""
        data = b""
        for message in messages:
            data += message.pack(self.encoder)
            self.encoder.seq = (self.encoder.seq + 1) % 256
        return data

    @property
    def names(self) -> list[str]:
        return sorted(name for name in self.params if self._exists(name))

    def value(self, name: str) -> bytes:
        (value, kind), names = self.params[name], self.names
        raw = wire_value(value, kind)
        message = mavlink.MAVLink_param_value_message(name.encode(), raw, kind, len(names), names.index(name))
        return self.pack(message)

    def write(self, name: str, raw: float) -> None:
        kind = self.params[name][1]
        value = struct.unpack("<i", struct.pack("<f", raw))[0] if kind == INT32 else raw
        self.written_names.append(name)
        self.params[name] = (self.clamp[name](value) if name in self.clamp else value, kind)

    def _list_turn(self, now: float) -> list[bytes]:
        """Return the values of a requested list that are due."""
        if now < self._next_turn:
            return []
        self._next_turn = now + 0.05
        turn, self.list_left = self.list_left[: self.list_per_turn], self.list_left[self.list_per_turn :]
        return [self._hash() if name == "_HASH_CHECK" else self.value(name) for name in turn]

    def _answer_param(self, m: Any) -> list[bytes]:
        kind = m.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self.list_left = self.names if self.list_left else ["_HASH_CHECK", *self.names]
        elif kind == "PARAM_REQUEST_READ" and m.param_index >= 0:
            return [self.value(name) for name in self.names[m.param_index : m.param_index + 1]]
        elif not self._exists(m.param_id):
            return [self._error(m.param_id, 1)] if self.errors else []
        elif kind == "PARAM_REQUEST_READ":
            return [self.value(m.param_id)]
        elif m.param_id in self.refused_writes:
            error = self.refused_writes[m.param_id]
            return [] if error is None else [self._error(m.param_id, error)]
        elif m.param_type == self.params[m.param_id][1]:
            self.write(m.param_id, m.param_value)
            return [self.value(m.param_id)]
        return []

    def _hash(self) -> bytes:
        return self.pack(mavlink.MAVLink_param_value_message(b"_HASH_CHECK", 0.5, 5, len(self.names), 65535))

    def _error(self, name: str, error: int) -> bytes:
        """Return a PARAM_ERROR frame; not every version of the dialect has the message."""
        return Codec(self.system, 1).frame(345, struct.pack("<hBB16sB", -1, 252, 200, name.encode(), error))

    def _exists(self, name: str) -> bool:
        if name in self.hidden:
            by, value = self.hidden[name]
            return self.params[by][0] == value
        return name in self.params


@dataclass(kw_only=True)
class FakeAutopilot(ParamServer):
    """The autopilot of one vehicle. It obeys commands, sends telemetry and records what it receives.

    telemetry: names of the messages that it sends every period_s, in one datagram as PX4 does under load
    pos: local position (N, E, D) [m]
    uid, uid2: hardware uid in AUTOPILOT_VERSION
    land_s: time from entering AUTO.LAND to the ground [s]; infinite: it does not land
    disarm_s: time on the ground until it disarms [s]; infinite: it stays armed
    prearm: its pre-arm checks pass
    refuse: command -> (MAV_RESULT, STATUSTEXT)
    ignore: commands that it does not acknowledge
    ack_to: (system, component) that acknowledgements are addressed to, in place of the sender
    mute: it sends no telemetry
    alive: False: it sends and receives nothing
    received: every message
    setpoints: (time of arrival [s], message)
    setpoint_ticks: value of `ticks` at the arrival of each setpoint; a pause of the computer counts as one tick
    ticks: number of telemetry periods
    """

    armed: bool = False
    landed: bool = True
    mode: str = "AUTO.LOITER"
    pos: tuple[float, float, float] = (1.0, 2.0, -0.05)
    version: int = 0x011000FF
    uid: int = 0
    uid2: bytes = bytes(18)
    telemetry: Sequence[str] = ()
    period_s: float = 0.02
    land_s: float = math.inf
    disarm_s: float = 0.0
    prearm: bool = True
    refuse: dict[int, tuple[int, bytes]] = field(default_factory=dict)
    ignore: set[int] = field(default_factory=set)
    ack_to: tuple[int, int] | None = None
    mute: bool = False
    alive: bool = True
    received: list[Any] = field(default_factory=list)
    commands: list[Any] = field(default_factory=list)
    setpoints: list[tuple[float, Any]] = field(default_factory=list)
    setpoint_ticks: list[int] = field(default_factory=list)
    requests: int = 0
    ticks: int = 0
    next_telemetry_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._decoder = mavlink.MAVLink(None)
        self._decoder.robust_parsing = True
        self._texts: list[Any] = []
        self._began: float | None = None
        self._landing_since: float | None = None

    @property
    def orders(self) -> list[Any]:
        """Commands that change the vehicle: all but requests of a message."""
        return [c for c in list(self.commands) if c.command != REQUEST]

    @property
    def heartbeats(self) -> list[Any]:
        return [m for m in list(self.received) if m.get_type() == "HEARTBEAT"]

    @property
    def rebooted(self) -> int:
        """Number of reboot commands."""
        return sum(c.command == REBOOT for c in self.commands)

    def say(self, text: bytes) -> None:
        """Send a STATUSTEXT with the next step."""
        self._texts.append(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, text))

    def step(self, now: float) -> list[bytes]:
        """Advance to `now` [s] and return the datagrams that are due."""
        if not self.alive:
            return []
        self._descend(now)
        out = []
        while self._texts:
            out.append(self.pack(self._texts.pop(0)))
        if now >= self.next_telemetry_s:
            self.next_telemetry_s = now + self.period_s
            self.ticks += 1
            if self.telemetry and not self.mute:
                out.append(self.state(now))
        return out + self._list_turn(now)

    def state(self, now: float) -> bytes:
        """Return the telemetry as one datagram."""
        ms = int(self.boot_s(now) * 1e3)
        return self.pack(*(TELEMETRY[name](self, ms) for name in self.telemetry))

    def boot_s(self, now: float) -> float:
        """Return the time since the start of the autopilot [s]: since its first telemetry."""
        self._began = now if self._began is None else self._began
        return now - self._began

    def reboot(self) -> None:
        """Start the time since boot again at 0."""
        self._began = None

    def receive(self, data: bytes, now: float) -> list[bytes]:
        """Take in a datagram that arrives at `now` [s] and return the replies."""
        if not self.alive:
            return []
        out = []
        for m in self._decoder.parse_buffer(data) or []:
            self.received.append(m)
            if m.get_type() == "TIMESYNC" and m.tc1 == 0:
                out.append(self.pack(mavlink.MAVLink_timesync_message(int(self.boot_s(now) * 1e9), m.ts1)))
            if (getattr(m, "target_system", None), getattr(m, "target_component", 1)) == (self.system, 1):
                out += self._answer(m, now)
        return out

    def _answer(self, m: Any, now: float) -> list[bytes]:
        kind = m.get_type()
        self.requests += 1
        if kind in SETPOINTS:
            self.setpoints.append((now, m))
            self.setpoint_ticks.append(self.ticks)
        elif kind == "COMMAND_LONG":
            answers = [] if m.command in self.ignore else self._acknowledge(m)
            self.commands.append(m)  # after its effect, so that a test which waits for it sees the effect
            return answers
        elif kind.startswith("PARAM_") and self.answers:
            return self._answer_param(m)
        return []

    def _acknowledge(self, m: Any) -> list[bytes]:
        result, text = self.refuse.get(m.command, (ACCEPTED, b""))
        if result == ACCEPTED:
            result = self._obey(m)
        to = self.ack_to or (m.get_srcSystem(), m.get_srcComponent())
        out = [mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, *to)]
        if text:
            out.append(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, text))
        if m.command == REQUEST and m.param1 == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            nothing = [0] * 8
            out.append(
                mavlink.MAVLink_autopilot_version_message(
                    0, self.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, self.uid, self.uid2
                )
            )
        return [self.pack(message) for message in out]

    def _obey(self, m: Any) -> int:
        """Carry out a command and return its MAV_RESULT."""
        if m.command == ARM:
            if not (self.landed or m.param2 == FORCE):
                return DENIED
            self.armed = m.param1 == 1.0
        elif m.command == SET_MODE:
            number = int(m.param2) << 16 | int(m.param3) << 24
            mode = next((name for name, known in MODES.items() if known == number), None)
            if mode is None:
                return DENIED
            self.mode = mode
        elif m.command == LAND:
            self.mode = "AUTO.LAND"
        return ACCEPTED

    def _descend(self, now: float) -> None:
        if self.mode != "AUTO.LAND":
            self._landing_since = None
            return
        if self._landing_since is None:
            self._landing_since = now
        self.landed = self.landed or now - self._landing_since > self.land_s
        if now - self._landing_since > self.land_s + self.disarm_s:
            self.armed = False


def _heartbeat(a: FakeAutopilot, _: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * a.armed, MODES[a.mode], 4, 3)


def _sys_status(a: FakeAutopilot, _: int) -> Any:
    bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    healthy = bit if a.prearm else 0
    return mavlink.MAVLink_sys_status_message(bit, bit, healthy, 0, 12000, 0, 87, 0, 0, 0, 0, 0, 0)


def _imu(_: FakeAutopilot, ms: int) -> Any:
    acc, gyro, mag = (0.1, 0.2, -9.8), (0.01, 0.02, 0.03), (0.2, 0.1, 0.4)
    return mavlink.MAVLink_highres_imu_message(ms * 1000, *acc, *gyro, *mag, 1013.25, 0.0, 12.5, 21.0, 0x1FFF)


TELEMETRY: dict[str, Callable[[FakeAutopilot, int], Any]] = {
    "HEARTBEAT": _heartbeat,
    "SYS_STATUS": _sys_status,
    "EXTENDED_SYS_STATE": lambda a, _: mavlink.MAVLink_extended_sys_state_message(
        0, GROUND if a.landed else AIR
    ),
    "ATTITUDE_QUATERNION": lambda _, ms: mavlink.MAVLink_attitude_quaternion_message(
        ms, 0.9659258, 0.0, 0.0, 0.2588190, 0.1, 0.2, 0.3
    ),
    "SYSTEM_TIME": lambda _, ms: mavlink.MAVLink_system_time_message(0, ms),
    "ATTITUDE": lambda _, ms: mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 0.52, 0.1, 0.2, 0.3),
    "HIGHRES_IMU": _imu,
    "RC_CHANNELS": lambda _, ms: mavlink.MAVLink_rc_channels_message(ms, 16, *[1500] * 18, 80),
    "SERVO_OUTPUT_RAW": lambda *_: mavlink.MAVLink_servo_output_raw_message(
        0, 0, 1500, 1600, 1700, 1800, 0, 0, 0, 0
    ),
    "LOCAL_POSITION_NED": lambda a, ms: mavlink.MAVLink_local_position_ned_message(ms, *a.pos, 0.5, 0.0, 0.0),
}
