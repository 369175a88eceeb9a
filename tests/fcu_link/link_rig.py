"""A slice, a vehicle's messages and a link in one process, for the tests of this folder."""

from __future__ import annotations

import itertools
import math
import os
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.arm_permit import ArmPermit
from arena.fcu_link.core import FcuLink
from arena.fcu_link.settings import Settings
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

ID = 7
ENDS = ("router", "vision", "panic")
_count = itertools.count(1)
YAW = math.radians(35.0)
UID = bytes(range(1, 19))
SOURCE = "the vehicle"
POSE = (0.4, -1.2, -0.13)


def own_address() -> str:
    """Return an address 127.71.x.y that no other test of this process uses."""
    return f"127.71.{os.getpid() % 250 + 1}.{next(_count)}"


def slice_of(address: str = "127.71.0.1", **changes: Any) -> dict[str, Any]:
    preflight = {
        "position_m": 0.2,
        "yaw_deg": 15.0,
        "tilt_deg": 10.0,
        "imu": False,
        "pose_age_s": 0.1,
        "pose_rate_hz": 50.0,
        "battery": 0.2,
        "size_m": [7, 4, 3],
        "height_m": 0.1,
        "poses": True,
        "radio": None,
        "axes_check": False,
        **changes.pop("preflight", {}),
    }
    links = {
        n: {"local": [address, 24000 + 2 * i], "remote": [address, 24001 + 2 * i]} for i, n in enumerate(ENDS)
    }
    return {
        "name": "link.uav7",
        "vehicle": "uav7",
        "id": ID,
        "uid": "",
        "wire": {"kind": "udpin", "address": [address, 14540]},
        "links": links,
        "simulator": None,
        "preflight": preflight,
        "params": {},
        "missing_reboots": {"folder": "/nowhere", "address": "id 7"},
        "params_file": "",
        "simulated": False,
        "body": "uav7",
        "capture": None,
        **changes,
    }


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """Return the wxyz quaternion of roll, pitch and yaw [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def odometry(p_n: tuple[float, ...] = POSE, yaw: float = YAW) -> Any:
    nan = math.nan
    q = quaternion(math.radians(10), math.radians(-20), yaw)
    return mavlink.MAVLink_odometry_message(0, 1, 12, *p_n, q, *[nan] * 6, [nan] * 21, [nan] * 21, 0, 2, 100)


def heartbeat(armed: bool = False, kill: bool = False, mode: int = 0) -> Any:
    """Return a heartbeat. kill: the kill switch is on. mode: custom_mode."""
    status = mavlink.MAV_STATE_FLIGHT_TERMINATION if kill else mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(2, 12, 1 | (128 if armed else 0), mode, status, 3)


def sys_status(battery: int = 80, rc: bool = False, rc_healthy: bool = True) -> Any:
    """Return a SYS_STATUS. rc: manual control is received."""
    bit = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    present, health = bit if rc else 0, bit if rc_healthy else 0
    return mavlink.MAVLink_sys_status_message(
        present, present, health, 0, 16000, 0, battery, 0, 0, 0, 0, 0, 0
    )


def rc_channels(count: int = 16) -> Any:
    return mavlink.MAVLink_rc_channels_message(0, count, *[1500] * 18, 80)


def attitude(yaw: float = YAW) -> Any:
    return mavlink.MAVLink_attitude_message(0, math.radians(10), math.radians(-20), yaw, 0, 0, 0)


def local(p_n: tuple[float, ...] = POSE) -> Any:
    return mavlink.MAVLink_local_position_ned_message(0, *p_n, 0, 0, 0)


def version(uid2: bytes = UID, uid: int = 0) -> Any:
    """Return the message with the hardware uid of an autopilot."""
    nothing = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        0, 0, 0, 0, 0, nothing, nothing, nothing, 0, 0, uid, list(uid2)
    )


def arm(param1: float = 1.0, magic: float = 0.0, target: int = ID, component: int = 1) -> Any:
    return mavlink.MAVLink_command_long_message(target, component, 400, 0, param1, magic, 0, 0, 0, 0, 0)


class Rig:
    """A link, its vehicle and its three UDP links, on a clock that the test advances.

    The vehicle has sent its hardware uid; it sends it again after each silence.
    permit: the vehicle needs no arm permit
    """

    def __init__(self, *, permit: bool = True, **changes: Any) -> None:
        self.now = 100.0
        self.settings = Settings.from_slice(slice_of(**changes))
        self.core = FcuLink(self.settings, self.now)
        self.vehicle, self.forwarder = Codec(ID, 1), Codec(ID, 197)
        self.program = Codec(ID, 191)
        self.got: dict[str, list[Any]] = {n: [] for n in (*ENDS, "simulator")}
        self.out: list[Any] = []
        self._reader = Codec(1, 1)
        self.identify()
        if permit:
            self.core.permit = ArmPermit("uav7", needed=False)

    def identify(self, uid2: bytes = UID, source: Any = SOURCE) -> None:
        """Pass the hardware uid of an autopilot to the link, without an effect on anything else."""
        data = Codec(ID, 1).pack(version(uid2))
        self.core.identity.accepts(source, data, parse_frames(data).frames, self.now)
        self.core.identity.events.clear()

    def receive(self, *messages: Any, codec: Codec | None = None) -> None:
        """Pass messages of the vehicle to the link."""
        if codec is None:
            self.identify()
        data = b"".join((codec or self.vehicle).pack(m) for m in messages)
        self._share(self.core.from_vehicle(data, parse_frames(data), self.now))

    def send(self, link: str, *messages: Any, codec: Codec | None = None) -> None:
        """Pass messages of a UDP link to the core, and send what is queued."""
        data = b"".join((codec or self.program).pack(m) for m in messages)
        self._share(self.core.from_link(link, data, self.now))
        self.flush()

    def flush(self) -> list[Any]:
        """Return what is sent to the vehicle now."""
        found = []
        while (frame := self.core.next_out(self.now)) is not None:
            found += self._reader.parse(frame)
        self.out += found
        return found

    def fly(self, seconds: float, *, poses: bool = True, telemetry: bool = True, **state: Any) -> None:
        """Advance time with nominal messages, except for `state`: battery, armed, p_n, yaw, pose_n, pose_yaw, rc, kill."""
        p_n, yaw = state.get("p_n", POSE), state.get("yaw", YAW)
        for i in range(round(seconds * 50)):
            self.now += 0.02
            if telemetry:
                self.receive(local(p_n), attitude(yaw))
            if telemetry and i % 25 == 0:
                rc = state.get("rc", False)
                self.receive(
                    heartbeat(state.get("armed", False), state.get("kill", False)),
                    sys_status(state.get("battery", 80), rc),
                    *([rc_channels()] if rc else []),
                )
            if poses:
                self.send(
                    "vision",
                    odometry(state.get("pose_n", POSE), state.get("pose_yaw", YAW)),
                    codec=self.forwarder,
                )
            self.core.tick(self.now)
            self.flush()

    def sent(self, kind: str) -> list[Any]:
        return [m for m in self.out if m.get_type() == kind]

    def arming_passed(self, command: int = 400) -> bool:
        return any(m.command == command for m in self.sent("COMMAND_LONG") + self.sent("COMMAND_INT"))

    def received(self, end: str, kind: str) -> list[Any]:
        return [m for m in self.got[end] if m.get_type() == kind]

    def reasons(self) -> list[str]:
        return self.core.reasons(self.now)

    def _share(self, out: list[tuple[str, bytes]]) -> None:
        for end, data in out:
            self.got[end] += self._reader.parse(data)
