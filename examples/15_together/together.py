"""Three vehicles fly in one asynchronous program: they take off one after the other, then go on together.

If one vehicle fails, all land (`Swarm`).
"""

import asyncio

from arena.uav import AsyncUAV, Swarm, run


async def part(uav: AsyncUAV, swarm: Swarm) -> None:
    """Fly one vehicle of the swarm."""
    await asyncio.sleep(2.0 * swarm.uavs.index(uav))  # seconds of the arena's time
    await uav.start_offboard_mission()
    above = uav.ekf.pos + [0.0, 0.0, -1.2]  # north, east, down [m]
    await uav.set_pos_yaw(above, 0.0, 7.0)
    start = await swarm.barrier(uav, "all are up", timeout=30.0)
    print(f"{uav.info.drone_ns}: goes on at {start:.2f} s")
    await uav.set_pos_yaw(above + [1.0, 0.0, 0.0], 0.0, 6.0)
    await swarm.barrier(uav, "all are north", timeout=10.0)
    await uav.set_pos_yaw(above, 0.0, 6.0)
    await uav.auto_land()


async def main() -> None:
    async with Swarm.from_args() as swarm:
        await swarm.fly(part)


run(main())
