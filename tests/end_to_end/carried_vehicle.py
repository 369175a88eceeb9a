"""A real vehicle that somebody carries, and the cameras that see it, for tests of a whole arena."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

from carried import Captured, Motion
from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import euler_from_quat, q_wf_from_q_nb, world_from_ned, xyzw_from_wxyz
from arena.mocap.emulator.interface import MeasuredBody, MeasuredFrame
from arena.mocap.natnet.server import open_server

FRAME_HZ = 60.0
TELEMETRY = ("HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME", "EXTENDED_SYS_STATE")


@dataclass(kw_only=True)
class CarriedAutopilot(FakeAutopilot):
    """An autopilot whose inertial sensors and estimate follow a motion.

    moves: the motion; its times are by time.monotonic
    """

    moves: Motion

    def state(self, now: float) -> bytes:
        ms, (force, rate) = int(self.boot_s(now) * 1e3), self.moves.imu(now)
        roll, pitch, yaw = euler_from_quat(self.moves.q_nb(now))
        imu = mavlink.MAVLink_highres_imu_message(ms * 1000, *force, *rate, 0, 0, 0, 1013.0, 0, 0, 20.0, 63)
        return super().state(now) + self.pack(
            imu,
            mavlink.MAVLink_attitude_message(ms, roll, pitch, yaw, *rate),
            mavlink.MAVLink_local_position_ned_message(ms, *self.moves.p_n(now), 0, 0, 0),
        )


@dataclass(kw_only=True)
class Cameras:
    """A NatNet server that sends the bodies of a room until closed. bodies: by name, in the order of their ids."""

    address: str
    bodies: dict[str, Captured]
    _over: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Self:
        names = [{"number": i + 1, "name": name} for i, name in enumerate(self.bodies)]
        settings: dict[str, Any] = {
            "address": self.address,
            "command_port": 1510,
            "data_port": 1511,
            "group": "239.255.42.99",
            "transport": "unicast",
            "version": "4.1",
            "bodies": names,
        }
        self._server = open_server(settings)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join(10)
        self._server.close()

    def _run(self) -> None:
        number = 0
        while not self._over.wait(1.0 / FRAME_HZ):
            number, now = number + 1, time.monotonic()
            self._server.send(
                MeasuredFrame(number=number, exposed_s=now, bodies=self._measured(now)), now, now
            )
            self._server.answer(now)

    def _measured(self, now: float) -> tuple[MeasuredBody, ...]:
        found = []
        for i, body in enumerate(self.bodies.values()):
            x, y, z = map(float, world_from_ned(body.p_n(now)))
            qx, qy, qz, qw = map(float, xyzw_from_wxyz(q_wf_from_q_nb(body.q_nb(now))))
            found.append(
                MeasuredBody(
                    number=i + 1,
                    position_w=(x, y, z),
                    quat_xyzw_wf=(qx, qy, qz, qw),
                    mean_error_m=0.0005,
                    tracked=True,
                )
            )
        return tuple(found)
