"""Microseconds per step of the world's core, by the number of vehicles: `python benchmarks/world.py`.

One step is a sensor period: two physics steps at 500 Hz, every sensor, the truth and the verdicts; no
sockets, no autopilots. Vehicles hover, then stand on the floor, which costs bullet its contacts.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from arena.sim.world import World

PROFILE = yaml.safe_load((Path(__file__).parents[1] / "profiles" / "iris.yaml").read_text())
COUNTS = (1, 10, 50, 200)
LEAST_S = 0.5


def settings(count: int, height_m: float) -> dict[str, Any]:
    side = int(np.ceil(np.sqrt(count)))
    vehicles = [
        {
            "name": f"uav{k + 1}",
            "id": k + 1,
            "profile": PROFILE,
            "position": [k % side - side / 2, k // side - side / 2, -height_m],
        }
        for k in range(count)
    ]
    return {"seed": 1, "size_m": [side + 5, side + 5, 50], "physics_hz": 500, "sensor_hz": 250, "vehicles": vehicles}


def measure(count: int, *, flying: bool) -> tuple[float, float]:
    """Time per step, and of it in pybullet [us]. The vehicles hover open loop, so they are put back before
    they drift away.
    """
    world = World(settings(count, 10.0 if flying else 0.0))
    motors = np.repeat(world.fleet.hover[:, None] * (1.0 if flying else 0.1), world.fleet.rotors, axis=1)
    inside = [0.0]
    step, contacts = world.bodies.step, world.bodies.contacts

    def timed(call: Any) -> Any:
        def run(*args: Any) -> Any:
            began = time.perf_counter()
            result = call(*args)
            inside[0] += time.perf_counter() - began
            return result

        return run

    world.bodies.step, world.bodies.contacts, world.bodies.push = timed(step), timed(contacts), timed(world.bodies.push)  # type: ignore[method-assign]
    for _ in range(20):
        world.step(motors)
    inside[0], steps, began = 0.0, 0, time.perf_counter()
    while (took := time.perf_counter() - began) < LEAST_S:
        world.sense()
        world.step(motors)
        world.truth()
        steps += 1
    world.close()
    return took / steps * 1e6, inside[0] / steps * 1e6


def main() -> None:
    print(f"{'vehicles':>8} {'flying us':>10} {'pybullet':>9} {'numpy':>7} {'standing us':>12} {'x real time':>12}")
    for count in COUNTS:
        (flying, bullet), (standing, _) = measure(count, flying=True), measure(count, flying=False)
        print(f"{count:8d} {flying:10.0f} {bullet:9.0f} {flying - bullet:7.0f} {standing:12.0f} {4000 / flying:12.1f}")


if __name__ == "__main__":
    main()
