"""The terms of the physics: drag takes energy, rotors lag, the floor lifts and is soon forgotten, a pack sags and recovers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_slices import PROFILE, vehicle

from arena.constants import GRAVITY_M_S2
from arena.geometry import quat_from_euler
from arena.sim.battery import Battery
from arena.sim.ground import REACH, ground_share, ground_table
from arena.sim.rotors import Rotors
from arena.sim.vehicle_arrays import Fleet, read_fleet

H = 0.002
RADIUS = 0.127
FAR = np.array([100.0])
GROUND = {"rotor_radius_m": RADIUS, "body_lift": 2.0}
PLACES = np.array([r["position_m"][:2] for r in PROFILE["rotors"]])
AIR = st.lists(st.floats(-8.0, 8.0), min_size=3, max_size=3).map(np.array)


def fleet_of(**profile: Any) -> Fleet:
    one = vehicle()
    one["profile"].update(profile)
    return read_fleet([one])


def spun(fleet: Fleet, command: float) -> Rotors:
    """Rotors that have reached the command."""
    rotors = Rotors(fleet, step_s=H)
    rotors.spin = np.full((1, 4), command)
    return rotors


def push(fleet: Fleet, air_b: Any, command: float | None = None, height: Any = FAR) -> Any:
    """Force [N] [FRD] (3,) at a steady command, by default the one of hover."""
    u = float(fleet.hover[0]) if command is None else command
    force, _ = spun(fleet, u).step(np.full((1, 4), u), np.asarray(air_b, float)[None], height)
    return force[0]


@settings(max_examples=40, deadline=None)
@given(air=AIR, command=st.floats(0.0, 1.0))
def test_drag_never_gives_energy(air: Any, command: float) -> None:
    fleet = fleet_of(drag_kg_s=[0.3, 0.4, 0.2], body_drag_kg_m=[0.01, 0.02, 0.05])
    drag = push(fleet, air, command) - push(fleet_of(), air, command)
    assert drag @ air <= 1e-12


def test_drag_of_the_rotors_is_the_profiles_at_hover_and_grows_with_the_root_of_the_thrust() -> None:
    fleet, air = fleet_of(drag_kg_s=[0.3, 0.4, 0.0]), [1.5, -2.0, 0.0]
    assert push(fleet, air)[:2] == pytest.approx([-0.45, 0.8], rel=1e-3)
    more = 0.9
    ratio = -push(fleet, air, more)[2] / (PROFILE["mass_kg"] * GRAVITY_M_S2)
    assert push(fleet, air, more)[:2] == pytest.approx(np.sqrt(ratio) * np.array([-0.45, 0.8]), rel=1e-3)
    assert push(fleet, air, 0.0) == pytest.approx([0.0, 0.0, 0.0]), "rotors at rest drag nothing"


def test_drag_of_the_body_goes_with_the_square_and_against_the_air_along_each_axis() -> None:
    fleet = fleet_of(body_drag_kg_m=[0.01, 0.02, 0.05])
    assert push(fleet, [2.0, -3.0, 1.0], 0.0) == pytest.approx([-0.04, 0.18, -0.05])


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (10.0, -20.0, 35.0), (-35.0, 15.0, 170.0)])
def test_a_gliding_vehicle_slows_down_whatever_its_attitude(rpy_deg: Any, build: Any) -> None:
    world = build(vehicle(drag_kg_s=[0.3, 0.3, 0.3]))
    world.bodies.place(
        0,
        p_n=np.array([0.0, 0.0, -4.0]),
        q_nb=quat_from_euler(np.radians(rpy_deg)),
        v_n=np.array([2.0, -1.0, 0.0]),
    )
    push_n = world.bodies.r_nb[0] @ push(world.fleet, world.bodies.v_n[0] @ world.bodies.r_nb[0])
    alone_n = world.bodies.r_nb[0] @ push(fleet_of(), np.zeros(3))
    assert push_n - alone_n == pytest.approx([-0.6, 0.3, 0.0], abs=1e-3)


def test_a_rotor_has_closed_63_percent_of_the_gap_after_its_time_constant_and_falls_slower_than_it_rises() -> (
    None
):
    fleet = fleet_of(motor_up_s=0.02, motor_down_s=0.04)
    rotors = Rotors(fleet, step_s=H)
    for _ in range(10):
        rotors.step(np.full((1, 4), 0.5), np.zeros((1, 3)), FAR)
    assert rotors.spin == pytest.approx(0.5 * (1 - np.exp(-1)), rel=1e-6)
    rotors.spin[:] = 0.5
    for _ in range(10):
        rotors.step(np.zeros((1, 4)), np.zeros((1, 3)), FAR)
    assert rotors.spin == pytest.approx(0.5 * np.exp(-0.5), rel=1e-6)


def test_the_ground_effect_of_one_rotor_alone_is_cheeseman_and_bennetts() -> None:
    z = np.array([0.5, 1.0, 2.0, 4.0]) * RADIUS
    assert ground_share(z, np.array([[0.0, 0.0]]), radius=RADIUS, body_lift=0.0) == pytest.approx(
        1.0 / (1.0 - (RADIUS / (4.0 * z)) ** 2)
    )


def test_four_rotors_and_the_body_between_them_are_lifted_as_the_paper_says() -> None:
    """Its formula for a square quadrotor, written out."""
    d, z = 0.4, np.array([0.1, 0.2, 0.5])
    b, r2 = d * np.sqrt(2.0), RADIUS**2
    square = np.array([[d, d], [-d, -d], [d, -d], [-d, d]]) / 2.0
    near, across, body = (z / (x + 4 * z * z) ** 1.5 for x in (d * d, 2 * d * d, b * b))
    paper = 1.0 / (1.0 - (RADIUS / (4 * z)) ** 2 - r2 * near - r2 / 2 * across - 2 * r2 * 2.0 * body)
    assert ground_share(z, square, radius=RADIUS, body_lift=2.0) == pytest.approx(paper)


def test_the_floor_lifts_most_where_it_is_near_and_not_at_all_some_diameters_up() -> None:
    share = ground_share(np.linspace(0.0, 3.0, 200), PLACES, radius=RADIUS, body_lift=2.0)
    assert np.all(np.diff(share) <= 0.0)
    assert 1.2 < share[0] < 1.5
    fleet = fleet_of(ground_effect=GROUND)
    thrusts = [
        -push(fleet, [0, 0, 0], height=np.array([z]))[2] for z in (0.05, 8 * RADIUS, REACH * RADIUS, 50.0)
    ]
    weight = PROFILE["mass_kg"] * GRAVITY_M_S2
    assert thrusts[0] > 1.2 * weight
    assert thrusts[1] == pytest.approx(weight, rel=0.012), "four diameters up a hundredth is left"
    assert thrusts[2:] == pytest.approx([weight, weight], rel=1e-4)


def test_the_table_joins_the_free_air_without_a_jump_and_is_flat_without_the_effect() -> None:
    table, scale, reach = ground_table({**PROFILE, "ground_effect": GROUND})
    assert table[-1] == 1.0
    assert np.abs(np.diff(table[-20:])).max() < 1e-4
    assert reach * scale == pytest.approx(len(table) - 1)
    assert ground_table(PROFILE)[0] == pytest.approx(1.0)


def test_a_pack_sags_under_load_recovers_without_it_and_never_gains_charge() -> None:
    fleet = fleet_of(battery={**PROFILE["battery"], "resistance_ohm": 0.05})
    battery = Battery(fleet, step_s=0.004)
    rest = float(battery.voltage[0])
    battery.step(np.full((1, 4), 0.9))
    loaded, charge = float(battery.voltage[0]), float(battery.remaining[0])
    assert rest - loaded == pytest.approx(
        0.05 * (battery.current[0] - PROFILE["battery"]["idle_a"]), rel=0.01
    )
    battery.step(np.zeros((1, 4)))
    assert float(battery.voltage[0]) == pytest.approx(rest, abs=1e-3)
    assert float(battery.remaining[0]) < charge < 1.0


def test_thrust_follows_the_voltage_only_where_the_profile_says_so(build: Any) -> None:
    pack = {**PROFILE["battery"], "cells": 3, "full_cell_v": 4.2}
    tired = build(vehicle(battery={**pack, "thrust_at_v": 13.0}, position=[0.0, 0.0, -3.0]))
    held = build(vehicle(battery=pack, position=[0.0, 0.0, -3.0]))
    for world in (tired, held):
        for _ in range(50):
            world.step(np.full((1, 4), float(world.fleet.hover[0])))
    hover = float(held.fleet.hover[0])
    assert held.truth().motors[0] == pytest.approx(hover, rel=1e-3)
    assert tired.truth().motors[0] == pytest.approx(hover * tired._battery.voltage[0] / 13.0, rel=1e-3)
    assert tired.bodies.v_n[0, 2] > held.bodies.v_n[0, 2] + 0.05, "it sinks"
