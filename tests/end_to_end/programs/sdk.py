"""A MAVSDK program: `sdk.py URL`. Prints as JSON which vehicle it received, a parameter and whether it is armed."""

import asyncio
import json
import sys

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync


async def main() -> None:
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(sys.argv[1])
        system = await mavsdk.first_autopilot(timeout_s=10.0)
        descent_m_s = await ParamAsync(system).get_param_float("MPC_LAND_SPEED")
        armed = await anext(aiter(TelemetryAsync(system).subscribe_armed()))
        received = [await each.get_system_id() for each in await mavsdk.get_systems()]
        print(json.dumps({"received": received, "descent_m_s": descent_m_s, "armed": armed}))


asyncio.run(main())
