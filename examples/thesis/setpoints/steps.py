"""Six position steps of 6 s each, then a landing. Each step adds to the position and yaw that are estimated at that instant, as in
the thesis. So the error at the end of a step becomes a part of the next setpoint.
"""

from math import radians

from arena import UAV

HOLD_S = 6.0
STEPS = [  # north, east, down [m]; yaw [deg]
    ((2.0, 1.0, -1.0), 10.0),
    ((-0.5, -1.5, -0.5), 60.0),
    ((-1.5, 1.0, -0.5), -45.0),
    ((1.0, -1.0, 1.0), -20.0),
    ((1.0, 1.5, 0.6), 35.0),
    ((-2.0, -1.0, -1.0), -60.0),
]

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    for offset, turn_deg in STEPS:
        now = uav.snapshot().ekf
        uav.set_pos_yaw(now.pos + offset, now.att_euler[2] + radians(turn_deg), HOLD_S)
    uav.auto_land()
