"""Take off and land with MAVSDK-Python: `take_off_and_land.py URL PORT`. PORT: of the MAVSDK server it starts."""

import asyncio
import json
import sys

from mavsdk_grpc import System


async def main() -> None:
    drone = System(port=int(sys.argv[2]))
    await drone.connect(system_address=sys.argv[1])
    async for state in drone.core.connection_state():
        if state.is_connected:
            break
    async for health in drone.telemetry.health():
        if health.is_global_position_ok and health.is_home_position_ok:
            break
    await drone.action.set_takeoff_altitude(1.5)
    await drone.action.arm()
    await drone.action.takeoff()
    highest = 0.0
    async for position in drone.telemetry.position():
        highest = max(highest, position.relative_altitude_m)
        if highest > 1.2:
            break
    await drone.action.land()
    async for in_air in drone.telemetry.in_air():
        if not in_air:
            break
    print(json.dumps({"highest_m": highest}))


asyncio.run(asyncio.wait_for(main(), 300))
