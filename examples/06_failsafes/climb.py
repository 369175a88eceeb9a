"""Climb to each of the given heights above the start [m], 8 s each, then hold the last one.

program: {path: climb.py, args: ['1.5', '3']}
"""

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    for height in map(float, uav.args):
        uav.set_pos_yaw(start + [0.0, 0.0, -height], 0.0, 8.0)
    uav.set_pos_yaw(start + [0.0, 0.0, -height], 0.0, 300.0)
