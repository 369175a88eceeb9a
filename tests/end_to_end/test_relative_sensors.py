"""Flights with relative sensors: measurements compared with the true states, and repeated with the same seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arena.flight_log.recording import Recording, TrueStates
from arena.geometry import Array, quat_rotate
from arena.wire.relative_measurements import (
    BeaconMeasurement,
    Measurement,
    NeighbourMeasurement,
    is_sensor_datagram,
    measurements,
)

from .flight import Flight, Hangar

pytestmark = pytest.mark.flight
PROGRAM = Path(__file__).parent / "programs" / "measure.py"
BEACON = (3.0, -1.5, -2.5)
NO_NOISE = "{position_m: 0, velocity_m_s: 0}"
# positions and headings that differ in every axis, so that a swapped axis or a wrong sign is found
YAML = f"""\
beacons: {{door: [{", ".join(str(x) for x in BEACON)}]}}
defaults: {{autopilot: builtin, program: {PROGRAM}}}
vehicles:
  uav1:
    start: {{position: [-1.5, 0.5, 0], rpy_deg: [0, 0, 70]}}
    neighbours: {{vehicles: [uav2], noise: {NO_NOISE}}}
    beacon_sensor: {{noise: {{range_m: 0, bearing_deg: 0}}}}
  uav2:
    start: {{position: [0.5, -1, 0], rpy_deg: [0, 0, -40]}}
    neighbours: {{vehicles: [uav1], source: estimator, noise: {NO_NOISE}}}
"""


def fly(hangar: Hangar) -> Flight:
    yaml = hangar.folder / "arena.yaml"
    yaml.write_text(f"address: {hangar.address}\n{YAML}")
    flight = hangar.up(yaml, "--speed", "max", "--until-done", "--seed", "5", "--time-limit", "300")
    assert flight.wait(360) == 0, flight.said()
    return flight


@pytest.fixture(scope="module")
def flown(shared_hangar: Hangar) -> Flight:
    return fly(shared_hangar)


def sensor_datagrams(flight: Flight, vehicle: str) -> list[bytes]:
    record = Recording(flight.folder / "flight.mcap")
    return [d.data for d in record.datagrams(vehicle) if not d.up and is_sensor_datagram(d.data)]


def measured(flight: Flight, vehicle: str, system_id: int) -> list[Measurement]:
    return [m for data in sensor_datagrams(flight, vehicle) for m in measurements(data, system_id)]


def truth(flight: Flight, vehicle: str) -> TrueStates:
    return Recording(flight.folder / "flight.mcap").truth(vehicle)


def at(times: Array, states: TrueStates, values: Array) -> Array:
    return np.stack([np.interp(times, states.t, column) for column in values.T], axis=1)


@pytest.mark.parametrize(("own", "other", "number"), [("uav1", "uav2", 1), ("uav2", "uav1", 2)])
def test_neighbour_is_measured_where_it_is(flown: Flight, own: str, other: str, number: int) -> None:
    found = [m for m in measured(flown, own, number) if isinstance(m, NeighbourMeasurement)]
    times = np.array([m.time_s for m in found])
    one, two = truth(flown, own), truth(flown, other)
    inside = (times > one.t[0]) & (times < one.t[-1])
    position = np.array([m.pos for m in found]) - (at(times, two, two.p_n) - at(times, one, one.p_n))
    velocity = np.array([m.vel for m in found]) - (at(times, two, two.v_n) - at(times, one, one.v_n))
    assert inside.sum() > 400  # 50 Hz
    assert np.sqrt((position[inside] ** 2).mean()) < 0.02
    assert np.sqrt((velocity[inside] ** 2).mean()) < 0.05


def test_distance_and_direction_lead_from_the_vehicle_to_the_beacon(flown: Flight) -> None:
    found = [m for m in measured(flown, "uav1", 1) if isinstance(m, BeaconMeasurement)]
    own = truth(flown, "uav1")
    missed = []
    for m in found:
        row = int(np.abs(own.t - m.time_s).argmin())
        level = np.cos(m.elevation)
        away_b = m.range_m * np.array(
            [level * np.cos(m.azimuth), level * np.sin(m.azimuth), -np.sin(m.elevation)]
        )
        missed.append(own.p_n[row] + quat_rotate(own.q_nb[row], away_b) - BEACON)
    assert len(found) > 80  # 10 Hz
    assert np.sqrt((np.array(missed) ** 2).mean()) < 0.05


def test_same_seed_gives_the_same_measurements(flown: Flight, shared_hangar: Hangar) -> None:
    again = fly(shared_hangar)
    for vehicle in ("uav1", "uav2"):
        assert sensor_datagrams(again, vehicle) == sensor_datagrams(flown, vehicle)
