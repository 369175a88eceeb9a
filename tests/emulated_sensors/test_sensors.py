"""Measurements of the sensors: signs, axes, noise, range."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from arena.emulated_sensors.sensors import BeaconSensor, NeighbourSensor, SensorTimer
from arena.emulated_sensors.settings import Beacon, BeaconSettings, NeighbourSettings
from arena.emulated_sensors.states import State
from arena.geometry import quat_from_euler, quat_rotate

NEAR = NeighbourSettings(
    rows=(1, 2), source="mocap", rate_hz=50.0, position_noise_m=0.0, velocity_noise_m_s=0.0
)
FAR = BeaconSettings(
    beacons=(Beacon(number=3, p_n=(2.0, -1.0, -0.5)),),
    source="mocap",
    rate_hz=10.0,
    range_noise_m=0.0,
    bearing_noise=0.0,
    max_range_m=20.0,
)
LEVEL_NORTH = (1.0, 0.0, 0.0, 0.0)


def state(p_n=(0.0, 0.0, 0.0), v_n=(0.0, 0.0, 0.0), q_nb=LEVEL_NORTH) -> State:
    return State(7.0, p_n, v_n, tuple(np.asarray(q_nb, float).tolist()))


def measured(settings: BeaconSettings, own: State | None):
    return list(BeaconSensor(settings, 1, 1).measure(own))


def test_neighbour_is_its_state_minus_that_of_the_vehicle_in_ned_axes() -> None:
    own = state((1.0, 2.0, -3.0), (0.1, 0.2, 0.3), quat_from_euler(np.radians([10, -20, 35])))
    others = [state((4.0, 2.5, -1.0), (0.5, 0.2, -0.3)), state((-1.0, 0.0, -4.0))]
    one, two = NeighbourSensor(NEAR, (20, 30), 1, 5).measure(own, others)
    assert (one.system_id, two.system_id, one.time_s) == (20, 30, 7.0)
    assert one.pos == pytest.approx((3.0, 0.5, 2.0)) and one.vel == pytest.approx((0.4, 0.0, -0.6))
    assert two.pos == pytest.approx((-2.0, -2.0, -1.0))


def test_unknown_neighbour_is_not_measured_and_without_own_state_nobody_is() -> None:
    sensor = NeighbourSensor(NEAR, (20, 30), 1, 5)
    assert [m.system_id for m in sensor.measure(state(), [None, state()])] == [30]
    assert list(sensor.measure(None, [state(), state()])) == []


def test_noise_has_the_rms_of_the_settings() -> None:
    noisy = dataclasses.replace(NEAR, position_noise_m=0.004, velocity_noise_m_s=0.02)
    sensor = NeighbourSensor(noisy, (20, 30), 1, 5)
    found = [m for _ in range(3000) for m in sensor.measure(state(), [state(), state()])]
    assert np.std([m.pos for m in found]) == pytest.approx(0.004, rel=0.05)
    assert np.std([m.vel for m in found]) == pytest.approx(0.02, rel=0.05)
    assert (found[0].pos_noise_m, found[0].vel_noise_m_s) == (0.004, 0.02)
    one, two = np.array([m.pos for m in found[::2]]), np.array([m.pos for m in found[1::2]])
    assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 0.1


def test_noise_is_repeated_with_the_same_seed_and_does_not_depend_on_gaps() -> None:
    noisy = dataclasses.replace(NEAR, position_noise_m=0.1)
    one, two = NeighbourSensor(noisy, (20, 30), 1, 5), NeighbourSensor(noisy, (20, 30), 1, 5)
    list(one.measure(state(), [state(), state()]))
    list(two.measure(state(), [None, None]))  # nothing measured
    assert list(one.measure(state(), [state(), state()])) == list(two.measure(state(), [state(), state()]))
    other = NeighbourSensor(noisy, (20, 30), 2, 5)
    assert next(other.measure(state(), [state(), state()])).pos != pytest.approx(
        next(NeighbourSensor(noisy, (20, 30), 1, 5).measure(state(), [state(), state()])).pos
    )


@pytest.mark.parametrize(
    ("rpy_deg", "azimuth_deg", "elevation_deg"),
    [
        ((0, 0, 0), 0.0, 0.0),  # the beacon is north of the vehicle: ahead
        ((0, 0, 90), -90.0, 0.0),  # the nose points east: the beacon is on the left
        ((0, 0, -90), 90.0, 0.0),  # the nose points west: the beacon is on the right
        ((0, 30, 0), 0.0, -30.0),  # the nose is up: the beacon is below the nose
        ((40, 0, -90), 90.0, 40.0),  # nose west, right side down: the beacon on the right is towards the top
    ],
)
def test_direction_of_a_beacon_in_the_north_is_in_body_axes(rpy_deg, azimuth_deg, elevation_deg) -> None:
    north = dataclasses.replace(FAR, beacons=(Beacon(number=1, p_n=(5.0, 0.0, 0.0)),))
    (m,) = measured(north, state(q_nb=quat_from_euler(np.radians(rpy_deg))))
    assert math.degrees(m.azimuth) == pytest.approx(azimuth_deg, abs=1e-6)
    assert math.degrees(m.elevation) == pytest.approx(elevation_deg, abs=1e-6)
    assert m.range_m == pytest.approx(5.0)


def test_beacon_above_has_a_positive_elevation() -> None:
    above = dataclasses.replace(FAR, beacons=(Beacon(number=1, p_n=(1.0, 1.0, -3.0)),))
    (m,) = measured(above, state(p_n=(0.0, 1.0, -2.0)))
    assert math.degrees(m.elevation) == pytest.approx(45.0) and m.azimuth == pytest.approx(0.0)


def test_distance_and_direction_give_the_position_of_the_beacon() -> None:
    q_nb = quat_from_euler(np.radians([10, -20, 35]))
    own = state((0.5, -0.25, -1.5), q_nb=q_nb)
    (m,) = measured(FAR, own)
    level = math.cos(m.elevation)
    away_b = m.range_m * np.array(
        [level * math.cos(m.azimuth), level * math.sin(m.azimuth), -math.sin(m.elevation)]
    )
    assert np.array(own.p_n) + quat_rotate(q_nb, away_b) == pytest.approx(np.array(m.p_n))
    assert (m.number, m.p_n) == (3, (2.0, -1.0, -0.5))


def test_beacon_out_of_range_is_not_measured() -> None:
    near = dataclasses.replace(FAR, max_range_m=2.0)
    assert measured(near, state()) == [] and measured(FAR, None) == []
    assert len(measured(near, state((1.0, -1.0, -0.5)))) == 1


def test_noise_of_beacons_has_the_rms_of_the_settings() -> None:
    noisy = dataclasses.replace(FAR, range_noise_m=0.05, bearing_noise=0.02)
    sensor = BeaconSensor(noisy, 1, 5)
    found = [m for _ in range(3000) for m in sensor.measure(state())]
    assert np.std([m.range_m for m in found]) == pytest.approx(0.05, rel=0.05)
    assert np.std([m.azimuth for m in found]) == pytest.approx(0.02, rel=0.05)
    assert np.std([m.elevation for m in found]) == pytest.approx(0.02, rel=0.05)


def test_azimuth_behind_the_vehicle_stays_within_half_a_turn() -> None:
    behind = dataclasses.replace(FAR, beacons=(Beacon(number=1, p_n=(-5.0, 0.0, 0.0)),), bearing_noise=0.2)
    sensor = BeaconSensor(behind, 1, 5)
    found = [m.azimuth for _ in range(200) for m in sensor.measure(state())]
    assert max(abs(a) for a in found) <= math.pi and min(found) < 0.0 < max(found)


def test_timer_keeps_its_rate_and_skips_missed_times() -> None:
    timer = SensorTimer(50.0)
    steps = [k * 0.004 for k in range(500)]
    assert sum(timer.is_due(t) for t in steps) == 100
    assert timer.is_due(10.0) and not timer.is_due(10.01) and timer.is_due(10.02)
