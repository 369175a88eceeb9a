"""Obstacles in the world: a vehicle that flies into one touches it where it is drawn, has crashed, and does not pass through."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arena.obstacles import Obstacle

from .sim_slices import vehicle
from .test_hand_over import LEVEL, TILTED, compared, hover

BOX = Obstacle(
    name="box", shape="box", size_m=(1.0, 0.4, 2.0), centre_n=(3.0, 0.0, -2.5), rpy_rad=(0.1, 0.0, 0.6)
)
POLE = Obstacle(name="pole", shape="cylinder", size_m=(0.4, 0.4, 3.0), centre_n=(3.0, 0.1, -2.5))
BALL = Obstacle(name="ball", shape="sphere", size_m=(0.8, 0.8, 0.8), centre_n=(3.0, -0.1, -2.4))
LYING = Obstacle(
    name="lying", shape="cylinder", size_m=(0.5, 0.5, 2.0), centre_n=(3.0, 0.0, -2.5), rpy_rad=(1.5, 0.0, 0.3)
)
START = np.array([0.5, 0.0, -2.5])


def crash_of(build, obstacles, start=START, speed=3.0, seconds=1.5):
    """Return the crash and the last position of a vehicle that flies north at this speed [m/s]."""
    world = build(vehicle(position=start.tolist()), obstacles=[o.slice() for o in obstacles])
    world.bodies.place(0, p_n=start, q_nb=LEVEL, v_n=np.array([speed, 0.0, 0.0]))
    motors = np.repeat(world.hover[:, None], world.rotors, axis=1)
    for _ in range(round(seconds / world.period_s)):
        world.step(motors)
    return world.flights()["uav1"]["crashed"], world.bodies.p_n[0]


@pytest.mark.parametrize("obstacle", [BOX, POLE, BALL, LYING], ids=lambda o: o.name)
def test_vehicle_that_flies_into_an_obstacle_has_crashed(build, obstacle):
    crashed, p_n = crash_of(build, [obstacle])
    assert f"touched the obstacle {obstacle.name} at" in crashed
    assert p_n[0] < 3.0, "it did not pass"


@pytest.mark.parametrize("obstacle", [BOX, POLE, BALL, LYING], ids=lambda o: o.name)
def test_first_contact_is_at_the_drawn_surface(build, obstacle):
    """Three flights from the south: at the moment of contact the drawn body is at the vehicle's hull."""
    world = build(vehicle(position=START.tolist()), obstacles=[obstacle.slice()])
    for side in (-0.2, 0.0, 0.2):
        start = START + np.array([0.0, side, 0.0])
        world.bodies.place(0, p_n=start, q_nb=LEVEL, v_n=np.array([2.0, 0.0, 0.0]))
        motors = np.repeat(world.hover[:, None], world.rotors, axis=1)
        for _ in range(500):
            world.step(motors)
            if 0 in world.bodies.contacts().others:
                break
        p_n = world.bodies.p_n[0].copy()
        gap = np.linalg.norm(_nearest_of_hull(obstacle, p_n))
        assert gap < 0.03, (side, p_n)


def _nearest_of_hull(obstacle, p_n):
    """Return the way from the hull of the test's vehicle (radius 0.275 m, height 0.1 m) to the obstacle."""
    other = np.array(obstacle.centre_n)
    for _ in range(300):
        mine = other - p_n
        mine[:2] *= min(1.0, 0.275 / max(np.hypot(*mine[:2]), 1e-9))
        mine[2] = np.clip(mine[2], -0.05, 0.05)
        other = obstacle.nearest(p_n + mine)
    return other - (p_n + mine)


def test_vehicle_passes_beside_an_obstacle_without_contact(build):
    crashed, p_n = crash_of(build, [BOX], start=START + np.array([0.0, 1.3, 0.0]))
    assert crashed == "" and p_n[0] > 4.0


@pytest.mark.parametrize("speed", [0.8, 4.0, 25.0])
@pytest.mark.parametrize("obstacle", [BOX, BALL], ids=lambda o: o.name)
def test_impact_is_the_same_as_with_pybullet_alone(build, obstacle, speed):
    """The free flight hands the vehicle over in time, also at 25 m/s."""

    def fly(flight):
        flight.world.bodies.place(0, p_n=START, q_nb=TILTED, v_n=np.array([speed, 0.0, 0.0]))
        flight.fly(hover(flight), 2.1 / speed)

    flight = compared(
        lambda: build(vehicle(position=START.tolist()), obstacles=[obstacle.slice()]), fly, 1e-6
    )
    assert flight.changes()[:2] == [[], [0]]


def test_vehicle_far_from_all_obstacles_is_in_free_flight(build):
    def fly(flight):
        flight.world.bodies.place(0, p_n=START, q_nb=LEVEL)
        flight.fly(hover(flight), 0.5)

    flight = compared(lambda: build(vehicle(position=START.tolist()), obstacles=[BOX.slice()]), fly, 1e-6)
    assert flight.changes() == [[]]


def test_obstacles_collide_without_compiled_kernels():
    code = (
        "import arena.kernels, numpy as np\n"
        "assert arena.kernels.INTERPRETED is not None\n"
        "from arena.sim.world import World\n"
        "from tests.sim import sim_slices, test_obstacles as t\n"
        "crashed, p_n = t.crash_of(lambda *v, **k: World(sim_slices.slice_of(*v, **k)), [t.POLE], speed=6.0, seconds=0.6)\n"
        "assert 'touched the obstacle pole' in crashed, crashed"
    )
    root = Path(__file__).parents[2]
    env = {"ARENA_INTERPRETED": "1", "PYTHONPATH": f"{root}:{root / 'tests'}"}
    subprocess.run([sys.executable, "-c", code], check=True, env=env, cwd=root)
