"""Times at which PX4 has received external vision poses, from its ULog in the run folder."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from arena.errors import InputError
from arena.flight_log.px4_ulog import load_ulog
from arena.flight_log.run_folder import ulogs_of
from arena.geometry import Array

_TOPIC = "vehicle_visual_odometry"


def vision_times(folder: Path, vehicle: str) -> Array:
    """Return the times of the poses that a simulated PX4 has logged, in simulation time [s] (n,).

    The result is empty without a ULog.

    An autopilot logs while it is armed, and PX4 logs at most one pose per 30 ms. Simulated autopilots count their time from the
    start of the simulation. Logs of real autopilots have another clock: do not use this function for them.
    """
    found = [np.zeros(0)]
    for path in ulogs_of(folder, vehicle):
        with contextlib.suppress(InputError, OSError):
            own = [data for data in load_ulog(path).data_list if data.name == _TOPIC and data.multi_id == 0]
            found += [1e-6 * np.asarray(data.data["timestamp"], float) for data in own]
    return np.sort(np.concatenate(found))
