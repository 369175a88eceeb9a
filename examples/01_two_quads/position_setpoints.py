"""Position setpoints: take off, fly five places around the start, turn, climb, come back and land.

Places are counted from where the vehicle stands, so that every vehicle of an arena can fly this program at once:
they stay as far from each other as they started. It needs 1.2 m of room to the north, south, east and west
and 2 m above.
"""

from math import pi

from arena import UAV

STEPS = [  # north, east, down [m] from the start; yaw [rad]; time [s]
    ([0.0, 0.0, -1.0], 0.0, 6.0),
    ([1.0, 0.0, -1.0], 0.0, 5.0),
    ([1.0, 1.0, -1.5], pi / 2, 5.0),
    ([-0.8, -1.0, -1.5], 0.0, 6.0),
    ([0.0, 0.0, -1.0], 0.0, 6.0),
]

with UAV.from_args() as uav:
    uav.start_offboard_mission()
    start = uav.ekf.pos
    for place, yaw, time in STEPS:
        uav.set_pos_yaw(start + place, yaw, time)
    uav.auto_land()
