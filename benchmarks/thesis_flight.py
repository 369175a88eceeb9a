"""The thesis's setpoint experiment, used by `benchmarks/thesis.py`.

Each step is added to the position and yaw that are estimated at its start.
"""

from math import pi

import numpy as np

from arena import UAV

STANDS_S = 0.9  # armed, before the first step: as in the logs of both real flights
STEP_S = 6.0
STEPS = [  # north, east, down [m]; yaw [deg]
    ([2.0, 1.0, -1.0], 10.0),
    ([-0.5, -1.5, -0.5], 60.0),
    ([-1.5, 1.0, -0.5], -45.0),
    ([1.0, -1.0, 1.0], -20.0),
    ([1.0, 1.5, 0.6], 35.0),
    ([-2.0, -1.0, -1.0], -60.0),
]

if __name__ == "__main__":
    with UAV.from_args() as uav:
        uav.start_offboard_mission()
        uav.set_pos_yaw(uav.ekf.pos, uav.ekf.att_euler[2], STANDS_S)
        for step, yaw_deg in STEPS:
            uav.set_pos_yaw(uav.ekf.pos + np.array(step), uav.ekf.att_euler[2] + yaw_deg * pi / 180.0, STEP_S)
        uav.auto_land()
