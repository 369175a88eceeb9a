"""Take off, fly 1 m above the start, then do what the first argument says."""

import os
import signal
import threading
import time

import numpy as np

from arena import UAV

SPIN_S = 10.0
"""Time for which a hung program uses all of the CPU that it gets [s]. Its vehicle has landed by then."""

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    above = start + np.array([0.0, 0.0, -1.0])
    uav.set_pos_yaw(above, 0.0, 6.0)
    print("above", flush=True)
    match uav.args[0]:
        case "lands":
            uav.auto_land()
        case "tours":
            for step in ([0.6, 0.0, 0.0], [0.6, 0.6, -0.3], [0.0, 0.0, 0.0]):
                uav.set_pos_yaw(above + np.array(step), 0.5, 5.0)
            uav.auto_land()
        case "hovers":
            uav.set_pos_yaw(above, 0.0, 3000.0)  # longer than the battery lasts
        case "sends_at":
            for _ in range(int(8.0 * float(uav.args[1]))):
                uav.set_pos_vel_yaw(above, [0.0, 0.0, 0.0], 0.0, float(uav.args[1]))
            uav.auto_land()
        case "pauses":
            uav.clock.sleep_until(uav.clock.now() + float(uav.args[1]))
            uav.set_pos_yaw(above, 0.0, 5.0)
            uav.auto_land()
        case "throws":
            raise ValueError("no such place")
        case "spins":
            begun = time.monotonic()
            while True:  # does not reply to anything, as long as a vehicle needs to land with all of the CPU; then without
                if time.monotonic() > begun + (float(uav.args[1]) if uav.args[1:] else SPIN_S):
                    time.sleep(1.0)
        case "waits":
            threading.Event().wait()
        case "freezes":
            os.kill(os.getpid(), signal.SIGSTOP)
        case "is_killed":
            os.kill(os.getpid(), signal.SIGKILL)
