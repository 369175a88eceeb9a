"""Benchmark of the kernels: CPU time of one step of each part of the autopilot and the world, by the number of vehicles.

    python benchmarks/kernels.py [--counts 1 10 50] [--rounds 7] [--before CHECKOUT]

Each part runs with compiled kernels, with their Python source (ARENA_INTERPRETED=1), and with `--before` in a checkout of
an older commit, such as the last one without kernels. The versions alternate, each in a process of its own. A figure is
the least CPU time of a step among all rounds, so that other processes of the computer hardly change it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
STEPS = 100


def control(count: int) -> Callable[[], object]:
    """Return a step of all controllers and of the control allocation, for vehicles that hold a position."""
    from arena.autopilot.control.control_allocator import ControlAllocator
    from arena.autopilot.control.controllers import Cascade
    from arena.autopilot.control.setpoints import Setpoints
    from arena.autopilot.estimation.estimator import Estimator
    from arena.autopilot.param_table import Params
    from arena.vehicle_models import VEHICLE_MODELS

    places = ((0.2, 0.2, "ccw"), (-0.2, -0.2, "ccw"), (0.2, -0.2, "cw"), (-0.2, 0.2, "cw"))
    rotors = [{"position_m": [x, y, 0.0], "direction": turn} for x, y, turn in places]
    weights = np.tile(VEHICLE_MODELS["multirotor"].allocation(rotors), (count, 1, 1))
    params, setpoints = Params(count), Setpoints(count)
    estimator, cascade = Estimator(params, count, 0.004), Cascade(params, count, 0.004)
    allocator = ControlAllocator(weights, np.ones((count, 4), bool))
    for i in range(count):
        setpoints.set_position(i, p_n=(0.1, 0.2, -1.0), v_n=(0.0, 0.0, 0.0), yaw=0.3)

    def step() -> None:
        torque, thrust = cascade.update(setpoints, estimator)
        _, cascade.saturated[:] = allocator.allocate(torque, thrust)

    return step


def prediction(count: int) -> Callable[[], object]:
    """Return a step of the estimator with one IMU sample."""
    from arena.autopilot.estimation.estimator import Estimator
    from arena.autopilot.param_table import Params

    estimator = Estimator(Params(count), count, 0.004)
    accel_b, gyro_b = np.tile([0.0, 0.0, -9.8], (count, 1)), np.full((count, 3), 0.01)
    return lambda: estimator.predict(accel_b, gyro_b)


def vision(count: int) -> Callable[[], object]:
    """Return the fusion of one pose of every vehicle."""
    from arena.autopilot.estimation.estimator import Estimator
    from arena.autopilot.param_table import Params

    params = Params(count)
    for i in range(count):
        params.set(i, "EKF2_EV_CTRL", 11)
    estimator = Estimator(params, count, 0.004)
    for _ in range(10):
        estimator.predict(np.tile([0.0, 0.0, -9.8], (count, 1)), np.zeros((count, 3)))
    level = (1.0, 0.0, 0.0, 0.0)

    def fuse() -> None:
        for i in range(count):
            estimator.vision_input.receive(i, (0.0, 0.0, 0.0), level, (1e-6, 1e-6, 1e-6), 1e-4)
        estimator.fuse_vision(1.0)

    return fuse


def rotors(count: int) -> Callable[[], object]:
    """Return a physics step of the rotors in hover."""
    from arena.schema.library import load_profile
    from arena.vehicle_models.multirotor_dynamics import Rotors

    profile = load_profile("iris").model_dump(exclude_none=True)
    every = Rotors([profile] * count, step_s=0.002)
    motors, air_b, height = np.full((count, 4), 0.5), np.full((count, 3), 0.1), np.full(count, 2.0)
    return lambda: every.step(motors, air_b, height)


PARTS: dict[str, Callable[[int], Callable[[], object]]] = {
    "control": control,
    "prediction": prediction,
    "vision": vision,
    "rotors": rotors,
}


def measure(count: int) -> dict[str, float]:
    """Return the least CPU time of a step of each part in this process [us]."""
    found = {}
    for name, prepare in PARTS.items():
        step = prepare(count)
        step()
        began = time.process_time()
        for _ in range(STEPS):
            step()
        found[name] = (time.process_time() - began) / STEPS * 1e6
    return found


def measured(checkout: Path, count: int, **environment: str) -> dict[str, float]:
    """Return the result of `measure` in a new process that imports arena from a checkout [us]."""
    run = subprocess.run(
        [sys.executable, __file__, "--measure", str(count)],
        env={**os.environ, "PYTHONPATH": str(checkout), **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(run.stdout)


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--counts", type=int, nargs="+", default=[1, 10, 50])
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--before", type=Path, metavar="CHECKOUT", help="folder of an older commit")
    options.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.measure:
        print(json.dumps(measure(given.measure)))
        return
    from arena.kernels import INTERPRETED

    versions = {"interpreted": (ROOT, {"ARENA_INTERPRETED": "1"})}
    if INTERPRETED:
        print(INTERPRETED, file=sys.stderr)
    else:
        versions = {"compiled": (ROOT, {}), **versions}
    if given.before:
        versions["before"] = (given.before.resolve(), {})
    print(f"| part | vehicles | {' | '.join(f'{name} µs' for name in versions)} |")
    print("|---|---:|" + "---:|" * len(versions))
    for count in given.counts:
        rounds = [
            {name: measured(folder, count, **environment) for name, (folder, environment) in versions.items()}
            for _ in range(given.rounds)
        ]
        for part in PARTS:
            least = (min(each[name][part] for each in rounds) for name in versions)
            print(f"| {part} | {count} | {' | '.join(f'{us:.1f}' for us in least)} |")


if __name__ == "__main__":
    main()
