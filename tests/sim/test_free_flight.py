"""Free flight in pybullet is one explicit formula: asserted here, so that it can replace pybullet away from contacts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.geometry import matrix_from_quat, quat_from_euler, quat_multiply
from arena.sim.bodies import Bodies
from arena.sim.vehicle_arrays import read_fleet

from .sim_slices import PROFILE, vehicle

Array = NDArray[np.float64]
H = 0.002
GRAVITY_N = np.array([0.0, 0.0, GRAVITY_M_S2])
MASS, INERTIA = PROFILE["mass_kg"], np.array(PROFILE["inertia_kg_m2"])


@dataclass(kw_only=True)
class State:
    """Position and velocity [m, m/s] [NED], attitude, and angular velocity [rad/s] [NED] of one body."""

    p_n: Array
    v_n: Array
    q_nb: Array
    omega_n: Array


def free_flight(x: State, force_b: Array, torque_b: Array, h: float) -> State:
    """Return the state after one step of pybullet's integration of a body without contacts.

    1. The wrench and the gyroscopic torque -omega x (I omega) are those at the begin of the step.
    2. Velocities get the acceleration times h; this is the semi-implicit Euler method.
    3. The position moves with the new velocity.
    4. The attitude turns about the new angular velocity, by the exact rotation of angle |omega| h.
    """
    r_nb = matrix_from_quat(x.q_nb)
    omega_b = r_nb.T @ x.omega_n
    v_n = x.v_n + h * (r_nb @ force_b / MASS + GRAVITY_N)
    spin_b = (torque_b - np.cross(omega_b, INERTIA * omega_b)) / INERTIA
    omega_n = x.omega_n + h * (r_nb @ spin_b)
    rate = float(np.linalg.norm(omega_n))
    half = 0.5 * rate * h
    turn = np.array([math.cos(half), *(omega_n * (math.sin(half) / rate if rate else 0.5 * h))])
    q_nb = quat_multiply(turn, x.q_nb)
    return State(p_n=x.p_n + h * v_n, v_n=v_n, q_nb=q_nb / np.linalg.norm(q_nb), omega_n=omega_n)


@pytest.fixture
def start() -> Any:
    made: list[Bodies] = []

    def make(x: State, h: float = H) -> Bodies:
        bodies = Bodies(read_fleet([vehicle()]), size_m=[400, 400, 400], step_s=h)
        made.append(bodies)
        bodies.place(0, p_n=x.p_n, q_nb=x.q_nb, v_n=x.v_n, omega_b=matrix_from_quat(x.q_nb).T @ x.omega_n)
        return bodies

    yield make
    for bodies in made:
        bodies.close()


def begin(omega_n: Any) -> State:
    return State(
        p_n=np.array([1.0, -0.5, -150.0]),
        v_n=np.array([3.0, -2.0, -4.0]),
        q_nb=quat_from_euler(np.radians([10.0, -20.0, 35.0])),
        omega_n=np.array(omega_n, float),
    )


@pytest.mark.parametrize("h", [0.002, 0.004])
@pytest.mark.parametrize(
    "omega_n", [(0.0, 0.0, 0.0), (1e-4, 0.0, 2e-4), (2.0, -3.0, 5.0), (20.0, -30.0, 10.0)]
)
def test_free_flight_is_the_formula(start: Callable[..., Bodies], omega_n: Any, h: float) -> None:
    x, rng = begin(omega_n), np.random.default_rng(3)
    bodies = start(x, h)
    for k in range(500):
        force_b, torque_b = rng.normal(0.0, 10.0, 3), rng.normal(0.0, 0.2, 3)
        bodies.apply_wrenches(force_b[None], torque_b[None])
        bodies.step()
        x = free_flight(x, force_b, torque_b, h)
        within = 1e-12 * (k + 10)  # rounding adds up
        assert bodies.p_n[0] == pytest.approx(x.p_n, rel=0, abs=100 * within)
        assert bodies.v_n[0] == pytest.approx(x.v_n, rel=0, abs=10 * within)
        assert bodies.q_nb[0] * np.sign(bodies.q_nb[0] @ x.q_nb) == pytest.approx(x.q_nb, rel=0, abs=within)
        omega_b = matrix_from_quat(x.q_nb).T @ x.omega_n
        assert bodies.omega_b[0] == pytest.approx(omega_b, rel=0, abs=10 * within)
