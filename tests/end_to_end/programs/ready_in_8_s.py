"""`fly.py` that waits 8 s, instead of 20 s, for a vehicle that does not become ready."""

import runpy
from pathlib import Path

from arena.uav import vehicle_control

vehicle_control.READY_TIMEOUT_S = 8.0
runpy.run_path(str(Path(__file__).with_name("fly.py")), run_name="__main__")
