"""Take off, fly a slow square, return, land. The scenarios of this folder disturb this flight.

    program: {path: square.py, args: [--laps, 3]}      # more laps for a longer flight; one by default

Positions are relative to the start, so all vehicles of an arena can fly this program at the same time and keep their
distances. The square needs 1 m of free space to the north and east, and 1.5 m above.
"""

import argparse

from arena import UAV

CORNERS = [[0, 0, -1.2], [1, 0, -1.2], [1, 1, -1.2], [0, 1, -1.2]]  # north, east, down [m] from the start
SIDE_S = 2.5

with UAV.from_args() as uav:
    parser = argparse.ArgumentParser()
    parser.add_argument("--laps", type=int, default=1)
    laps = parser.parse_args(uav.args).laps
    uav.start_offboard_mission()
    start = uav.ekf.pos
    for _ in range(laps):
        for corner in CORNERS:
            uav.set_pos_yaw(start + corner, 0.0, SIDE_S)
    uav.set_pos_yaw(start + CORNERS[0], 0.0, SIDE_S)
    uav.auto_land()
