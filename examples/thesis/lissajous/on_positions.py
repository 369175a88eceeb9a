"""Flies a Lissajous figure on the autopilot's position controller.

Arguments: name of the figure; `positions` (as the thesis: position setpoints only) or `feed-forward` (also velocity and acceleration).
"""

from curves import DURATION_S, FREQ_HZ, at

from arena import UAV

with UAV.from_args() as uav:
    figure, kind = uav.args
    uav.start_offboard_mission()
    uav.set_pos_yaw(at(figure, 0.0).pos, 0.0, 6.0)
    began = uav.clock.now()
    while (t := uav.clock.now() - began) < DURATION_S:
        wanted = at(figure, t)
        if kind == "positions":
            uav.set_pos_yaw(wanted.pos, wanted.yaw, 1.0 / FREQ_HZ)
        else:
            uav.set_pos_vel_yaw(wanted.pos, wanted.vel, wanted.yaw, FREQ_HZ, acc=wanted.acc)
    uav.set_pos_yaw(at(figure, DURATION_S).pos, 0.0, 2.0)
    uav.auto_land()
