"""Fault injection in the world: rotors, batteries, wind, radio control."""

from __future__ import annotations

import numpy as np
import pytest

from arena.errors import InputError
from arena.geometry import euler_from_quat
from arena.sim.fault_injection import inject_fault

from .sim_slices import vehicle

LEANING = [0.17, -0.35, 0.61]


class StubAutopilots:
    """Records how its radio control was switched."""

    def __init__(self) -> None:
        self.switched: list[tuple[int, bool]] = []

    def sticks(self, vehicle: int, on: bool) -> None:
        self.switched.append((vehicle, on))


def three(build, **changes):
    return build(
        *(vehicle(f"uav{k}", k, position=[2.0 * k - 4.0, 0.5, -3.0], rpy=LEANING) for k in (1, 2, 3)),
        **changes,
    )


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_rotor_without_thrust_tilts_the_vehicle_and_lifts_less(build, rotor):
    world = build(*(vehicle(f"uav{k}", k, position=[2.0 * k - 4.0, 0.5, -3.0], rpy=LEANING) for k in (1, 2)))
    hover = np.tile(world.hover[:, None], 4)
    for _ in range(25):
        world.step(hover)
    before = world.truth()
    text = inject_fault(
        world, StubAutopilots(), {"do": "motor", "vehicle": "uav2", "rotor": rotor, "thrust": 0.0}
    )
    assert text == f"rotor {rotor} of uav2 gives 0 % of its thrust"
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
    assert after.motors[1] == pytest.approx(hover[1], abs=1e-3), "its speed follows the command"


def test_a_restored_rotor_gives_its_full_thrust(build):
    def fly(*faults):
        world = build(vehicle(position=[0, 0, -3], rpy=LEANING))
        for share in faults:
            inject_fault(
                world, StubAutopilots(), {"do": "motor", "vehicle": "uav1", "rotor": 3, "thrust": share}
            )
        for _ in range(20):
            world.step(np.full((1, 4), 0.6))
        return np.hstack([world.truth().p_n, world.truth().q_nb])

    assert np.array_equal(fly(0.3, 0.0, 1), fly())
    assert not np.allclose(fly(0.9), fly())


def test_discharge_override_ends_with_none(build):
    world = three(build)

    def remaining(steps):
        for _ in range(steps):
            world.step(np.full((3, 4), 0.5))
        return world.sense()["battery_remaining"]

    begun = remaining(1)
    inject_fault(world, StubAutopilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": 4.0})
    after = remaining(250)
    assert begun[1] - after[1] == pytest.approx(0.25)
    assert begun[[0, 2]] - after[[0, 2]] == pytest.approx(0.0, abs=0.01)
    volts = world.sense()["battery_v"]
    assert volts[1] < volts[0] - 0.2
    inject_fault(world, StubAutopilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": None})
    assert after[1] - remaining(250)[1] == pytest.approx(begun[0] - after[0], rel=0.1)
    inject_fault(world, StubAutopilots(), {"do": "battery", "vehicle": "uav2", "empty_in_s": 0.1})
    assert remaining(30)[1] == 0.0


def test_injected_wind_pushes_along_its_ned_vector(build):
    calm, windy = (
        build(vehicle(position=[0, 0, -3], rpy=LEANING, drag_kg_s=[0.3, 0.3, 0.3])) for _ in range(2)
    )
    assert (
        inject_fault(windy, StubAutopilots(), {"do": "wind", "wind_m_s": [3, -1.5, 0.5]})
        == "wind 3 -1.5 0.5 m/s"
    )
    for _ in range(10):
        for world in (calm, windy):
            world.step(np.tile(world.hover[:, None], 4))
    pushed = windy.truth().v_n[0] - calm.truth().v_n[0]
    assert pushed / np.linalg.norm(pushed) == pytest.approx(
        np.array([3, -1.5, 0.5]) / np.linalg.norm([3, -1.5, 0.5]), abs=0.02
    )
    assert abs(euler_from_quat(calm.truth().q_nb[0])[0]) > 0.1


def test_sticks_fault_reaches_the_autopilot(build):
    world, autopilots = three(build), StubAutopilots()
    assert (
        inject_fault(world, autopilots, {"do": "sticks", "vehicle": "uav3", "on": False})
        == "the radio control of uav3 is lost"
    )
    inject_fault(world, autopilots, {"do": "sticks", "vehicle": "uav1", "on": True})
    assert autopilots.switched == [(2, False), (0, True)]
    with pytest.raises(InputError, match="have no radio control"):
        inject_fault(world, object(), {"do": "sticks", "vehicle": "uav3", "on": False})


MOTOR = {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}
INVALID = [
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


@pytest.mark.parametrize("fault", INVALID, ids=str)
def test_an_invalid_fault_is_refused_and_changes_nothing(build, fault):
    def fly(*faults):
        world, autopilots = three(build, wind_m_s=[0.5, 0.0, 0.0]), StubAutopilots()
        for one in faults:
            with pytest.raises(InputError):
                inject_fault(world, autopilots, one)
        for _ in range(5):
            world.step(np.full((3, 4), 0.6))
        return np.hstack(
            [world.truth().p_n.ravel(), world.sense()["battery_remaining"], len(autopilots.switched)]
        )

    assert np.array_equal(fly(fault), fly())
