"""Program in the thesis's style, with the coroutines of its MAVSDK library."""

import asyncio
import sys

import numpy as np

from arena.compat.uav_mavsdk import UAV


async def main():
    uav = UAV(*sys.argv[1:7])
    await uav.connect()
    await uav.start_offboard_mission()
    place = uav.ekf.pos + np.array([[0.5], [0.0], [-1.2]])
    await uav.set_pos_yaw(place, uav.ekf.att_euler[2], 5)
    print("error_m", float(np.linalg.norm(uav.ekf.pos - place)))
    await uav.auto_land()


if __name__ == "__main__":
    asyncio.run(main())
