"""Take off, hover and land. With the argument `throws` the program of uav3 fails in the air."""

import numpy as np

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    hover = uav.ekf.pos - np.array([0.0, 0.0, 1.2])
    uav.set_pos_yaw(hover, 0.0, 5.0)
    if uav.info.drone_ns == "uav3" and "throws" in uav.args:
        raise ValueError("no such place")
    for _ in range(60):
        uav.set_vel_yaw([0.2, 0.0, 0.0], 0.0, 20)
    uav.auto_land()
