"""Program of each vehicle in `benchmarks/px4.py`: takes off to 1.5 m and ends; the autopilot then holds the position."""

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    uav.set_pos_yaw([start[0], start[1], start[2] - 1.5], 0.0, 6.0)
