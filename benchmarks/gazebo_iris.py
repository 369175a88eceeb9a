"""Compare the profile `iris` with the Gazebo flights of the thesis: delay of roll and pitch, and horizontal drag.

    python benchmarks/gazebo_iris.py [--data FOLDER]

Delay: the shift in time at which the attitude setpoint and the attitude differ least (root mean square). Drag:
the slope of the horizontal specific force against the horizontal velocity, both in body axes.

Gazebo: the four flights of the thesis's formation experiment, logged at 30 Hz. Ours: one vehicle with the
built-in autopilot, the profile and its parameters, on a slow Lissajous figure in still air. Its delay is given
three times: from all samples (250 Hz), from samples of 31 Hz, and with the setpoint held for 100 ms, because
the log of `arena` contains setpoints at 10 Hz. The data are not part of this project.
"""

from __future__ import annotations

import argparse
import csv
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import world as bench
from numpy.typing import NDArray

from arena.geometry import euler_from_quat, matrix_from_quat

Array = NDArray[np.float64]
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "thesis"
LOWEST_M = 0.6
GRID_S = 0.004


def delay_ms(t: Array, setpoint: Array, seen: Array) -> float:
    """Return the delay of `seen` behind `setpoint` [ms], found in steps of 4 ms."""
    grid = np.arange(t[0], t[-1], GRID_S)
    a, b = np.interp(grid, t, setpoint), np.interp(grid, t, seen)
    errors = [float(np.std(b[k:] - a[: len(a) - k])) for k in range(100)]
    return float(np.argmin(errors)) * GRID_S * 1e3


def drag_per_s(v_b: Array, accel_b: Array) -> list[float]:
    """Return the drag along x and y per mass [1/s]. v_b, accel_b: (n, 3)"""
    return [-float(np.polyfit(v_b[:, axis], accel_b[:, axis], 1)[0]) for axis in (0, 1)]


def line(name: str, delays: Any, drags: Any = None) -> str:
    drag = "" if drags is None else " / ".join(f"{x:.2f}" for x in drags)
    return f"| {name} | {' / '.join(f'{x:.0f}' for x in delays)} | {drag} |"


def gazebo(path: Path) -> str:
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["info.flight_mode"] == "OFFBOARD"]
    rows = [row for row in rows if row["att_euler_ref.roll"] and -float(row["ekf.pos.down"]) > LOWEST_M]

    def columns(group: str, names: str) -> Array:
        return np.array([[float(row[f"{group}.{name}"]) for name in names.split()] for row in rows])

    t = np.array([float(row["time.seconds"]) for row in rows])
    wanted, seen = columns("att_euler_ref", "roll pitch"), columns("ekf.att_euler", "roll pitch")
    r_nb = matrix_from_quat(columns("ekf.att_q", "w x y z"))
    v_b = (columns("ekf.vel", "north east down")[:, None, :] @ r_nb)[:, 0]
    delays = [delay_ms(t, wanted[:, k], seen[:, k]) for k in (0, 1)]
    return line(path.stem, delays, drag_per_s(v_b, columns("imu.acc_body", "north east down")))


def ours() -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        fleet = bench.Fleet(bench.settings(1, Path(folder)))
    fleet.take_off()
    control, start, rows = fleet.autopilots.cascade, fleet.start_p_n[0].copy(), []
    for k in range(10_000):
        s = 0.004 * k
        swing = np.array([0.8 * math.sin(0.9 * s), 0.6 * math.sin(1.3 * s), 0.15 * math.sin(0.5 * s)])
        fleet.start_p_n[0] = start + swing
        fleet.step()
        truth = fleet.world.truth()
        v_b = truth.v_n[0] @ fleet.world.bodies.r_nb[0]
        angles = [*euler_from_quat(control.q_sp[0])[:2], *euler_from_quat(truth.q_nb[0])[:2]]
        rows.append([s, *angles, *v_b, *truth.accel_b[0]])
    fleet.close()
    found = np.array(rows)[1000:]

    def delays(every: int, hold: int) -> list[float]:
        at = np.arange(0, len(found), every)
        return [delay_ms(found[at, 0], found[at // hold * hold, 1 + k], found[at, 3 + k]) for k in (0, 1)]

    return [
        line("ours, 250 Hz", delays(1, 1), drag_per_s(found[:, 5:8], found[:, 8:11])),
        line("ours, samples at 31 Hz", delays(8, 1)),
        line("ours, setpoint held for 100 ms", delays(1, 25)),
    ]


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--data", type=Path, default=DATA, metavar="FOLDER")
    files = sorted(options.parse_args().data.glob("formation_gazebo_*.csv"))
    print("| flight | delay of roll / pitch ms | drag along x / y per s |\n|---|---|---|")
    print("\n".join([gazebo(path) for path in files] + ours()))


if __name__ == "__main__":
    main()
