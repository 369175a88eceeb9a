"""Fly where one should not: `copilot_pilot.py V_N V_E [SECONDS]`. Up, then this velocity [m/s] until something takes OFFBOARD away,
or the time is over; then land from wherever that has left the vehicle.
"""

import numpy as np

from arena.uav import UAV, OffboardLostError

with UAV.from_args() as uav:
    north, east, *rest = (float(a) for a in uav.args)
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos + np.array([0.0, 0.0, -1.2]), 0.0, 5.0)
    end = uav.clock.now() + (rest[0] if rest else 60.0)
    try:
        while uav.clock.now() < end:
            uav.set_vel_yaw([north, east, 0.0], 0.0, 50.0)
    except OffboardLostError as lost:
        print(lost, flush=True)
        uav.clock.sleep_until(uav.clock.now() + 4.0)
    uav.auto_land()
