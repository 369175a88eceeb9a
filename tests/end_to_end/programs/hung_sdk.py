"""Behave like a hung SDK program: a thread repeats the last setpoint while the main loop hangs.

The main loop sends heartbeats to the copilot for 3 s before it hangs.
"""

import json
import sys
import threading
from pathlib import Path

import numpy as np

from arena import UAV, Heartbeat
from arena.clock import SimClock

uav = UAV.from_args()
uav.start_offboard_mission()
place = uav.ekf.pos + np.array([0.0, 0.0, -1.0])
uav.set_pos_yaw(place, 0.0, 4.0)


def resend() -> None:
    """Send a setpoint without `arena.uav`, which would send heartbeats and detect the mode change."""
    clock = SimClock(
        json.loads(Path(sys.argv[sys.argv.index("--uav") + 1]).read_text())["clock"], "the thread of an SDK"
    )
    rate = clock.rate(20.0)
    while True:
        uav._connection.send(uav.encoder.pos_yaw(place, 0.0, clock.now()))
        rate.sleep()


heartbeat = Heartbeat.from_args()
threading.Thread(target=resend, daemon=True).start()
loop = uav.clock.rate(20.0)
for _ in range(60):
    heartbeat.beat()
    loop.sleep()
print("hangs", flush=True)
threading.Event().wait()
