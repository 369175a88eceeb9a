"""Fly to the north-east and land; each step reads the relative sensors, so a missing measurement ends the program with an error."""

import numpy as np

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start, yaw = uav.ekf.pos, float(uav.ekf.att_euler[2])
    uav.set_pos_yaw(start + np.array([0.0, 0.0, -1.0]), yaw, 3.0)
    for k in range(200):
        uav.set_pos_vel_yaw(start + np.array([0.01 * k, 0.005 * k, -1.0]), [0.5, 0.25, 0.0], yaw, 50)
        assert all(np.isfinite([*n.pos, *n.vel]).all() and n.age_s < 0.2 for n in uav.sen.neighbours.values())
        assert all(b.range > 0.0 for b in uav.sen.beacons.values())
    print(f"neighbours: {len(uav.sen.neighbours)}, beacons: {len(uav.sen.beacons)}", flush=True)
    uav.auto_land()
