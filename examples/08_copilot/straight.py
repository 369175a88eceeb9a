"""Climb, then fly straight at V_N V_E [m/s] until OFFBOARD is lost or SECONDS are over (60 by default); then land there.

program: {path: straight.py, args: ['1.5', '0', '6']}
"""

from arena.uav import UAV, OffboardLostError

with UAV.from_args() as uav:
    north, east, seconds = map(float, [*uav.args, "60"][:3])
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -1.2], 0.0, 6.0)
    end = uav.clock.now() + seconds
    try:
        while uav.clock.now() < end:
            uav.set_vel_yaw([north, east, 0.0], 0.0, 50.0)
    except OffboardLostError as lost:
        print(lost, flush=True)
        uav.clock.sleep_until(uav.clock.now() + 4.0)
    uav.auto_land()
