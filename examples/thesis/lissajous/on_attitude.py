"""Flies a Lissajous figure with a position controller of its own (PID), whose output is an attitude and a thrust.

Argument: name of the figure. The gains are those of the thesis.
"""

from curves import DURATION_S, FREQ_HZ, at

from arena import UAV
from arena.controllers import Gains, PositionPid

KP, KD, KI = (
    (4.0, 4.0, 4.0),
    (4.0, 4.0, 4.0),
    (0.15, 0.15, 0.5),
)  # [N/m], [N s/m], [N/(m s)]; north, east, down

with UAV.from_args() as uav:
    (figure,) = uav.args
    mass = uav.info.mass
    per_kg = [tuple(k / mass for k in gain) for gain in (KP, KD, KI)]
    pid = PositionPid(mass, Gains(p=per_kg[0], d=per_kg[1], i=per_kg[2]))
    uav.start_offboard_mission()
    uav.set_pos_yaw(at(figure, 0.0).pos, 0.0, 6.0)
    began = uav.clock.now()
    while (t := uav.clock.now() - began) < DURATION_S:
        wanted = at(figure, t)
        uav.reference(wanted.pos, wanted.vel, wanted.yaw)
        now = uav.snapshot().ekf
        attitude = pid.update(wanted, now.pos, now.vel, uav.clock.now())
        uav.set_att_thrust(attitude.q_nb, "quaternion", attitude.thrust_n, FREQ_HZ)
    uav.set_pos_yaw(at(figure, DURATION_S).pos, 0.0, 2.0)
    uav.auto_land()
