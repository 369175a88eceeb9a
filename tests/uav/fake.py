"""An autopilot for tests: it answers, it tells what it is told to tell, and it notes when each setpoint came."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as mavlink

MODES = {
    "AUTO.LOITER": 4 << 16 | 3 << 24,
    "OFFBOARD": 6 << 16,
    "AUTO.LAND": 4 << 16 | 6 << 24,
    "POSCTL": 3 << 16,
}
SETPOINTS = (
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
)
_hosts = itertools.count(1)


def free_address() -> tuple[str, int]:
    """A UDP address of this room's own."""
    host = f"127.56.1.{next(_hosts) % 250 + 1}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((host, 0))
        return host, probe.getsockname()[1]


def until(done: Callable[[], object], deadline_s: float = 30.0) -> None:
    """Wait for an event with a deadline."""
    end = time.monotonic() + deadline_s
    tick = threading.Event()
    while not done():
        assert time.monotonic() < end, "it did not happen in time"
        tick.wait(0.002)


@dataclass
class FakeAutopilot:
    """Speaks to `to` from a thread at 50 Hz until closed. refuse: command -> (MAV_RESULT, STATUSTEXT)."""

    to: tuple[str, int]
    system: int = 1
    mode: str = "AUTO.LOITER"
    armed: bool = False
    landed: bool = True
    prearm: bool = True
    position: bool = True
    mute: bool = False
    ack_to: tuple[int, int] | None = None
    version: int = 0x011000FF
    pos: tuple[float, float, float] = (1.0, 2.0, -0.05)
    refuse: dict[int, tuple[int, bytes]] = field(default_factory=dict)
    ignore: set[int] = field(default_factory=set)
    setpoints: list[tuple[float, mavlink.MAVLink_message]] = field(default_factory=list)
    commands: list[mavlink.MAVLink_message] = field(default_factory=list)
    heartbeats: list[mavlink.MAVLink_message] = field(default_factory=list)
    ticks: int = 0

    def __post_init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.56.2.1", 0))
        self._socket.settimeout(0.005)
        self._out = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._in = mavlink.MAVLink(None)
        self._in.robust_parsing = True
        self._ending = threading.Event()
        self._began = time.monotonic()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def __enter__(self) -> FakeAutopilot:
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._socket.close()

    @property
    def orders(self) -> list[mavlink.MAVLink_message]:
        """Commands that would change something: all but the requests of a message."""
        return [c for c in list(self.commands) if c.command != mavlink.MAV_CMD_REQUEST_MESSAGE]

    def tell(self, *messages: mavlink.MAVLink_message) -> None:
        """In one datagram, as PX4 does under load."""
        data = b""
        for message in messages:
            data += message.pack(self._out)
            self._out.seq = (self._out.seq + 1) % 256
        self._socket.sendto(data, self.to)

    def say(self, text: bytes, severity: int = mavlink.MAV_SEVERITY_CRITICAL) -> None:
        self.tell(mavlink.MAVLink_statustext_message(severity, text))

    def let_pass(self, ticks: int) -> None:
        """Wait until so many of its 50 Hz rounds are over: what was on its way has come."""
        end = self.ticks + ticks
        until(lambda: self.ticks >= end)

    def _run(self) -> None:
        due = 0.0
        while not self._ending.is_set():
            if time.monotonic() >= due:
                due = time.monotonic() + 0.02
                self.ticks += 1
                if not self.mute:
                    self.tell(*self._stream())
            try:
                data = self._socket.recv(65535)
            except (TimeoutError, ConnectionError):
                continue
            for message in self._in.parse_buffer(data) or []:
                self._hear(message)

    def _stream(self) -> list[mavlink.MAVLink_message]:
        ms = int((time.monotonic() - self._began) * 1e3)
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        base = 1 | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0)
        told = [
            mavlink.MAVLink_heartbeat_message(2, 12, base, MODES[self.mode], 4, 3),
            mavlink.MAVLink_sys_status_message(
                bit, bit, bit if self.prearm else 0, 0, 12000, 0, 87, 0, 0, 0, 0, 0, 0
            ),
            mavlink.MAVLink_extended_sys_state_message(0, 1 if self.landed else 2),
            mavlink.MAVLink_attitude_quaternion_message(ms, 0.9659258, 0.0, 0.0, 0.2588190, 0.1, 0.2, 0.3),
            mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, 0.52, 0.1, 0.2, 0.3),
            mavlink.MAVLink_highres_imu_message(
                ms * 1000, 0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 0.2, 0.1, 0.4, 1013.25, 0.0, 12.5, 21.0, 0x1FFF
            ),
            mavlink.MAVLink_servo_output_raw_message(0, 0, 1500, 1600, 1700, 1800, 0, 0, 0, 0),
        ]
        if self.position:
            told.append(mavlink.MAVLink_local_position_ned_message(ms, *self.pos, 0.5, 0.0, 0.0))
        return told

    def _hear(self, message: mavlink.MAVLink_message) -> None:
        if message.get_msgId() in SETPOINTS:
            self.setpoints.append((time.monotonic(), message))
        elif message.get_type() == "HEARTBEAT":
            self.heartbeats.append(message)
        elif message.get_type() == "COMMAND_LONG":
            self.commands.append(message)
            if message.command not in self.ignore:
                self._obey(message)

    def _obey(self, m: mavlink.MAVLink_message) -> None:
        result, text = self.refuse.get(m.command, (0, b""))
        if result == 0 and m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = m.param1 == 1.0
        if result == 0 and m.command == mavlink.MAV_CMD_DO_SET_MODE:
            self.mode = {v: k for k, v in MODES.items()}[int(m.param2) << 16 | int(m.param3) << 24]
        if result == 0 and m.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            self.tell(
                mavlink.MAVLink_autopilot_version_message(
                    0, self.version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
                )
            )
        to = self.ack_to or (m.get_srcSystem(), m.get_srcComponent())
        self.tell(mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, *to))
        if text:
            self.say(text)
