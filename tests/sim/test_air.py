"""Gusts, downwash, drag and rotor acceleration: what the air and the rotors do to a vehicle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from arena.schema import load_profile
from arena.sim.downwash import AIR_DENSITY_KG_M3, Downwash
from arena.sim.gusts import Gusts
from arena.vehicle_models.multirotor_dynamics import Rotors

from .sim_slices import PROFILE, vehicle

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
JET = {"rotor_radius_m": 0.127, "strength": 1.0}
STILL = np.zeros((1, 3))
FADE = {**PROFILE["thrust_curve"], "fade_speed_m_s": 25.0}
INERTIA = {"moment_kg_m2": 2.74e-5, "thrust_n_s2": 8.54858e-6}
WEIGHT = PROFILE["mass_kg"] * 9.80665


# -- drag with the motors off ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["iris", "intel_aero"])
def test_a_falling_vehicle_with_motors_off_reaches_a_final_speed(build: Any, name: str) -> None:
    profile = load_profile(name).slice()
    world = build({**vehicle(), "profile": profile}, size_m=[20.0, 20.0, 300.0])
    world.bodies.place(0, p_n=np.array([0.0, 0.0, -250.0]), q_nb=LEVEL)
    for _ in range(round(9.0 / world.period_s)):
        world.step(np.zeros((1, 4)))
    final = math.sqrt(profile["mass_kg"] * 9.80665 / profile["body_drag_kg_m"][2])
    assert 14.0 < final < 18.0
    assert world.bodies.v_n[0] == pytest.approx([0.0, 0.0, final], rel=0.01)


def test_rotor_drag_of_the_iris_is_that_of_px4s_gazebo_model() -> None:
    profile = load_profile("iris")
    speed = math.sqrt(profile.mass_kg * 9.80665 / 4.0 / 8.54858e-6)
    assert profile.drag_kg_s[:2] == pytest.approx([4.0 * 0.000175 * speed] * 2, rel=0.02)


# -- downwash ----------------------------------------------------------------------------------------------------


def jets(**changes: Any) -> Downwash:
    return Downwash([{**PROFILE, "downwash": {**JET, **changes}}] * 2, strength=1.0)


def blown(p_n: Any, thrust: float = WEIGHT, axis: Any = (0.0, 0.0, 1.0), **changes: Any) -> Any:
    """Return the wind at a vehicle at p_n, below one at the origin (3,)."""
    places = np.array([[0.0, 0.0, 0.0], p_n])
    r_nb = np.repeat(np.eye(3)[None], 2, 0)
    r_nb[0, :, 2] = axis
    return jets(**changes).wind(places, r_nb, lambda: np.array([thrust, 0.0]))[1]


def test_downwash_on_the_axis_is_the_papers_jet() -> None:
    rotors_out = math.hypot(0.13, 0.22)
    length, below = 2.0 * rotors_out, 3.0
    induced = math.sqrt(WEIGHT / (2.0 * AIR_DENSITY_KG_M3 * 4.0 * math.pi * 0.127**2))
    half = 0.07668 * (below + 5.817 * length)
    axis = induced * 10.11 / (below / length + 5.817)
    paper = axis / (1.0 + (math.sqrt(2.0) - 1.0) * (rotors_out / half) ** 2) ** 2
    assert blown([0.0, 0.0, below]) == pytest.approx([0.0, 0.0, paper], rel=0.02)
    assert induced == pytest.approx(5.44, abs=0.05)


def test_the_jet_keeps_the_momentum_of_the_thrust() -> None:
    """Without the lengthened distance: a lower vehicle whose rotors are all at its centre."""
    small = {**PROFILE, "rotors": [{**r, "position_m": [0.0, 0.0, 0.0]} for r in PROFILE["rotors"]]}
    model = Downwash([{**PROFILE, "downwash": JET}, small], strength=1.0)
    for below in (2.0, 5.0):
        r = np.linspace(0.0, 4.0, 1600)
        speed = np.array(
            [
                model.wind(
                    np.array([[0, 0, 0], [x, 0, below]]),
                    np.repeat(np.eye(3)[None], 2, 0),
                    lambda: np.array([WEIGHT, 0.0]),
                )[1, 2]
                for x in r
            ]
        )
        flux = AIR_DENSITY_KG_M3 * 2.0 * math.pi * float((speed**2 * r).sum() * (r[1] - r[0]))
        assert flux == pytest.approx(WEIGHT, rel=0.25)


def test_downwash_acts_only_below_and_decreases_sideways() -> None:
    assert blown([0.0, 0.0, -1.0]) == pytest.approx([0.0, 0.0, 0.0])
    assert blown([2.0, 0.0, 0.0]) == pytest.approx([0.0, 0.0, 0.0]), "beside it"
    aside = [blown([x, 0.0, 1.0])[2] for x in (0.0, 0.3, 0.6, 1.0, 3.0)]
    assert np.all(np.diff(aside) < 0.0)
    assert aside[-1] == 0.0


def test_downwash_has_no_jump() -> None:
    path = [
        blown([x, 0.0, z])[2]
        for x, z in zip(np.linspace(-3, 3, 601), np.linspace(-0.3, 2.0, 601), strict=True)
    ]
    assert np.abs(np.diff(path)).max() < 0.1
    assert max(path) > 2.0


def test_downwash_follows_thrust_and_tilt_and_ends_at_strength_0() -> None:
    one = blown([0.0, 0.0, 1.0])[2]
    assert blown([0.0, 0.0, 1.0], thrust=4.0 * WEIGHT)[2] == pytest.approx(2.0 * one)
    assert blown([0.0, 0.0, 1.0], thrust=0.0)[2] == 0.0
    assert blown([0.0, 0.0, 1.0], strength=0.5)[2] == pytest.approx(0.5 * one)
    leaning = np.array([math.sin(0.3), 0.0, math.cos(0.3)])
    assert blown(leaning, axis=leaning) == pytest.approx(one * leaning)
    assert not jets(strength=0.0).acts
    assert not Downwash([{**PROFILE, "downwash": JET}], strength=1.0).acts, "one vehicle alone"
    assert not Downwash([PROFILE] * 2, strength=1.0).acts, "profiles without downwash"


def hover_motors(build: Any, **room: Any) -> Any:
    """Return the height that a lower vehicle loses in 0.4 s below another, both at their hover command, and the upper's."""
    fleet = [
        vehicle("above", 1, position=[0.0, 0.0, -3.6], thrust_curve=FADE),
        vehicle("below", 2, position=[0.0, 0.0, -3.0], thrust_curve=FADE),
    ]
    for each in fleet:
        each["profile"]["downwash"] = JET
    world = build(*fleet, **room)
    for _ in range(75):
        world.step(np.repeat(world.hover[:, None], 4, axis=1))
    for i in (0, 1):
        world.bodies.place(i, p_n=world.fleet.start_p_n[i], q_nb=LEVEL)
    for _ in range(100):
        world.step(np.repeat(world.hover[:, None], 4, axis=1))
    return world.bodies.p_n[:, 2] - world.fleet.start_p_n[:, 2]


def test_a_vehicle_0_6_m_below_another_is_pushed_down(build: Any) -> None:
    above, below = hover_motors(build)
    assert 0.05 < below < 0.4
    assert abs(above) < 0.005


def test_downwash_0_in_the_yaml_turns_it_off(build: Any) -> None:
    assert hover_motors(build, downwash=0.0) == pytest.approx([0.0, 0.0], abs=0.005)


# -- rotor acceleration ------------------------------------------------------------------------------------------


def yaw_torques(inertia: Any, steps: int = 60) -> Any:
    """Return the yaw torque of ccw rotors that start, and the rotors' speed at the end (steps,), [rad/s]."""
    rotors = Rotors([{**PROFILE, "moment_ratio_m": 1e-9, "rotor_inertia": inertia}], step_s=0.002)
    torque = []
    for _ in range(steps):
        _, found = rotors.step(np.array([[0.6, 0.6, 0.0, 0.0]]), STILL, np.array([50.0]))
        torque.append(found[0, 2])
    return np.array(torque), rotors


def test_rotors_that_gain_speed_turn_the_body_by_their_angular_momentum() -> None:
    torque, rotors = yaw_torques(INERTIA)
    thrust = float(rotors.thrust()[0]) / 2.0
    speed = math.sqrt(thrust / INERTIA["thrust_n_s2"])
    assert speed == pytest.approx(690.0, abs=30.0)
    assert np.all(torque[:20] > 0.0), "a ccw rotor turns the body clockwise"
    assert torque.sum() * 0.002 == pytest.approx(2.0 * INERTIA["moment_kg_m2"] * speed, rel=1e-3)


def test_rotor_inertia_0_makes_no_torque() -> None:
    for none in (None, {**INERTIA, "moment_kg_m2": 0.0}):
        torque, _ = yaw_torques(none)
        assert np.abs(torque).max() < 1e-6


# -- gusts -------------------------------------------------------------------------------------------------------


def gusts(ids: Any = (1,), wind: float = 8.0, step_s: float = 0.004) -> Gusts:
    return Gusts(ids, seed=1, wind_20ft=wind, step_s=step_s)


def record(
    model: Gusts, steps: int, height: float = 6.0, vehicles: int = 1, wind_n: Any = (0.0, 0.0, 0.0)
) -> Any:
    z, v = np.full(vehicles, height), np.zeros((vehicles, 3))
    air = np.tile(np.array(wind_n, float), (vehicles, 1))
    return np.array([model.step(z, v, air) for _ in range(steps)])


def test_gusts_have_the_standard_deviation_of_the_specification() -> None:
    found = record(gusts(range(1, 201)), 1500, vehicles=200)
    sigma_w = 0.1 * 8.0
    sigma_u = sigma_w / (0.177 + 0.000823 * 6.0 / 0.3048) ** 0.4
    assert found.std(axis=(0, 1)) == pytest.approx([sigma_u, sigma_u, sigma_w], rel=0.06)
    assert np.abs(found.mean(axis=(0, 1))).max() < 0.2


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_gusts_have_the_spectrum_of_the_specification(axis: int) -> None:
    """Autocorrelations of the Dryden spectra: exp(-x), and (1 - x / 2) exp(-x), x = V t / L."""
    found, feet = record(gusts(range(1, 301)), 2000, height=6.096, vehicles=300)[:, :, axis], 20.0
    length = 6.096 if axis == 2 else 6.096 / (0.177 + 0.000823 * feet) ** 1.2
    for lag in (50, 200):
        x = 8.0 * lag * 0.004 / length
        expected = math.exp(-x) * (1.0 if axis == 0 else 1.0 - x / 2.0)
        seen = float((found[lag:] * found[:-lag]).mean() / (found * found).mean())
        assert seen == pytest.approx(expected, abs=0.05)


def test_gusts_do_not_depend_on_the_step() -> None:
    fine, coarse = (
        record(gusts(range(1, 301), step_s=h), n, vehicles=300) for h, n in ((0.004, 1000), (0.02, 200))
    )
    assert fine.std(axis=(0, 1)) == pytest.approx(coarse.std(axis=(0, 1)), rel=0.08)


def test_another_vehicle_does_not_change_the_gusts_of_the_first() -> None:
    alone, both = record(gusts([7]), 300), record(gusts([7, 8]), 300, vehicles=2)
    assert (alone[:, 0] == both[:, 0]).all()
    assert np.abs(both[:, 0] - both[:, 1]).max() > 0.1


def test_gusts_along_the_wind_turn_with_it() -> None:
    north, east = (record(gusts(), 200, wind_n=w) for w in ((5.0, 0.0, 0.0), (0.0, 5.0, 0.0)))
    assert east[:, 0, 1] == pytest.approx(north[:, 0, 0])
    assert east[:, 0, 0] == pytest.approx(-north[:, 0, 1])


def test_gusts_push_a_vehicle_and_0_is_still_air(build: Any) -> None:
    def drift(**room: Any) -> float:
        world = build(vehicle(position=[0, 0, -3.0], drag_kg_s=[0.5, 0.5, 0.2]), **room)
        for _ in range(250):
            world.step(np.repeat(world.hover[:, None], 4, axis=1))
        return float(np.abs(world.bodies.v_n[0, :2]).max())

    assert drift(gusts_m_s=8.0) > 0.02
    assert drift() < 1e-9
