"""Class `UAV` with coroutines for programs of the ISR Flying Arena thesis that use MAVSDK.

It flies over `arena.UAV` as well. Its MAVLink library is that of the YAML (`backend`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numpy.typing import ArrayLike

from arena.compat import uav_mavros
from arena.uav.setpoints import AttitudeKind


class UAV:
    """Vehicle with the coroutines that programs of the ISR Flying Arena thesis (MAVSDK) use to fly it.

    drone_ns: name of the vehicle. In the thesis this argument is the UDP port. Both come from `sys.argv[1]`, which is the name here.
    The other arguments, the data groups and the exceptions are those of `arena.compat.uav_mavros.UAV`.
    """

    def __init__(
        self,
        drone_ns: str,
        mass: str | float,
        radius: str | float,
        height: str | float,
        num_rotors: str | int,
        thrust_curve: str,
    ) -> None:
        # one thread for all calls: it sleeps by the vehicle's clock while other coroutines run
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix=drone_ns)
        made = self._thread.submit(
            uav_mavros.UAV, drone_ns, mass, radius, height, num_rotors, thrust_curve
        ).result()
        self._uav = made
        self.ekf, self.sen, self.act, self.info = made.ekf, made.sen, made.act, made.info

    async def connect(self) -> None:
        """Do nothing, because the constructor has connected the vehicle already."""

    async def arm_drone(self) -> None:
        """Arm, and wait for the confirmation.

        Raises CommandRefusedError.
        """
        await self._run(self._uav.arm_drone)

    async def disarm_drone(self) -> None:
        """Disarm, and wait for the confirmation.

        Raises CommandRefusedError in the air.
        """
        await self._run(self._uav.disarm_drone)

    async def start_offboard_mode(self) -> None:
        """Enter OFFBOARD at the current position, and wait for the confirmation.

        Raises CommandRefusedError.
        """
        self._uav.reads.clear()
        await self._run(self._uav.start_offboard_mode)

    async def start_offboard_mission(self) -> None:
        """Wait until the vehicle is ready, enter OFFBOARD, and arm.

        Raises CommandRefusedError, or NotConfirmedError after 20 s.
        """
        self._uav.reads.clear()
        await self._run(self._uav.start_offboard_mission)

    async def auto_land(self) -> None:
        """Start the landing at the current position.

        Return when the autopilot is in AUTO.LAND. The vehicle then still descends.
        """
        await self._run(self._uav.auto_land)

    async def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> None:
        """Send a position setpoint at 50 Hz for a number of seconds.

        pos: [m] [NED] (3, 1). yaw: [rad]. time: [s].
        """
        await self._set(self._uav.set_pos_yaw, pos, yaw, time)

    async def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint, then wait until the next one is due at the rate `freq`.

        vel: [m/s] [NED] (3, 1). yaw: [rad]. freq: [Hz].
        """
        await self._set(self._uav.set_vel_yaw, vel, yaw, freq)

    async def set_vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint in vehicle axes (FRD), then wait until the next one is due at the rate `freq`.

        vel_body: forward, right, down [m/s] (3, 1). yaw_rate: [rad/s]. freq: [Hz].
        """
        await self._set(self._uav.set_vel_body_yaw_rate, vel_body, yaw_rate, freq)

    async def set_att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> None:
        """Send an attitude and thrust setpoint, then wait until the next one is due at the rate `freq`.

        att: roll, pitch, yaw [rad] (3, 1) for att_type "euler", q_nb wxyz (4, 1) for "quaternion". thrust: [N]. freq: [Hz].
        """
        await self._set(self._uav.set_att_thrust, att, att_type, thrust, freq)

    async def set_ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> None:
        """Send a setpoint of angular rates and thrust, then wait until the next one is due at the rate `freq`.

        ang_vel: [rad/s] [FRD] (3, 1). thrust: [N]. freq: [Hz].
        """
        await self._set(self._uav.set_ang_vel_thrust, ang_vel, thrust, freq)

    async def set_act(self, group: int, output: ArrayLike, freq: ArrayLike) -> None:
        """Send an actuator setpoint, then wait until the next one is due at the rate `freq`.

        Raises CommandRefusedError for autopilots newer than PX4 v1.13.
        """
        await self._set(self._uav.set_act, group, output, freq)

    async def _set(self, call: Callable[..., None], *arguments: Any) -> None:
        """Send a setpoint, unless it was computed from telemetry that is too old.

        call: setter of `arena.compat.uav_mavros.UAV`. Raises StaleDataError if a coroutine has read a value that was too old.
        """
        self._uav.reads.check()
        await self._run(call, *arguments)

    async def _run(self, call: Callable[..., None], *arguments: Any) -> None:
        await asyncio.get_running_loop().run_in_executor(self._thread, call, *arguments)
