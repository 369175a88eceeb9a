"""Up to each of the heights above the start that are given [m], eight seconds each; then the last for as long as it may.

What stands above a vehicle, or how far it may fall, decides what the scenarios make of it.
"""

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    for height in map(float, uav.args):
        uav.set_pos_yaw(start + [0.0, 0.0, -height], 0.0, 8.0)
    uav.set_pos_yaw(start + [0.0, 0.0, -height], 0.0, 300.0)
