"""A link whose vehicle stands, or is carried by hand: telemetry, inertial sensors, captured poses of all bodies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from carried import STANDING, Captured, Motion
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.arm_permit import ArmPermit
from arena.fcu_link.axes_record import AxesRecord
from arena.fcu_link.core import FcuLink
from arena.geometry import euler_from_quat
from arena.mocap.client import CapturedFrame, Echo, Pose
from arena.wire.mavlink_frame import parse_frames

from .link_rig import ID, Rig, heartbeat, sys_status

BOOT_S = 60.0
COMPUTER, DATE = "start 1", "2026-11-22T10:00:00Z"
COMMAND = {"vehicle": "uav7", "by": "eva"}
LATENCY_S = 0.008


class CarriedRig(Rig):
    """A link with its vehicle `motion`, captured as `body`, and the other bodies of the room.

    late_s: time from a motion to the arrival of its pose at the link
    boot_s: time of the autopilot's start
    round_trip_s: of TIMESYNC
    """

    def __init__(
        self,
        motion: Motion,
        body: Captured | None = None,
        others: dict[str, Captured] | None = None,
        record: AxesRecord | None = None,
        definition: str = "markers 1",
        late_s: float = 0.03,
        **preflight: Any,
    ) -> None:
        limits = {"imu": True, "axes_check": True, "size_m": [20, 20, 4], "pose_rate_hz": 50.0, **preflight}
        super().__init__(preflight=limits)
        if record is not None:
            self.core = FcuLink(self.settings, self.now, axes_record=record)
            self.identify()
            self.core.permit = ArmPermit("uav7", needed=False)
        self.motion, self.body = motion, body or Captured(moves=motion)
        self.others = others or {}
        self.late_s, self.boot_s, self.round_trip_s = late_s, self.now - BOOT_S, 0.01
        self.definition, self.armed, self.imu_hz = definition, False, 50.0
        self.rates: list[tuple[int, float]] = []
        self.params = {"EKF2_EV_DELAY": 0.0}
        self._replies: list[tuple[float, bytes]] = []
        self._frames = self._cycles = 0
        self._rng = np.random.default_rng(3)
        self.core.axes.set_time(COMPUTER, 0.0, DATE)

    def carry(self, seconds: float) -> None:
        """Advance time by steps of 20 ms."""
        for _ in range(round(seconds * 50)):
            self._cycle()

    def until_checked(self, limit_s: float = 90.0) -> dict[str, Any]:
        """Advance time until the check has ended, and return its status."""
        while self.core.axes.running and limit_s > 0.0:
            self._cycle()
            limit_s -= 0.02
        return self.core.axes.status

    def start(self) -> None:
        self.core.on_request({"do": "axes_check", **COMMAND}, self.now)

    def _cycle(self) -> None:
        self.now += 0.02
        self._cycles += 1
        self._answer()
        self._telemetry()
        for message in self._poses():
            self.send("vision", message, codec=self.forwarder)
        self.core.axes.on_frames([self._frame()], self.now)
        self.core.tick(self.now)
        self.flush()

    def _telemetry(self) -> None:
        roll, pitch, yaw = euler_from_quat(self.body.q_nb(self.now))
        boot_ms = int(1e3 * (self.now - self.boot_s))
        force, rate = self.motion.imu(self.now)
        messages = [
            mavlink.MAVLink_local_position_ned_message(boot_ms, *self.body.p_n(self.now), 0, 0, 0),
            mavlink.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, 0, 0, 0),
            mavlink.MAVLink_highres_imu_message(
                boot_ms * 1000, *(force + self._rng.normal(0, 0.05, 3)), *(rate + self._rng.normal(0, 0.01, 3)),
                0, 0, 0, 1013.0, 0, 0, 20.0, 63),
        ]  # fmt: skip
        if self._cycles % 25 == 1:
            messages += [heartbeat(self.armed), sys_status(), mavlink.MAVLink_system_time_message(0, boot_ms)]
            self.core.on_request({"do": "body", "vehicle": "uav7", "definition": self.definition}, self.now)
        self.receive(*messages)

    def _poses(self):
        at = self.now - self.late_s
        if not self.body.seen(self.now):
            return
        q = [float(x) for x in self.body.q_nb(at)]
        nan = math.nan
        p_n = [float(x) for x in self.body.p_n(at)]
        yield mavlink.MAVLink_odometry_message(
            0, 1, 12, *p_n, q, *[nan] * 6, [nan] * 21, [nan] * 21, 0, 2, 100
        )

    def _frame(self) -> CapturedFrame:
        self._frames += 1
        at = self.now - self.late_s
        poses = tuple(
            Pose(name, tuple(map(float, b.p_n(at))), tuple(map(float, b.q_nb(at))))
            for name, b in {"uav7": self.body, **self.others}.items()
        )
        exposed = self.now - LATENCY_S + 1000.0  # the server's clock
        echo = Echo(self.now - 0.001, self.now, self.now - 0.0005 + 1000.0)
        return CapturedFrame(self._frames, exposed, poses, (), exposed + 0.002, echo)

    def _answer(self) -> None:
        """Answer TIMESYNC, requests for a parameter and for a rate, as PX4 does."""
        for m in self.out:
            kind = m.get_type()
            if kind == "TIMESYNC" and m.tc1 == 0:
                at = self.now - 0.02 + self.round_trip_s / 2.0
                reply = mavlink.MAVLink_timesync_message(int(1e9 * (at - self.boot_s)), m.ts1)
                data = self.vehicle.pack(reply)
                self._replies.append((self.now - 0.02 + self.round_trip_s, data))
            elif kind == "PARAM_REQUEST_READ" and m.param_id in self.params:
                self.receive(
                    mavlink.MAVLink_param_value_message(m.param_id.encode(), self.params[m.param_id], 9, 1, 0)
                )
            elif kind == "COMMAND_LONG" and m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.rates.append((int(m.param1), 1e6 / m.param2))
                self.receive(
                    mavlink.MAVLink_command_ack_message(m.command, 0, 0, 0, ID, m.get_srcComponent())
                )
        self.out.clear()
        for at, data in self._replies:
            self._share(self.core.from_vehicle(data, parse_frames(data), at))
        self._replies.clear()


__all__ = ["STANDING", "Captured", "CarriedRig", "Motion"]
