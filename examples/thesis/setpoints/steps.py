"""Six position steps of 6 s each, then a landing.

Each step adds to the position and yaw that are estimated at that instant, as in the thesis. So the error at the end of a
step becomes a part of the next setpoint.

Argument, optional: time that the vehicle stands armed before the first step [s].
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

if __name__ == "__main__":
    with UAV.from_args() as uav:
        uav.start_offboard_mission()
        if uav.args:
            now = uav.snapshot().ekf
            uav.set_pos_yaw(now.pos, now.att_euler[2], float(uav.args[0]))
        for offset, turn_deg in STEPS:
            now = uav.snapshot().ekf
            uav.set_pos_yaw(now.pos + offset, now.att_euler[2] + radians(turn_deg), HOLD_S)
        uav.auto_land()
