"""`Swarm`: vehicles with a common plan, flown by one asynchronous program.

It has barriers and a common time, and lands all vehicles if one fails.

A `Fleet` flies on without a lost vehicle; a `Swarm` does not.
"""

from __future__ import annotations

import asyncio
import sys
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Sequence
from types import TracebackType
from typing import Self

from numpy.typing import ArrayLike

from arena.errors import InputError, NotConfirmedError, VehicleError
from arena.uav.async_vehicle import AsyncUAV
from arena.uav.setpoints import duration_s

START_DELAY_S = (
    0.1  # from the last arrival at a barrier to the common start: longer than a period of the held setpoints
)


class Swarm:
    """Vehicles that fly together. If one vehicle fails, all vehicles land.

    uavs: the vehicles, in the order of the YAML.
    names: names of the vehicles.

        async def part(uav, swarm):
            await uav.start_offboard_mission()
            await uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -1.5], 0.0, 5.0)
            start = await swarm.barrier(uav, "up")
            ...
            await uav.auto_land()

        async def main():
            async with Swarm.from_args() as swarm:
                await swarm.fly(part)

        arena.uav.run(main())
    """

    def __init__(self, uavs: Sequence[AsyncUAV]) -> None:
        self.uavs = tuple(uavs)
        self.names = tuple(uav.info.drone_ns for uav in uavs)
        self._arrived: dict[tuple[str, int], dict[str, float]] = {}
        self._uses: Counter[tuple[str, str]] = Counter()
        self._failed: dict[str, BaseException] = {}
        self._ended: set[str] = set()

    @classmethod
    def from_args(cls) -> Swarm:
        """Return all vehicles that this program flies (`run: once` in the YAML). Call it inside a coroutine."""
        return cls(AsyncUAV.all_from_args())

    def now(self) -> float:
        """Return the time of the vehicles' common clock [s]."""
        return self.uavs[0].clock.now()

    async def fly(self, part: Callable[[AsyncUAV, Swarm], Awaitable[object]]) -> None:
        """Call `part(uav, swarm)` for all vehicles at the same time. Return when all calls have ended.

        If a call raises an exception, the other calls are cancelled, all vehicles that the program still controls land, and the
        exception is raised. Each vehicle lands as soon as its own call has ended, so a slow clean-up delays no other vehicle.
        A vehicle that a pilot or a failsafe controls gets no command.
        """
        self._failed.clear()
        self._ended.clear()
        tasks = [asyncio.ensure_future(self._part(part, uav)) for uav in self.uavs]
        try:
            await asyncio.gather(*tasks)
        except BaseException as error:
            pairs = zip(tasks, self.uavs, strict=True)
            await self._report(self._end(task, uav) for task, uav in pairs)
            raise next(iter(self._failed.values()), error) from None

    async def barrier(self, uav: AsyncUAV, name: str, timeout: ArrayLike = 30.0) -> float:
        """Wait until all vehicles of the swarm have called `barrier` with this name. Return the common start time [s].

        All calls return at this time, 0.1 s after the last arrival. In OFFBOARD the vehicles hold their positions while they wait.
        A name may be used again. timeout: [s].
        Raises NotConfirmedError after the timeout, or as soon as a missing vehicle has failed or its part has ended. The message names
        the missing vehicles.
        """
        who, limit = uav.info.drone_ns, duration_s(timeout)
        if who not in self.names:
            raise InputError(f"barrier {name!r}: {who} is not in the swarm of {', '.join(self.names)}")
        self._uses[who, name] += 1
        arrived = self._arrived.setdefault((name, self._uses[who, name]), {})
        arrived[who] = self.now()
        complete = await uav.hold_until(
            lambda: len(arrived) == len(self.names) or bool(self._gone(arrived)), limit
        )
        if len(arrived) < len(self.names):
            del arrived[who]
            missing = [n for n in self.names if n not in arrived and n != who]
            ended = "cannot be completed, because the part of a missing vehicle has ended"
            why = ended if complete else f"timed out after {limit:g} s"
            raise NotConfirmedError(f"{who}: barrier {name!r} {why}: missing {', '.join(missing)}")
        return await uav.hold_until_time(max(arrived.values()) + START_DELAY_S)

    async def land_all(self) -> None:
        """Land all vehicles that the program controls, at the same time.

        Errors of vehicles that do not land are printed.

        A vehicle that a pilot or a failsafe controls, or whose autopilot is silent, gets no command.
        """
        await self._report(self._land(uav) for uav in self.uavs)

    async def _report(self, landings: Iterable[Awaitable[object]]) -> None:
        """Wait for the landings of all vehicles at the same time, and print the errors of vehicles that do not land."""
        results = await asyncio.gather(*landings, return_exceptions=True)
        for name, result in zip(self.names, results, strict=True):
            if isinstance(result, VehicleError):
                print(f"{name}: the program did not land this vehicle: {result}", file=sys.stderr, flush=True)
            elif isinstance(result, BaseException):
                raise result

    def close(self) -> None:
        """Close all connections without sending a command.

        Vehicles in the air then enter their offboard loss failsafe.
        """
        for uav in self.uavs:
            uav.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    async def _part(self, part: Callable[[AsyncUAV, Swarm], Awaitable[object]], uav: AsyncUAV) -> None:
        name = uav.info.drone_ns
        try:
            await part(uav, self)
        except asyncio.CancelledError:
            raise
        except BaseException as error:
            self._failed[name] = error
            raise
        finally:
            self._ended.add(name)

    def _gone(self, arrived: dict[str, float]) -> list[str]:
        """Return the missing vehicles that cannot arrive at a barrier, because their part of the program has ended."""
        return [name for name in self.names if name not in arrived and name in self._ended]

    async def _end(self, part: asyncio.Future[None], uav: AsyncUAV) -> None:
        """Cancel one vehicle's part of the program, wait for its end, and land the vehicle."""
        part.cancel()
        await asyncio.gather(part, return_exceptions=True)
        await self._land(uav)

    async def _land(self, uav: AsyncUAV) -> None:
        if uav.has_control():
            await uav.auto_land()
