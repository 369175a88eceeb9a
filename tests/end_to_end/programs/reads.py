"""Print `waiting`, then the estimated position at 20 Hz for 2 s, then try to arm, and print the error."""

from __future__ import annotations

from arena import UAV
from arena.errors import CommandRefusedError, StaleDataError

with UAV.from_args() as uav:
    rate = uav.clock.rate(20.0)
    read = 0
    print("waiting", flush=True)
    while read < 40:
        rate.sleep()
        try:
            pos = uav.ekf.pos
        except StaleDataError:  # before the first message
            continue
        read += 1
        print("at", f"{uav.clock.now():.3f}", *pos.tolist(), flush=True)
    try:
        uav.arm_drone()
    except CommandRefusedError as error:
        print("refused:", error, flush=True)
