"""The world, spoiled on purpose."""

from __future__ import annotations

import numpy as np
import pytest
from sim_slices import vehicle

from arena.errors import InputError
from arena.geometry import euler_from_quat
from arena.sim import world as module
from arena.sim.fault_injection import spoil

LEANING = [0.17, -0.35, 0.61]


class Pilots:
    """Remembers what its sticks were told."""

    def __init__(self) -> None:
        self.told: list[tuple[int, bool]] = []

    def sticks(self, vehicle: int, on: bool) -> None:
        self.told.append((vehicle, on))


def three(build, **changes):
    return build(
        *(vehicle(f"uav{k}", k, position=[2.0 * k - 4.0, 0.5, -3.0], rpy=LEANING) for k in (1, 2, 3)),
        **changes,
    )


@pytest.mark.parametrize("most", [0, 2], ids=["batch", "few"])
@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_rotor_without_thrust_turns_the_vehicle_towards_it_and_lifts_a_quarter_less(
    build, monkeypatch, most, rotor
):
    monkeypatch.setattr(module, "MOST", most)
    world = build(*(vehicle(f"uav{k}", k, position=[2.0 * k - 4.0, 0.5, -3.0], rpy=LEANING) for k in (1, 2)))
    assert (world._few is None) == (most == 0)
    hover = np.tile(world.fleet.hover[:, None], 4)
    for _ in range(25):
        world.step(hover)
    before = world.truth()
    told = spoil(world, Pilots(), {"do": "motor", "vehicle": "uav2", "rotor": rotor, "thrust": 0.0})
    assert told == f"rotor {rotor} of uav2 gives 0 % of its thrust"
    world.step(hover)
    after = world.truth()
    force = after.accel_b[:, 2] / before.accel_b[:, 2]
    assert force == pytest.approx([1.0, 0.75], abs=0.01)
    x, y, _ = world.fleet.profiles[1]["rotors"][rotor - 1]["position_m"]
    turned = after.omega_b - before.omega_b
    # the corner that lifts no more sinks: one to the right rolls it right, one ahead pitches it down
    assert np.sign(turned[1, :2]).tolist() == [np.sign(y), -np.sign(x)]
    assert np.abs(turned[1, :2]).min() > 10.0 * np.abs(turned[0]).max()
    # a rotor that the air no longer turns back leaves the yaw to those that turn the other way
    spins = world.fleet.profiles[1]["rotors"][rotor - 1]["direction"]
    assert np.sign(turned[1, 2]) == (-1.0 if spins == "ccw" else 1.0)
    assert after.motors[1] == pytest.approx(hover[1], abs=1e-3), "it turns on as it is told"


@pytest.mark.parametrize("most", [0, 2], ids=["batch", "few"])
def test_a_rotor_made_whole_again_is_whole(build, monkeypatch, most):
    monkeypatch.setattr(module, "MOST", most)

    def fly(*faults):
        world = build(vehicle(position=[0, 0, -3], rpy=LEANING))
        for share in faults:
            spoil(world, Pilots(), {"do": "motor", "vehicle": "uav1", "rotor": 3, "thrust": share})
        for _ in range(20):
            world.step(np.full((1, 4), 0.6))
        return np.hstack([world.truth().p_n, world.truth().q_nb])

    assert np.array_equal(fly(0.3, 0.0, 1), fly())
    assert not np.allclose(fly(0.9), fly())


def test_a_battery_is_drained_at_its_pace_and_then_by_its_motors_again(build):
    world = three(build)

    def remaining(steps):
        for _ in range(steps):
            world.step(np.full((3, 4), 0.5))
        return world.sense()["battery_remaining"]

    begun = remaining(1)
    spoil(world, Pilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": 4.0})
    after = remaining(250)
    assert begun[1] - after[1] == pytest.approx(0.25)
    assert begun[[0, 2]] - after[[0, 2]] == pytest.approx(0.0, abs=0.01)
    volts = world.sense()["battery_v"]
    assert volts[1] < volts[0] - 0.2
    spoil(world, Pilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": None})
    assert after[1] - remaining(250)[1] == pytest.approx(begun[0] - after[0], rel=0.1)
    spoil(world, Pilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": 0.1})
    assert remaining(30)[1] == 0.0


@pytest.mark.parametrize("most", [0, 2], ids=["batch", "few"])
def test_wind_blows_the_way_it_is_said_to_in_ned(build, monkeypatch, most):
    monkeypatch.setattr(module, "MOST", most)
    calm, windy = (
        build(vehicle(position=[0, 0, -3], rpy=LEANING, drag_kg_s=[0.3, 0.3, 0.3])) for _ in range(2)
    )
    assert spoil(windy, Pilots(), {"do": "wind", "wind_m_s": [3, -1.5, 0.5]}) == "wind 3 -1.5 0.5 m/s"
    for _ in range(10):
        for world in (calm, windy):
            world.step(np.tile(world.fleet.hover[:, None], 4))
    pushed = windy.truth().v_n[0] - calm.truth().v_n[0]
    assert pushed / np.linalg.norm(pushed) == pytest.approx(
        np.array([3, -1.5, 0.5]) / np.linalg.norm([3, -1.5, 0.5]), abs=0.02
    )
    assert abs(euler_from_quat(calm.truth().q_nb[0])[0]) > 0.1


def test_sticks_are_passed_on_to_the_pilots(build):
    world, pilots = three(build), Pilots()
    assert (
        spoil(world, pilots, {"do": "sticks", "vehicle": "uav3", "on": False})
        == "the sticks of uav3 are lost"
    )
    spoil(world, pilots, {"do": "sticks", "vehicle": "uav1", "on": True})
    assert pilots.told == [(2, False), (0, True)]
    with pytest.raises(InputError, match="know no sticks"):
        spoil(world, object(), {"do": "sticks", "vehicle": "uav3", "on": False})


MOTOR = {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}
SENSELESS = [
    {},
    {"do": "Motor"},
    {"do": ["motor"]},
    {**MOTOR, "vehicle": "uav9"},
    {**MOTOR, "vehicle": 1},
    {**MOTOR, "rotor": 0},
    {**MOTOR, "rotor": 5},
    {**MOTOR, "rotor": 1.0},
    {**MOTOR, "thrust": -0.1},
    {**MOTOR, "thrust": float("nan")},
    {**MOTOR, "thrust": None},
    {"do": "battery", "vehicle": "uav1"},
    {"do": "battery", "vehicle": "uav1", "empty_in_s": 0},
    {"do": "battery", "vehicle": "uav1", "empty_in_s": float("inf")},
    {"do": "wind"},
    {"do": "wind", "wind_m_s": [1, 2]},
    {"do": "wind", "wind_m_s": [1, 2, float("nan")]},
    {"do": "wind", "wind_m_s": [1e9, 0, 0]},
    {"do": "sticks", "vehicle": "uav1", "on": 0},
    {"do": "sticks", "vehicle": "uav1"},
]


@pytest.mark.parametrize("fault", SENSELESS, ids=str)
def test_a_fault_that_makes_no_sense_is_refused_and_changes_nothing(build, fault):
    def fly(*faults):
        world, pilots = three(build, wind_m_s=[0.5, 0.0, 0.0]), Pilots()
        for one in faults:
            with pytest.raises(InputError):
                spoil(world, pilots, one)
        for _ in range(5):
            world.step(np.full((3, 4), 0.6))
        return np.hstack([world.truth().p_n.ravel(), world.sense()["battery_remaining"], len(pilots.told)])

    assert np.array_equal(fly(fault), fly())
