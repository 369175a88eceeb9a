"""Fly with MAVSDK on the SDK port, and hang in the air. MAVSDK's thread then repeats the last setpoint.

The main loop sends heartbeats to the copilot until it hangs.
"""

import os
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, PositionNedYaw
from mavsdk.plugins.telemetry import Telemetry

from arena import Heartbeat

heartbeat = Heartbeat.from_args()
mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
mavsdk.add_any_connection(os.environ["ARENA_SDK_URL"])
drone = mavsdk.first_autopilot(timeout_s=60.0)
assert drone is not None, "MAVSDK has received no heartbeat"
action, offboard, telemetry = Action(drone), Offboard(drone), Telemetry(drone)
while not telemetry.health().is_armable:
    time.sleep(0.1)
offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -1.0, 0.0))
time.sleep(0.2)  # the first setpoint must arrive before the mode is requested
offboard.start()
action.arm()
while telemetry.position_velocity_ned().position.down_m > -0.9:
    heartbeat.beat()
    time.sleep(0.05)
print("hangs", flush=True)
threading.Event().wait()
