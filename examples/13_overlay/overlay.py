"""Overlay the logs (ULog) of two flights of the same program: of PX4 and of the built-in autopilot, or of any two vehicles.

    python overlay.py runs/.../ulog/uav1.ulg runs/.../ulog/uav2.ulg -o overlay.png

Times are counted from arming, and positions from where the vehicle armed. The script needs pyulog and matplotlib, and nothing of
arena: both autopilots use the same names of topics and fields.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from pyulog import ULog

matplotlib.use("Agg")
from matplotlib import pyplot as plt

LINES = (("tab:blue", 2.2), ("tab:orange", 1.1))
PANELS = (
    ("north [m]", "vehicle_local_position", "x", "vehicle_local_position_setpoint"),
    ("east [m]", "vehicle_local_position", "y", "vehicle_local_position_setpoint"),
    ("height [m]", "vehicle_local_position", "z", "vehicle_local_position_setpoint"),
    ("roll [deg]", "vehicle_attitude", "roll", ""),
    ("pitch [deg]", "vehicle_attitude", "pitch", ""),
    ("yaw [deg]", "vehicle_attitude", "yaw", ""),
    ("yaw rate [deg/s]", "vehicle_angular_velocity", "xyz[2]", ""),
    ("mean motor command [-]", "actuator_motors", "mean", ""),
    ("innovation, position east [m]", "estimator_innovations", "ev_hpos[1]", ""),
)


@dataclass
class Log:
    """A ULog. armed_s: time of arming since boot [s].  start: position at arming [m] [NED] (3,)"""

    name: str
    ulog: ULog
    armed_s: float
    start: dict[str, float]

    @classmethod
    def read(cls, path: Path) -> Log:
        ulog = ULog(str(path))
        armed_s = ulog.get_dataset("vehicle_status").data["armed_time"].max() * 1e-6
        local = ulog.get_dataset("vehicle_local_position").data
        k = int(np.searchsorted(local["timestamp"] * 1e-6, armed_s))
        start = {axis: float(local[axis][min(k, len(local[axis]) - 1)]) for axis in "xyz"}
        return cls(f"{path.stem}: {ulog.msg_info_dict['sys_name']}", ulog, armed_s, start)

    def series(self, topic: str, field: str) -> tuple[Any, Any]:
        """Return the times since arming [s] and the values of a field, or of a quantity made from several fields."""
        data = self.ulog.get_dataset(topic).data
        t = data["timestamp"] * 1e-6 - self.armed_s
        if field in ("roll", "pitch", "yaw"):
            return t, np.degrees(euler(*(data[f"q[{k}]"] for k in range(4)))[field])
        if field == "mean":
            return t, np.mean([data[f"control[{k}]"] for k in range(4)], axis=0)
        values = data[field] - self.start.get(field, 0.0)
        values = np.degrees(values) if field.startswith("xyz") else values
        return t, -values if field == "z" else values


def euler(w: Any, x: Any, y: Any, z: Any) -> dict[str, Any]:
    """Return roll, pitch, yaw [rad] of attitudes."""
    return {
        "roll": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        "pitch": np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
        "yaw": np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
    }


def draw(logs: list[Log], path: Path) -> None:
    """Write one picture with a panel per quantity and a line per log."""
    figure, grid = plt.subplots(3, 3, figsize=(15, 9), sharex=True, layout="constrained")
    end = min(log.series("vehicle_local_position", "x")[0][-1] for log in logs)
    for axes, (title, topic, field, setpoint) in zip(grid.T.flat, PANELS, strict=True):
        for log, (color, width) in zip(logs, LINES, strict=True):
            axes.plot(*log.series(topic, field), color=color, linewidth=width, label=log.name)
            if setpoint:
                axes.plot(*log.series(setpoint, field), color=color, linewidth=0.9, linestyle=":")
        axes.set(title=title, xlim=(0, end))
        axes.grid(alpha=0.3)
    for axes in grid[-1]:
        axes.set_xlabel("time since arming [s]")
    grid[0, 0].plot([], [], color="gray", linestyle=":", label="setpoints")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    figure.savefig(path, dpi=100)


def difference_m(logs: list[Log]) -> float:
    """Return the rms distance of the two positions [m], from 5 s after arming to the end of the shorter flight."""
    times = [log.series("vehicle_local_position", "x")[0] for log in logs]
    t = np.arange(5.0, min(each[-1] for each in times), 0.05)
    places = [
        np.stack([np.interp(t, *log.series("vehicle_local_position", axis)) for axis in "xyz"])
        for log in logs
    ]
    return float(np.sqrt(((places[0] - places[1]) ** 2).sum(0).mean()))


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("first", type=Path)
    options.add_argument("second", type=Path)
    options.add_argument("-o", "--output", type=Path, default=Path("overlay.png"))
    given = options.parse_args()
    logs = [Log.read(given.first), Log.read(given.second)]
    draw(logs, given.output)
    print(f"{given.output}: the positions differ by {difference_m(logs):.3f} m (rms)")


if __name__ == "__main__":
    main()
