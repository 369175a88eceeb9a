"""Wait for a file, take off, hover 1 m above the start, land: `wait_and_fly.py FILE SECONDS`."""

from pathlib import Path

import numpy as np

from arena import UAV

with UAV.from_args() as uav:
    go, stay_s = Path(uav.args[0]), float(uav.args[1])
    while not go.exists():
        uav.clock.sleep_until(uav.clock.now() + 0.1)
    uav.start_offboard_mission()
    above = uav.ekf.pos + np.array([0.0, 0.0, -1.0])
    uav.set_pos_yaw(above, 0.0, 3.0 + stay_s)
    uav.auto_land()
    print("landed as planned", flush=True)
