"""`AsyncUAV`, the asynchronous form of `UAV`: the same methods, as coroutines."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

from numpy.typing import ArrayLike

from arena.errors import VehicleError
from arena.trajectories.trajectory import Trajectory
from arena.uav.arguments import read_arguments, read_group
from arena.uav.data_groups import Snapshot
from arena.uav.membership import MEMBERSHIP
from arena.uav.setpoints import AttitudeKind, duration_s
from arena.uav.simulated_loop import running_clock
from arena.uav.steps import Steps
from arena.uav.vehicle import UAV
from arena.uav.vehicle_control import STREAM_HZ

T = TypeVar("T")


class AsyncUAV:
    """A vehicle that an asynchronous program flies. Names, arguments, units and exceptions are those of `UAV`.

    Several vehicles can fly in one event loop. A vehicle carries out one method at a time; a second call meanwhile raises
    VehicleError. A cancelled method sends nothing more, so the offboard failsafe lands the vehicle unless the next call follows.

        async def main():
            async with AsyncUAV.from_args() as uav:
                await uav.start_offboard_mission()
                await uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -1.5], 0.0, 5.0)
                await uav.auto_land()

        arena.uav.run(main())
    """

    def __init__(self, uav: UAV) -> None:
        self._uav, self._running = uav, ""
        uav.control.share_thread()
        self.args, self.clock = uav.args, uav.clock
        self.ekf, self.sen, self.act, self.info = uav.ekf, uav.sen, uav.act, uav.info

    @classmethod
    def from_args(cls, argv: Sequence[str] | None = None) -> AsyncUAV:
        """Return the vehicle that the command line selects. Call it inside a coroutine."""
        return cls(UAV(**read_arguments(argv, running_clock)))

    @classmethod
    def all_from_args(cls) -> list[AsyncUAV]:
        """Return all vehicles of a group (`run: once` in the YAML), in the order of the YAML. Call it inside a coroutine."""
        return [cls(UAV(**each)) for each in read_group(MEMBERSHIP.get(), running_clock)]

    def snapshot(self) -> Snapshot:
        """Return a copy of the data groups (`ekf`, `sen`, `act`, `info`). The copy never changes."""
        return self._uav.snapshot()

    async def arm_drone(self) -> None:
        """Arm the vehicle and wait for the confirmation."""
        await self._do("arm_drone", self._uav.control.arm())

    async def disarm_drone(self) -> None:
        """Disarm the vehicle and wait for the confirmation."""
        await self._do("disarm_drone", self._uav.control.disarm())

    async def start_offboard_mode(self) -> None:
        """Enter OFFBOARD at the current position and wait for the confirmation."""
        await self._do("start_offboard_mode", self._uav.control.enter_offboard())

    async def start_offboard_mission(self) -> None:
        """Wait until the vehicle is ready, enter OFFBOARD and arm."""
        await self._do("start_offboard_mission", self._uav.control.start_mission())

    async def auto_land(self, wait: bool = True) -> None:
        """Land at the current position. Return when the vehicle is on the ground and disarmed."""
        await self._do("auto_land", self._uav.control.land(wait=wait))

    async def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, time: ArrayLike) -> None:
        """Fly to a position: send the setpoint at 50 Hz for `time` seconds.

        pos: [m] [NED] (3,). yaw: [rad].
        time: [s]. Then the method returns, even if the vehicle has not reached the position.
        """
        await self._do("set_pos_yaw", self._uav.steps.pos_yaw(pos, yaw, time))

    async def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint.

        vel: [m/s] [NED] (3,).
        yaw: [rad].
        freq: [Hz].
        """
        await self._do("set_vel_yaw", self._uav.steps.vel_yaw(vel, yaw, freq))

    async def set_pos_vel_yaw(
        self,
        pos: ArrayLike,
        vel: ArrayLike,
        yaw: ArrayLike,
        freq: ArrayLike,
        *,
        acc: ArrayLike | None = None,
        yaw_rate: ArrayLike | None = None,
    ) -> None:
        """Send a trajectory setpoint. Arguments as in `UAV.set_pos_vel_yaw`."""
        steps = self._uav.steps.pos_vel_yaw(pos, vel, yaw, freq, acc=acc, yaw_rate=yaw_rate)
        await self._do("set_pos_vel_yaw", steps)

    async def set_vel_body_yaw_rate(self, vel_body: ArrayLike, yaw_rate: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint in vehicle axes.

        vel_body: forward, right, down [m/s] (3,).
        yaw_rate: [rad/s].
        freq: [Hz].
        """
        steps = self._uav.steps.vel_body_yaw_rate(vel_body, yaw_rate, freq)
        await self._do("set_vel_body_yaw_rate", steps)

    async def set_att_thrust(
        self, att: ArrayLike, att_type: AttitudeKind, thrust: ArrayLike, freq: ArrayLike
    ) -> None:
        """Send an attitude setpoint. The arguments are those of `UAV.set_att_thrust`.

        thrust: [N].
        freq: [Hz].
        """
        await self._do("set_att_thrust", self._uav.steps.att_thrust(att, att_type, thrust, freq))

    async def set_ang_vel_thrust(self, ang_vel: ArrayLike, thrust: ArrayLike, freq: ArrayLike) -> None:
        """Send a setpoint of body rates and thrust.

        ang_vel: [rad/s] [FRD] (3,).
        thrust: [N].
        freq: [Hz].
        """
        await self._do("set_ang_vel_thrust", self._uav.steps.ang_vel_thrust(ang_vel, thrust, freq))

    async def set_act(self, group: int, output: ArrayLike, freq: ArrayLike) -> None:
        """Send an actuator setpoint, for PX4 up to v1.13.

        group: 0..3.
        output: up to 8 numbers -1..1 [-].
        freq: [Hz].
        """
        await self._do("set_act", self._uav.steps.act(group, output, freq))

    async def follow(self, trajectory: Trajectory, freq: ArrayLike = STREAM_HZ) -> None:
        """Fly along a trajectory until it ends.

        freq: [Hz].
        """
        await self._do("follow", self._uav.steps.follow(trajectory, freq))

    async def wait_for(self, name: str, n: int | None = None, timeout: ArrayLike = 30.0) -> float:
        """Wait until the other programs of the run have called `wait_for`, too. Return the common start time [s]."""
        return await self._do("wait_for", self._uav.steps.wait_for(name, n, timeout))

    async def hold_until(self, done: Callable[[], bool], timeout: ArrayLike) -> bool:
        """Wait until the function `done` returns true, at most `timeout` [s]. Return False after the timeout.

        In OFFBOARD the vehicle holds its position.
        """
        return bool(await self._do("hold_until", self._uav.control.wait_until(done, duration_s(timeout))))

    async def hold_until_time(self, t: float) -> float:
        """Hold the position until the time t [s] of `clock`, and return the time.

        The vehicle holds its position if it is in OFFBOARD.
        """
        return await self._do("hold_until_time", self._uav.steps.hold_until_time(t))

    def reference(
        self, p: ArrayLike | None = None, v: ArrayLike | None = None, yaw: ArrayLike | None = None
    ) -> None:
        """Log the position, velocity and yaw that the program wants to follow. Return at once.

        Arguments as in `UAV.reference`.
        """
        self._uav.reference(p, v, yaw)

    def planned_path(self, points: ArrayLike) -> None:
        """Publish the path that the program plans to fly, for viewers and the record. Return at once.

        points: [m] [NED] (k, 3). Return at once.
        """
        self._uav.planned_path(points)

    def has_control(self) -> bool:
        """Return whether the vehicle is armed and in OFFBOARD, so that it can follow this program's setpoints.

        Raises OffboardLostError if a pilot or a failsafe has taken the vehicle, StaleDataError if the autopilot is silent.
        """
        return self._uav.control.has_control()

    def close(self) -> None:
        """Close the connection without sending a command.

        A vehicle in the air then enters its offboard loss failsafe.
        """
        self._uav.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    async def _do(self, name: str, steps: Steps[T]) -> T:
        """Run the generator (`Steps`) of a method to its end, and await each wake-up time [s] that it yields."""
        if self._running:
            steps.close()
            raise VehicleError(
                f"{self.info.drone_ns}: {name} was called while {self._running} is running. Await one method before the next"
            )
        self._running = name
        try:
            while True:
                due = next(steps)
                await asyncio.sleep(max(0.0, due - self.clock.now()))
        except StopIteration as end:
            result: Any = end.value
            return result  # type: ignore[no-any-return]
        finally:
            self._running = ""
            steps.close()
