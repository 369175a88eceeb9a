"""Fly all vehicles of a group. With the argument `killed` the process kills itself in the air."""

import os
import signal

import numpy as np

from arena import UAV

with UAV.all_from_args() as fleet:
    fleet.start_offboard_mission()
    hover = fleet.pos - np.array([0.0, 0.0, 1.2])
    for _ in range(100):
        fleet.set_pos_yaw(hover, 0.0, 20)
    if "killed" in fleet[0].args:
        os.kill(os.getpid(), signal.SIGKILL)
    fleet.auto_land()
