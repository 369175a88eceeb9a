"""pybullet bodies in our conventions, at generic attitudes: a level, nose-north test misses most of the classic mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.geometry import matrix_from_quat, quat_from_euler, quat_multiply
from arena.sim.bodies import Bodies
from arena.sim.pybullet_room import display_answers
from arena.sim.vehicle_arrays import read_fleet
from arena.sim.world import World

from .sim_slices import PROFILE, slice_of, vehicle

GENERIC = quat_from_euler(np.radians([10.0, -20.0, 35.0]))
H = 0.002
ALOFT = np.array([1.0, -0.5, -3.0])


@pytest.fixture(params=[False, True], ids=["free", "pybullet"])
def bodies(request):
    made = Bodies(read_fleet([vehicle()]), size_m=[12, 8, 8], step_s=H, period_s=H)
    made._only_pybullet = request.param
    yield made
    made.close()


def step(bodies, force_b=(0.0, 0.0, 0.0), torque_b=(0.0, 0.0, 0.0)):
    bodies.begin(np.zeros((1, 3)))
    bodies.step(np.array([force_b]), np.array([torque_b]))


def test_a_placed_body_is_read_back_where_it_was_placed(bodies):
    v_n, omega_b = np.array([0.3, -0.4, 0.5]), np.array([0.7, -1.1, 1.9])
    bodies.place(0, p_n=ALOFT, q_nb=GENERIC, v_n=v_n, omega_b=omega_b)
    assert bodies.p_n[0] == pytest.approx(ALOFT)
    assert bodies.q_nb[0] * np.sign(bodies.q_nb[0, 0]) == pytest.approx(GENERIC)
    assert bodies.r_nb[0] == pytest.approx(matrix_from_quat(GENERIC))
    assert bodies.v_n[0] == pytest.approx(v_n)
    assert bodies.omega_b[0] == pytest.approx(omega_b)


def test_velocity_and_body_rate_integrate_to_position_and_attitude(bodies):
    omega_b = np.array([0.7, -1.1, 0.9])
    bodies.place(0, p_n=ALOFT, q_nb=GENERIC, v_n=np.array([1.0, 2.0, -0.5]), omega_b=omega_b)
    step(bodies)
    assert (bodies.p_n[0] - ALOFT) / H == pytest.approx([1.0, 2.0, -0.5 + GRAVITY_M_S2 * H])
    half = np.array([1.0, *(0.5 * omega_b * H)])
    expected = quat_multiply(GENERIC, half / np.linalg.norm(half))
    assert bodies.q_nb[0] * np.sign(bodies.q_nb[0, 0]) == pytest.approx(expected, abs=5e-6)


def test_a_force_acts_in_body_axes_on_the_given_mass(bodies):
    force_b = np.array([1.0, 2.0, -3.0])
    bodies.place(0, p_n=ALOFT, q_nb=GENERIC)
    step(bodies, force_b)
    expected = matrix_from_quat(GENERIC) @ force_b / PROFILE["mass_kg"] + [0, 0, GRAVITY_M_S2]
    assert bodies.v_n[0] / H == pytest.approx(expected)
    assert bodies.omega_b[0] == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_torque_acts_in_body_axes_on_the_given_inertia(bodies):
    torque_b = np.array([0.1, -0.2, 0.3])
    bodies.place(0, p_n=ALOFT, q_nb=GENERIC)
    step(bodies, torque_b=torque_b)
    assert bodies.omega_b[0] / H == pytest.approx(torque_b / PROFILE["inertia_kg_m2"], rel=1e-3)


def test_a_wrench_lasts_one_step(bodies):
    bodies.place(0, p_n=ALOFT, q_nb=GENERIC)
    step(bodies, (5.0, 0.0, 0.0))
    v_n = bodies.v_n[0].copy()
    step(bodies)
    assert bodies.v_n[0] - v_n == pytest.approx([0.0, 0.0, GRAVITY_M_S2 * H])


def test_nothing_damps_a_fall_or_a_spin(bodies):
    bodies.place(
        0,
        p_n=np.array([0, 0, -100.0]),
        q_nb=GENERIC,
        v_n=np.array([3.0, 0, 0]),
        omega_b=np.array([0, 0, 4.0]),
    )
    for _ in range(500):
        step(bodies)
    assert bodies.v_n[0] == pytest.approx([3.0, 0.0, GRAVITY_M_S2], rel=1e-9)
    assert bodies.omega_b[0] == pytest.approx([0, 0, 4.0], abs=1e-6)


def test_gui_without_a_display_is_refused(monkeypatch):
    monkeypatch.setenv("DISPLAY", "")
    with pytest.raises(InputError, match="--gui needs an X display"):
        World(slice_of(gui=True))


@pytest.mark.parametrize("display", ["", "nonsense", ":", ":x", ":4217", "127.55.0.9:217.0"])
def test_a_missing_display_does_not_answer(display):
    assert not display_answers(display)
