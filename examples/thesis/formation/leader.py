"""Leader of the formation: flies its ellipse with a position controller of its own, whose output is an attitude and a thrust.

Start it with an argument to begin later: `leader.py 0.5` begins 0.5 s after the others.
"""

from formation import CLIMB_S, FREQ_HZ, STAND_S, TURN_S, leader

from arena import UAV
from arena.controllers import Gains, PositionPid
from arena.trajectories import Reference

KP, KD, KI = 5.5, 5.5, 0.35  # [N/m], [N s/m], [N/(m s)]: those of the thesis

with UAV.from_args() as uav:
    mass = uav.info.mass
    gains = Gains(p=(KP / mass,) * 3, d=(KD / mass,) * 3, i=(KI / mass,) * 3)
    pid = PositionPid(mass, gains)
    uav.start_offboard_mission()
    began = uav.wait_for("formation") + float((uav.args or ["0"])[0])
    uav.clock.sleep_until(began)
    uav.set_pos_yaw(leader(0.0)[0], 0.0, CLIMB_S)
    while (t := uav.clock.now() - began - CLIMB_S - STAND_S) < TURN_S:
        pos, vel, acc = leader(t)
        uav.reference(pos, vel, 0.0)
        now = uav.snapshot().ekf
        wanted = pid.update(Reference(pos=pos, vel=vel, acc=acc, yaw=0.0), now.pos, now.vel, uav.clock.now())
        uav.set_att_thrust(wanted.q_nb, "quaternion", wanted.thrust_n, FREQ_HZ)
    uav.set_pos_yaw(leader(TURN_S)[0], 0.0, 2.0)
    uav.auto_land()
