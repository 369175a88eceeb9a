"""Up to 1.5 m, wait a little, then far too high: what the ceiling of a geofence is for."""

from arena import UAV

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    uav.set_pos_yaw(start + [0.0, 0.0, -1.5], 0.0, 8.0)
    uav.set_pos_yaw(start + [0.0, 0.0, -3.2], 0.0, 60.0)
