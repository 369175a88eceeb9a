"""A circle of 1.2 m, 1.5 m/s: the same program flies with pymavlink and with MAVSDK (`backend` in the YAML)."""

import numpy as np

from arena import UAV
from arena.trajectories import Circle

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos + np.array([0.0, 0.0, -1.2])  # north, east, down [m]
    uav.set_pos_yaw(start, 0.0, 5.0)
    uav.follow(Circle(start, 1.2, lap_s=5.0, laps=3.0), 50)
    uav.set_pos_yaw(start, 0.0, 1.0)
    uav.auto_land()
