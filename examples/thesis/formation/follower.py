"""Follower of the formation: keeps its place by the measured positions and velocities of two other vehicles.

Arguments: its angle in the formation, that of the follower it measures [deg], and, if it begins later than the others, by how much
[s]. After the take-off and the flight to its start, the control loop uses only the relative sensor and the plan, not its own position.
"""

import numpy as np
from formation import CLIMB_S, FREQ_HZ, STAND_S, TURN_S, leader, place

from arena import UAV
from arena.controllers import Gains, PositionPid, formation_reference

KP, KD, KI = 4.0, 2.0, 0.25  # per neighbour [N/m], [N s/m], [N/(m s)]: those of the thesis

with UAV.from_args() as uav:
    own, other = np.radians([float(angle) for angle in uav.args[:2]])
    mass = uav.info.mass
    gains = Gains(p=(KP / mass,) * 3, d=(KD / mass,) * 3, i=(KI / mass,) * 3)
    pid = PositionPid(mass, gains)
    uav.start_offboard_mission()
    began = uav.wait_for("formation") + float(uav.args[2] if len(uav.args) > 2 else 0.0)
    uav.clock.sleep_until(began)
    uav.set_pos_yaw(leader(0.0)[0] + place(own, 0.0)[0], 0.0, CLIMB_S)
    while (t := uav.clock.now() - began - CLIMB_S - STAND_S) < TURN_S:
        (lead_pos, lead_vel, lead_acc), (pos, vel, acc) = leader(t), place(own, t)
        other_pos, other_vel, _ = place(other, t)
        uav.reference(lead_pos + pos, lead_vel + vel, 0.0)  # for the log only
        near = uav.sen.emu
        wanted = pid.update(
            formation_reference(
                near.rel_pos, near.rel_vel, [-pos, other_pos - pos], [-vel, other_vel - vel], lead_acc + acc
            ),
            np.zeros(3),
            np.zeros(3),
            uav.clock.now(),
        )
        uav.set_att_thrust(wanted.q_nb, "quaternion", wanted.thrust_n, FREQ_HZ)
    uav.set_pos_yaw(leader(TURN_S)[0] + place(own, TURN_S)[0], 0.0, 2.0)
    uav.auto_land()
