"""While vehicles stand still with stopped motors, pybullet is not called, and they do not move until something acts on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.sim.world import World

from .sim_slices import vehicle

Array = NDArray[np.float64]
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
TILTED = np.array([0.98, 0.1, -0.12, 0.05]) / np.linalg.norm([0.98, 0.1, -0.12, 0.05])
Build = Callable[..., World]


def steps_of_pybullet(world: World, seconds: float, command: float = 0.0, row: int = 0) -> int:
    """Step a world and return the number of physics steps that pybullet computed.

    command: motor command of the vehicle in this row; the motors of all others are stopped
    """
    calls = []
    inner = world.bodies._room.step
    world.bodies._room.step = lambda *given: calls.append(1) or inner(*given)
    motors = np.zeros((world.fleet.size, world.rotors))
    motors[row] = command
    for _ in range(round(seconds / world.period_s)):
        world.step(motors)
    world.bodies._room.step = inner
    return len(calls)


def standing(build: Build, *vehicles: dict[str, Any], **changes: Any) -> World:
    world = build(*(vehicles or [vehicle()]), **changes)
    steps_of_pybullet(world, 1.0)
    assert steps_of_pybullet(world, 0.1) == 0, "all vehicles stand still"
    return world


def test_standing_vehicle_needs_no_pybullet_and_does_not_move(build: Build) -> None:
    world = standing(build)
    before = world.truth()
    assert steps_of_pybullet(world, 20.0) == 0
    now = world.truth()
    assert np.array_equal(now.p_n, before.p_n) and np.array_equal(now.q_nb, before.q_nb)
    assert not now.v_n.any() and not now.omega_b.any()
    assert now.accel_b[0] == pytest.approx([0.0, 0.0, -GRAVITY_M_S2], abs=1e-3)
    assert world.bodies.contacts().floor.all()


def test_take_off_after_a_standstill_is_that_of_pybullet(build: Build) -> None:
    heights = []
    for only_pybullet in (False, True):
        world = build(vehicle())
        world.bodies._only_pybullet = only_pybullet
        stands = steps_of_pybullet(world, 2.0) < 500
        assert stands is not only_pybullet
        steps_of_pybullet(world, 1.0, float(1.1 * world.hover[0]))
        heights.append(-world.truth().p_n[0, 2])
    assert heights[0] > 0.3 and heights[0] == pytest.approx(heights[1], abs=1e-3)


def test_motor_command_ends_a_standstill_at_once(build: Build) -> None:
    world = standing(build)
    assert steps_of_pybullet(world, world.period_s, 0.01) == 2


def test_spinning_rotors_are_no_standstill(build: Build) -> None:
    world = standing(build)
    steps_of_pybullet(world, 0.2, 0.3)
    assert steps_of_pybullet(world, 0.1) == 50, "the rotors still turn"


def test_vehicle_that_is_hit_moves(build: Build) -> None:
    world = standing(build, vehicle("uav1", position=[0, 0, 0]), vehicle("uav2", id=2, position=[3, 0, 0]))
    stood = world.truth().p_n[0].copy()
    world.bodies.place(1, p_n=stood - np.array([1.2, 0.0, 0.02]), q_nb=LEVEL, v_n=np.array([4.0, 0.0, 0.0]))
    steps_of_pybullet(world, 1.0)
    assert world.truth().p_n[0, 0] > stood[0] + 0.05, "pushed north"


def test_nothing_is_held_in_the_air(build: Build) -> None:
    """A vehicle beside a wall is in pybullet. At its highest point its velocity is zero."""
    world = build(vehicle())
    for start in (np.array([5.7, 0.0, -2.0]), world.truth().p_n[0] + [0.0, 0.0, -0.1]):
        world.bodies.place(0, p_n=start, q_nb=LEVEL)
        assert steps_of_pybullet(world, 0.15) > 50, "near the wall or the floor"
        assert world.truth().p_n[0, 2] > start[2] + 0.05


def test_falling_vehicle_settles_before_its_standstill(build: Build) -> None:
    world = build(vehicle())
    world.bodies.place(0, p_n=np.array([0.0, 0.0, -0.5]), q_nb=TILTED)
    steps_of_pybullet(world, 4.0)
    assert steps_of_pybullet(world, 0.1) == 0
    assert abs(world.bodies.r_nb[0, 2, 2]) > 0.999, "flat on the floor"


def test_other_wind_ends_a_standstill_and_strong_wind_moves(build: Build) -> None:
    world = standing(build, vehicle(body_drag_kg_m=[0.05, 0.05, 0.05]))
    world.set_wind([0.0, 3.0, 0.0])
    assert steps_of_pybullet(world, 0.04) == 20
    world.set_wind([0.0, 60.0, 0.0])
    steps_of_pybullet(world, 2.0)
    assert world.truth().p_n[0, 1] > 0.1, "blown east"


def test_standstill_needs_all_vehicles(build: Build) -> None:
    world = standing(build, vehicle("uav1", position=[0, 0, 0]), vehicle("uav2", id=2, position=[3, 0, 0]))
    assert steps_of_pybullet(world, 0.1, 0.2, row=1) == 50
