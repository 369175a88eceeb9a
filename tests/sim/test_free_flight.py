"""Vehicles in free flight move without pybullet, as pybullet would move them, bit for bit."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from arena.sim.bodies import Bodies
from arena.sim.vehicle_arrays import read_fleet

from .sim_slices import vehicle

Array = NDArray[np.float64]
VEHICLES = 40
# On other processors a compiler may round a * b + c once, where this one rounds twice.
SAME_ROUNDING = platform.machine() == "x86_64"


def fleet_of(count: int) -> Any:
    """Return vehicles of different mass and inertia, far from each other."""
    fleet = []
    for k in range(count):
        fleet.append(vehicle(f"uav{k}", k + 1, position=[20.0 * k, 0.0, 0.0]))
        fleet[k]["profile"] |= {
            "mass_kg": 0.03 + 0.3 * k,
            "inertia_kg_m2": [1e-5 + 0.01 * k, 2e-5 + 0.012 * k, 3e-5 + 0.02 * k],
        }
    return read_fleet(fleet)


@pytest.fixture
def build() -> Iterator[Callable[..., Bodies]]:
    made: list[Bodies] = []

    def make(count: int, h: float, *, only_pybullet: bool) -> Bodies:
        bodies = Bodies(fleet_of(count), size_m=[4e4, 4e4, 4e4], step_s=h, period_s=2 * h)
        bodies._only_pybullet = only_pybullet
        made.append(bodies)
        return bodies

    yield make
    for bodies in made:
        bodies.close()


def scatter(bodies: Bodies, rng: np.random.Generator) -> None:
    """Place the vehicles in the air, far from each other, with random attitudes and velocities."""
    for k in range(len(bodies.p_n)):
        attitude = rng.normal(size=4)
        bodies.place(
            k,
            p_n=np.array([rng.normal(), 900.0 * (k - 20), -18000.0]),
            q_nb=attitude / np.linalg.norm(attitude),
            v_n=rng.normal(0.0, 10.0, 3),
            omega_b=rng.normal(0.0, (1e-4, 3.0, 30.0)[k % 3], 3),
        )


@pytest.mark.parametrize("h", [0.001, 0.002, 0.004, 0.02])
def test_free_flight_equals_pybullet_bit_for_bit(build: Callable[..., Bodies], h: float) -> None:
    """4 x 40 random starts, 100 steps each: 16000 states. At 0.02 s the largest turns in one step are limited."""
    free, theirs = build(VEHICLES, h, only_pybullet=False), build(VEHICLES, h, only_pybullet=True)
    for bodies in (free, theirs):
        scatter(bodies, np.random.default_rng(5))
    rng, still = np.random.default_rng(7), np.zeros((VEHICLES, 3))
    for k in range(100):
        force_b, torque_b = rng.normal(0.0, 10.0, still.shape), rng.normal(0.0, 0.2, still.shape)
        for bodies in (free, theirs):
            if k % 2 == 0:
                bodies.begin(still)
            bodies.step(force_b, torque_b)
        assert free.in_pybullet == [] and len(theirs.in_pybullet) == VEHICLES
        # pybullet keeps quaternions, but returns the attitude by way of a matrix, which rounds it.
        same = np.abs((free.q_nb * theirs.q_nb).sum(1))
        assert np.abs(same - 1.0).max() < 1e-15 if SAME_ROUNDING else 1e-9
        states = [np.hstack([b.p_n, b.v_n, b._state.rate]) for b in (free, theirs)]
        if SAME_ROUNDING:
            np.testing.assert_array_equal(*states)
        else:
            np.testing.assert_allclose(*states, rtol=0.0, atol=1e-9 * (k + 1))
