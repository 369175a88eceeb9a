"""MAV_CMD_DO_ORBIT: the circle, its limits, and the end of the flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from scenarios import ALT, LAT, LON, Lane, Scenarios, Wait

from arena.autopilot.navigation.orbit import Orbit, OrbitRequest, YawBehaviour, orbit_of

NAN = math.nan
scenario = Scenarios()
lanes = scenario.fixture(origin=True)


def request(radius: float = 2.0, speed: float = 1.0, yaw: float = NAN) -> OrbitRequest:
    return OrbitRequest(radius=radius, speed=speed, yaw=yaw, lat=NAN, lon=NAN, alt=NAN)


def orbit(
    radius: float = 3.0, velocity: float = 1.0, yaw: YawBehaviour = YawBehaviour.FRONT_TO_CENTRE
) -> Orbit:
    return Orbit(
        centre=(5.0, -2.0, -3.0), radius=radius, velocity=velocity, yaw_behaviour=yaw, initial_yaw=0.7
    )


@given(angle=st.floats(-3.1, 3.1), away=st.floats(0.1, 9.0), velocity=st.floats(-3, 3))
def test_velocity_is_tangential_and_corrects_the_radius(angle, away, velocity):
    circle = orbit()
    out = np.array([math.cos(angle), math.sin(angle)])
    p = (5.0 + away * out[0], -2.0 + away * out[1], -3.1)
    target = circle.setpoint(p, velocity)
    v = np.array(target.v_n[:2])
    assert v @ out == pytest.approx(3.0 - away, abs=1e-9)  # outwards inside the circle
    right = np.array([-out[1], out[0]])  # clockwise as seen from above
    assert v @ right == pytest.approx(velocity, abs=1e-9)
    assert np.array(target.a_n[:2]) == pytest.approx(-out * velocity**2 / 3.0)
    assert target.p_n[2] == -3.0 and all(math.isnan(x) for x in (*target.p_n[:2], target.v_n[2]))


@pytest.mark.parametrize(
    ("behaviour", "velocity", "yaw"),
    [
        (YawBehaviour.FRONT_TO_CENTRE, 1.0, math.pi),
        (YawBehaviour.INITIAL_HEADING, 1.0, 0.7),
        (YawBehaviour.UNCONTROLLED, 1.0, NAN),
        (YawBehaviour.FRONT_TANGENT, 1.0, math.pi / 2),  # north of the centre, clockwise: to the east
        (YawBehaviour.FRONT_TANGENT, -1.0, -math.pi / 2),
    ],
)
def test_heading_follows_the_requested_behaviour(behaviour, velocity, yaw):
    found = orbit(velocity=velocity, yaw=behaviour).heading((8.0, -2.0, -3.0))
    assert abs(found) == pytest.approx(abs(yaw), nan_ok=True)
    assert math.isnan(yaw) or abs(yaw) == math.pi or found == pytest.approx(yaw)


@pytest.mark.parametrize(
    ("asked", "radius", "velocity"),
    [
        (request(4.0, 2.0), 4.0, 2.0),
        (request(-4.0, 2.0), 4.0, -2.0),
        (request(2.0, 9.0), 2.0, 2.0),  # at most 2 m/s2
        (request(500.0, 50.0), 500.0, 10.0),
        (request(NAN, NAN), 1.0, 1.0),
        (request(0.5), None, None),
        (request(-0.5), None, None),
        (request(1001.0), None, None),
    ],
)
def test_radius_and_speed_are_limited(asked, radius, velocity):
    found = orbit_of(asked, (0.0, 0.0, -2.0), 0.0, 1000.0, None)
    assert (found and found.radius, found and found.velocity) == (
        radius,
        pytest.approx(velocity) if velocity else None,
    )


def test_values_that_are_not_given_are_those_of_the_present_circle():
    found = orbit_of(request(NAN, NAN), (1.0, 1.0, -2.0), 0.2, 1000.0, orbit(velocity=-1.5))
    assert found is not None
    assert (found.radius, found.velocity, found.centre) == (3.0, -1.5, (1.0, 1.0, -2.0))


def place(lane: Lane, north: float, east: float) -> tuple[float, float]:
    n, e = lane.start[0] + north, lane.start[1] + east
    radius = 6_371_000.0
    return LAT + math.degrees(n / radius), LON + math.degrees(e / (radius * math.cos(math.radians(LAT))))


def go_round(lane: Lane, radius: float, speed: float) -> Wait:
    lat, lon = place(lane, 0.0, 0.0)
    return (yield from lane.command(34, radius, speed, 0, 0, lat, lon, ALT + 2.0))


def hovering(lane: Lane) -> Wait:
    yield from lane.take_off_offboard(2.0)
    assert (yield from lane.set_mode(4, 3)) == 0
    yield from lane.run(1.0)


@scenario
def test_vehicle_circles_with_its_nose_to_the_centre_until_it_is_held(lane: Lane) -> Wait:
    yield from hovering(lane)
    assert (yield from go_round(lane, 2.5, 1.5)) == 0
    yield from lane.until(lambda: abs(lane.away_level() - 2.5) < 0.3, 20)
    yield from lane.run(3.0)
    lane.clear()
    turned, before = 0.0, math.atan2(*lane.position[1::-1])
    for _ in range(250):
        yield from lane.run(0.04)
        now = math.atan2(*lane.position[1::-1])
        turned += (now - before + math.pi) % (2 * math.pi) - math.pi
        before = now
        assert abs(lane.away_level() - 2.5) < 0.5 and abs(lane.position[2] + 2.0) < 0.3
    assert turned == pytest.approx(1.5 / 2.5 * 10.0, rel=0.15)  # clockwise
    facing = lane.vehicle.yaw() - math.atan2(-lane.position[1], -lane.position[0])
    assert abs((facing + math.pi) % (2 * math.pi) - math.pi) < 0.4
    status = lane.flight.pilots.interfaces[lane.i]
    assert status.vehicle.orbit is not None and lane.mode == "AUTO.LOITER"
    assert (yield from lane.set_mode(4, 3)) == 0
    yield from lane.run(4.0)
    assert np.linalg.norm(lane.v_n) < 0.2 and lane.vehicle.orbit is None


@scenario
def test_orbit_ends_with_a_landing_and_is_not_resumed(lane: Lane) -> Wait:
    yield from hovering(lane)
    assert (yield from go_round(lane, -2.0, 1.0)) == 0
    yield from lane.run(4.0)
    assert (yield from lane.command(mavlink.MAV_CMD_NAV_LAND)) == 0
    yield from lane.until(lambda: not lane.armed, 30)
    assert lane.vehicle.orbit is None


@scenario(GF_ACTION=2, GF_MAX_HOR_DIST=4.0)
def test_orbit_across_the_geofence_is_refused(lane: Lane) -> Wait:
    yield from hovering(lane)
    here = lane.position.copy()
    assert (yield from go_round(lane, 5.0, 1.0)) != 0
    assert "Orbit is outside geofence" in lane.texts()
    assert (yield from go_round(lane, 5000.0, 1.0)) != 0
    yield from lane.run(2.0)
    assert lane.away(here) < 0.2 and lane.vehicle.orbit is None


@scenario
def test_orbit_around_a_place_on_earth_is_refused_without_an_origin(lane: Lane) -> Wait:
    """The vehicle must not circle around its own position instead."""
    yield from hovering(lane)
    lane.vehicle.origin = None
    assert (yield from go_round(lane, 2.0, 1.0)) != 0
    assert lane.vehicle.orbit is None and "Orbit rejected: no global origin" in lane.texts()


@scenario
def test_disarmed_vehicle_accepts_an_orbit_and_does_nothing(lane: Lane) -> Wait:
    assert (yield from go_round(lane, 2.0, 1.0)) == 0
    assert lane.vehicle.orbit is None and not lane.armed
