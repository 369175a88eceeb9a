"""Vehicles change between pybullet and free flight without a trace in their motion: take-off, landing, collisions.

Each flight is flown twice, once entirely in pybullet, and compared.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from arena.sim.pybullet_room import PybulletRoom
from arena.sim.world import World

from .sim_slices import PROFILE, vehicle

Array = NDArray[np.float64]
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
TILTED = np.array([0.98, 0.1, -0.12, 0.05]) / np.linalg.norm([0.98, 0.1, -0.12, 0.05])


class Flight:
    """Flight of a world: its true states in the order of the steps, and which vehicles pybullet moved."""

    def __init__(self, world: World, *, only_pybullet: bool) -> None:
        world.bodies._only_pybullet = only_pybullet
        self.world = world
        self.states: list[Array] = []
        self.near: list[list[int]] = []

    def fly(self, command: Array, seconds: float) -> None:
        for _ in range(round(seconds / self.world.period_s)):
            self.world.step(command)
            t = self.world.truth()
            upright = t.q_nb * np.sign(t.q_nb[:, :1])  # q and -q are the same attitude
            self.states.append(np.hstack([t.p_n, upright, t.v_n, t.omega_b, t.accel_b]))
            self.near.append(self.world.bodies.in_pybullet)

    def changes(self) -> list[list[int]]:
        """Return which vehicles pybullet moved, one entry per change."""
        return [now for before, now in zip([None, *self.near], self.near, strict=False) if now != before]


def compared(make: Callable[[], World], fly: Callable[[Flight], None], within: float) -> Flight:
    """Fly twice and compare the true states; return the flight with free flight."""
    mixed, theirs = Flight(make(), only_pybullet=False), Flight(make(), only_pybullet=True)
    for flight in (mixed, theirs):
        fly(flight)
    assert all(near == list(range(len(near))) for near in theirs.near)
    assert mixed.world.flights() == theirs.world.flights()
    assert np.abs(np.array(mixed.states) - np.array(theirs.states)).max() < within
    return mixed


def hover(flight: Flight, share: float = 1.0) -> Array:
    """Return the command of all rotors with this share of the weight as thrust (V, R)."""
    return np.repeat(share**0.6 * flight.world.hover[:, None], flight.world.rotors, axis=1)


def test_take_off_and_landing_are_those_of_pybullet(build: Any) -> None:
    def fly(flight: Flight) -> None:
        flight.fly(hover(flight, 0.5), 0.5)
        flight.fly(hover(flight, 1.3), 0.8)
        flight.fly(hover(flight, 0.7), 2.2)
        flight.fly(hover(flight, 0.0), 0.2)  # a standstill begins later

    flight = compared(lambda: build(vehicle()), fly, 1e-6)
    assert flight.changes() == [[0], [], [0]]
    record = flight.world.flights()["uav1"]
    assert record["landings"] == 1 and record["max_height_m"] > 1.0


@pytest.mark.parametrize(("speed", "attitude"), [(0.8, LEVEL), (4.0, TILTED), (25.0, TILTED)])
@pytest.mark.parametrize(
    ("start", "towards", "what"),
    [
        ((4.0, 0.5, -2.5), (1, 0, 0), "the north wall"),
        ((0.3, -2.0, -2.5), (0, -1, 0), "the west wall"),
        ((0.3, 0.5, -3.0), (0, 0, -1), "the ceiling"),
        ((0.3, 0.5, -2.0), (0, 0, 1), "touched down"),
    ],
)
def test_impacts_are_those_of_pybullet(
    build: Any, start: tuple[float, ...], towards: tuple[int, ...], what: str, speed: float, attitude: Array
) -> None:
    """A tilted vehicle flies against a side of the room. The first step is already in free flight."""

    def fly(flight: Flight) -> None:
        velocity = speed * np.array(towards, float)
        flight.world.bodies.place(0, p_n=np.array(start), q_nb=attitude, v_n=velocity)
        flight.fly(hover(flight), 3.0 / speed)

    flight = compared(lambda: build(vehicle(position=[0, 0, -2.0])), fly, 1e-6)
    assert flight.changes()[:2] == [[], [0]]
    if speed > 2.0:
        assert what in flight.world.flights()["uav1"]["crashed"]


def test_collision_of_two_vehicles_is_that_of_pybullet(build: Any) -> None:
    """Of three vehicles in the air only the two that come near each other move in pybullet."""

    def make() -> World:
        starts = ((-2.0, 0.1, -2.5), (1.0, 0.0, -2.5), (0.0, 3.0, -2.5))
        return build(*(vehicle(f"uav{k}", k, position=list(p)) for k, p in enumerate(starts, 1)))

    def fly(flight: Flight) -> None:
        flight.fly(hover(flight), 0.1)
        places = flight.world.fleet.start_p_n
        for k, speed in enumerate((3.0, 0.0, 0.0)):
            flight.world.bodies.place(k, p_n=places[k], q_nb=LEVEL, v_n=np.array([speed, 0.0, 0.0]))
        flight.fly(hover(flight), 1.5)

    flight = compared(make, fly, 1e-6)
    assert [0, 1] in flight.changes() and not any(2 in near for near in flight.near)
    assert "touched uav2" in flight.world.flights()["uav1"]["crashed"]


def test_pybullet_is_not_called_in_free_flight(build: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    world = build(*(vehicle(f"uav{k}", k, position=[2.0 * k - 5.0, 0.0, -2.0]) for k in (1, 2, 3, 4)))
    world.step(np.zeros((4, 4)))

    class NoCalls:
        def __getattr__(self, name: str) -> Any:
            raise AssertionError(f"pybullet.{name} was called")

    with monkeypatch.context() as patch:
        patch.setattr(world.bodies._room, "_bullet", NoCalls())
        for _ in range(100):
            world.step(np.repeat(world.hover[:, None], 4, axis=1))
            world.truth()
    assert world.bodies.in_pybullet == []


def test_only_the_vehicles_near_something_are_in_pybullet(build: Any) -> None:
    places = [[-4.0, 0.0, 0.0], [-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 0.3, -2.3], [5.65, 2.0, -2.0]]
    world = build(*(vehicle(f"uav{k}", k, position=p) for k, p in enumerate(places, 1)))
    world.step(np.repeat(world.hover[:, None], 4, axis=1))
    assert world.bodies.in_pybullet == [0, 2, 3, 4]


def test_wind_and_specific_force_are_the_same_in_pybullet(build: Any) -> None:
    """Drag, gusts, downwash, ground effect and a weak battery act on both sides in the same way."""
    fleet = [
        vehicle(
            f"uav{k}",
            k,
            position=[1.9 + 0.1 * k, 0.2, -1.2 - 0.9 * k],
            rpy=[0.1, -0.2, 0.7 * k],
            drag_kg_s=[0.2, 0.3, 0.4],
            body_drag_kg_m=[0.01, 0.02, 0.03],
            ground_effect={"rotor_radius_m": 0.127, "body_lift": 2.0},
            battery={**PROFILE["battery"], "thrust_at_v": 12.0},
        )
        for k in (1, 2)
    ]
    for each in fleet:
        each["profile"] |= {
            "downwash": {"rotor_radius_m": 0.127},
            "rotor_inertia": {"moment_kg_m2": 2.74e-5, "thrust_n_s2": 8.54858e-6},
        }

    def fly(flight: Flight) -> None:
        rng = np.random.default_rng(1)
        for _ in range(200):
            flight.fly(hover(flight) + 0.02 * rng.standard_normal((2, 4)), 0.004)

    flight = compared(
        lambda: build(*fleet, wind_m_s=[0.5, -0.2, 0.1], gusts_m_s=6.0, size_m=[12.0, 8.0, 8.0]), fly, 1e-9
    )
    assert flight.near[0] == [] and np.abs(flight.states[-1] - flight.states[0]).max() > 0.1


def test_pybullet_room_is_empty_after_all_have_left(build: Any) -> None:
    world = build(vehicle(position=[0, 0, -2.0]))
    room: PybulletRoom = world.bodies._room
    assert list(room._bodies) == [0]
    world.step(np.zeros((1, 4)))
    assert not room._bodies and not room.contacts().floor.any()
