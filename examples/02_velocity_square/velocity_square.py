"""Velocity setpoints: a square of 1.5 m, one side north, one east, one south, one west, with the nose along the way.

Each call sends one velocity setpoint and then waits for one period: 50 calls a second here. When the calls stop, the
autopilot detects the loss after 1 s and lands. Try it: insert `while True: pass` directly before `uav.auto_land()`.
"""

from math import pi

import numpy as np

from arena import UAV

SPEED_M_S = 0.5
SIDE_S = 3.0
FREQ_HZ = 50
SIDES = [
    ([1, 0, 0], 0.0),
    ([0, 1, 0], pi / 2),
    ([-1, 0, 0], pi),
    ([0, -1, 0], -pi / 2),
]  # north, east, down; yaw [rad]

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    hover = uav.ekf.pos + np.array([0.0, 0.0, -1.2])
    uav.set_pos_yaw(hover, 0.0, 6.0)
    for direction, yaw in SIDES:
        for _ in range(int(SIDE_S * FREQ_HZ)):
            uav.set_vel_yaw(SPEED_M_S * np.array(direction), yaw, FREQ_HZ)
    uav.set_pos_yaw(hover, 0.0, 6.0)
    uav.auto_land()
