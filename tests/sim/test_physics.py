"""Physics of multirotors: drag takes energy, rotors lag, ground effect, battery voltage under load."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arena.geometry import quat_from_euler
from arena.sim.battery import Battery
from arena.vehicle_models.ground_effect import REACH, ground_share, ground_table
from arena.vehicle_models.multirotor_dynamics import Rotors

from .sim_slices import PROFILE, vehicle

H = 0.002
RADIUS = 0.127
FAR = np.array([100.0])
GROUND = {"rotor_radius_m": RADIUS, "body_lift": 2.0}
PLACES = np.array([r["position_m"][:2] for r in PROFILE["rotors"]])
AIR = st.lists(st.floats(-8.0, 8.0), min_size=3, max_size=3).map(np.array)


def profile_of(**changes: Any) -> dict[str, Any]:
    return {**vehicle()["profile"], **changes}


def rotors_of(profile: dict[str, Any], command: float) -> Rotors:
    """Return rotors that have reached the command."""
    rotors = Rotors([profile], step_s=H)
    rotors.spin[:] = command
    return rotors


def force_of(profile: dict[str, Any], air_b: Any, command: float | None = None, height: Any = FAR) -> Any:
    """Return the force [N] [FRD] (3,) at a steady command, by default the one of hover."""
    u = float(Rotors([profile], step_s=H).hover[0]) if command is None else command
    force, _ = rotors_of(profile, u).step(np.full((1, 4), u), np.asarray(air_b, float)[None], height)
    return force[0]


@settings(max_examples=40)
@given(air=AIR, command=st.floats(0.0, 1.0))
def test_drag_never_gives_energy(air: Any, command: float) -> None:
    profile = profile_of(drag_kg_s=[0.3, 0.4, 0.2], body_drag_kg_m=[0.01, 0.02, 0.05])
    drag = force_of(profile, air, command) - force_of(profile_of(), air, command)
    assert drag @ air <= 1e-12


def test_rotor_drag_grows_with_the_root_of_the_thrust() -> None:
    profile, air = profile_of(drag_kg_s=[0.3, 0.4, 0.0]), [1.5, -2.0, 0.0]
    assert force_of(profile, air)[:2] == pytest.approx([-0.45, 0.8], rel=1e-3)
    more = 0.9
    ratio = -force_of(profile, air, more)[2] / (PROFILE["mass_kg"] * 9.80665)
    assert force_of(profile, air, more)[:2] == pytest.approx(
        np.sqrt(ratio) * np.array([-0.45, 0.8]), rel=1e-3
    )
    assert force_of(profile, air, 0.0) == pytest.approx([0.0, 0.0, 0.0]), "rotors at rest drag nothing"


def test_body_drag_is_quadratic_along_each_axis() -> None:
    profile = profile_of(body_drag_kg_m=[0.01, 0.02, 0.05])
    assert force_of(profile, [2.0, -3.0, 1.0], 0.0) == pytest.approx([-0.04, 0.18, -0.05])


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (10.0, -20.0, 35.0), (-35.0, 15.0, 170.0)])
def test_drag_slows_a_gliding_vehicle_at_any_attitude(rpy_deg: Any, build: Any) -> None:
    world = build(vehicle(drag_kg_s=[0.3, 0.3, 0.3]))
    world.bodies.place(
        0,
        p_n=np.array([0.0, 0.0, -4.0]),
        q_nb=quat_from_euler(np.radians(rpy_deg)),
        v_n=np.array([2.0, -1.0, 0.0]),
    )
    push_n = world.bodies.r_nb[0] @ force_of(
        world.fleet.profiles[0], world.bodies.v_n[0] @ world.bodies.r_nb[0]
    )
    alone_n = world.bodies.r_nb[0] @ force_of(profile_of(), np.zeros(3))
    assert push_n - alone_n == pytest.approx([-0.6, 0.3, 0.0], abs=1e-3)


def test_rotor_lag_has_the_profiles_time_constants() -> None:
    profile = profile_of(motor_up_s=0.02, motor_down_s=0.04)
    rotors = Rotors([profile], step_s=H)
    for _ in range(10):
        rotors.step(np.full((1, 4), 0.5), np.zeros((1, 3)), FAR)
    assert rotors.spin == pytest.approx(0.5 * (1 - np.exp(-1)), rel=1e-6)
    rotors.spin[:] = 0.5
    for _ in range(10):
        rotors.step(np.zeros((1, 4)), np.zeros((1, 3)), FAR)
    assert rotors.spin == pytest.approx(0.5 * np.exp(-0.5), rel=1e-6)


def test_ground_effect_of_one_rotor_is_cheeseman_and_bennetts() -> None:
    z = np.array([0.5, 1.0, 2.0, 4.0]) * RADIUS
    assert ground_share(z, np.array([[0.0, 0.0]]), radius=RADIUS, body_lift=0.0) == pytest.approx(
        1.0 / (1.0 - (RADIUS / (4.0 * z)) ** 2)
    )


def test_ground_effect_of_a_quadrotor_is_the_papers() -> None:
    """The paper's formula for a square quadrotor, written out."""
    d, z = 0.4, np.array([0.1, 0.2, 0.5])
    b, r2 = d * np.sqrt(2.0), RADIUS**2
    square = np.array([[d, d], [-d, -d], [d, -d], [-d, d]]) / 2.0
    near, across, body = (z / (x + 4 * z * z) ** 1.5 for x in (d * d, 2 * d * d, b * b))
    paper = 1.0 / (1.0 - (RADIUS / (4 * z)) ** 2 - r2 * near - r2 / 2 * across - 2 * r2 * 2.0 * body)
    assert ground_share(z, square, radius=RADIUS, body_lift=2.0) == pytest.approx(paper)


def test_ground_effect_decreases_to_zero_with_height() -> None:
    share = ground_share(np.linspace(0.0, 3.0, 200), PLACES, radius=RADIUS, body_lift=2.0)
    assert np.all(np.diff(share) <= 0.0)
    assert 1.2 < share[0] < 1.5
    profile = profile_of(ground_effect=GROUND)
    thrusts = [
        -force_of(profile, [0, 0, 0], height=np.array([z]))[2]
        for z in (0.05, 8 * RADIUS, REACH * RADIUS, 50.0)
    ]
    weight = PROFILE["mass_kg"] * 9.80665
    assert thrusts[0] > 1.2 * weight
    assert thrusts[1] == pytest.approx(weight, rel=0.012), "four diameters up a hundredth is left"
    assert thrusts[2:] == pytest.approx([weight, weight], rel=1e-4)


def test_ground_table_ends_without_a_jump() -> None:
    table, scale, reach = ground_table({**PROFILE, "ground_effect": GROUND})
    assert table[-1] == 1.0
    assert np.abs(np.diff(table[-20:])).max() < 1e-4
    assert reach * scale == pytest.approx(len(table) - 1)
    assert ground_table(PROFILE)[0] == pytest.approx(1.0)


def test_voltage_drops_under_load_and_recovers() -> None:
    profile = profile_of(battery={**PROFILE["battery"], "resistance_ohm": 0.05})
    spin, hover = np.zeros((1, 4)), Rotors([profile], step_s=H).hover
    battery = Battery([profile], hover, np.zeros(1), spin=spin, step_s=0.004)
    rest = float(battery.voltage[0])
    spin[:] = 0.9
    battery.step()
    loaded, charge = float(battery.voltage[0]), float(battery.remaining[0])
    assert rest - loaded == pytest.approx(
        0.05 * (battery.current[0] - PROFILE["battery"]["idle_a"]), rel=0.01
    )
    spin[:] = 0.0
    battery.step()
    assert float(battery.voltage[0]) == pytest.approx(rest, abs=1e-3)
    assert float(battery.remaining[0]) < charge < 1.0


def test_thrust_depends_on_voltage_only_with_thrust_at_v(build: Any) -> None:
    pack = {**PROFILE["battery"], "cells": 3, "full_cell_v": 4.2}
    tired = build(vehicle(battery={**pack, "thrust_at_v": 13.0}, position=[0.0, 0.0, -3.0]))
    held = build(vehicle(battery=pack, position=[0.0, 0.0, -3.0]))
    for world in (tired, held):
        for _ in range(50):
            world.step(np.full((1, 4), float(world.hover[0])))
    hover = float(held.hover[0])
    assert held.truth().motors[0] == pytest.approx(hover, rel=1e-3)
    assert tired.truth().motors[0] == pytest.approx(hover * tired._battery.voltage[0] / 13.0, rel=1e-3)
    assert tired.bodies.v_n[0, 2] > held.bodies.v_n[0, 2] + 0.05, "it sinks"
