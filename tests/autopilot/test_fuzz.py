"""Fuzzed MAVLink: it never crashes the autopilot, never blows it up, never moves a vehicle that was not told to move.

Here a share of the campaign and what it found; `python benchmarks/fuzz.py` sends a hundred thousand messages.
"""

from __future__ import annotations

import math

import campaign
import numpy as np
import pytest
from campaign import check
from flight import Flight
from fuzzing import KINDS, Fuzz, read
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from test_face import ready

from arena.autopilot.estimation.estimator import _repaired

SHARE = {"powerless": 6000, "ground": 2500, "hover": 3000, "offboard": 300, "wild": 300}


@pytest.mark.parametrize("phase", SHARE)
def test_a_share_of_the_campaign(phase):
    tally = campaign.PHASES[phase](SHARE[phase], seed=2)
    assert tally.sent.total() >= SHARE[phase]
    assert tally.refused.total() > 0


@pytest.fixture(scope="module")
def noisy():
    flight = campaign.Noisy(seed=0, battery=0.0)
    flight.run(2.0)
    return flight


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.randoms(use_true_random=False), st.integers(1, 8))
def test_whatever_is_said_to_a_vehicle_without_power_leaves_it_at_rest_and_repaired(noisy, rng, count):
    noisy.fuzz = Fuzz(rng)
    noisy.shout([x for _ in range(count) for x in noisy.fuzz.some()])
    noisy.run(0.02)
    check(noisy)
    assert not noisy.armed(0) and not noisy.motors.any()


@settings(max_examples=60, deadline=None)
@given(st.randoms(use_true_random=False), st.sampled_from(sorted(KINDS)))
def test_every_message_of_the_dialect_can_be_said_absurdly_and_is_still_valid(rng, name):
    assert read(Fuzz(rng).frame(name)).get_type() == name


# -- what fuzzing found ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lat", "lon", "alt", "taken"),
    [
        (90.0, 180.0, 0.0, True),
        (-90.0, -180.0, 0.0, True),
        (38.7, -9.1, 2147483.0, False),
        (38.7, -9.1, -12_001.0, False),
    ],
)
def test_an_origin_on_a_pole_is_flown_on_and_one_in_space_is_not_taken(lat, lon, alt, taken):
    flight = ready()
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(lat * 1e7), int(lon * 1e7), int(alt * 1e3), 0)
    )
    flight.heard[0].clear()
    flight.run(2.5)
    told = [m for m in flight.heard[0] if m.get_type() in ("GLOBAL_POSITION_INT", "HOME_POSITION")]
    assert bool(told) == taken
    for m in told:
        places = (m.lat, m.lon) if m.get_type() == "GLOBAL_POSITION_INT" else (m.latitude, m.longitude)
        assert abs(places[0]) <= 90e7 and abs(places[1]) <= 180e7


def test_an_interval_beyond_what_can_be_told_is_cut_and_asking_often_takes_no_memory():
    flight = ready()
    for _ in range(500):
        assert flight.pilots.interfaces[0].links["router"].schedule is not None
        flight.send(0, mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 3e38, 0, 0, 0, 0, 0))
    assert len(flight.pilots.interfaces[0].links["router"].schedule) < 40
    flight.run(0.04)
    assert flight.command(0, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == 0
    told = [m for m in flight.heard[0] if m.get_type() == "MESSAGE_INTERVAL"]
    assert [m.interval_us for m in told] == [2_147_000_000]


def _offboard_for(seconds: float, **fields: float) -> Flight:
    """In the air, then this setpoint of velocity and acceleration, said all the time."""
    flight = ready()

    def stream(f: Flight) -> None:
        f.setpoint(0, [0.0, 0.0, -5.0])

    flight.run(0.3, stream)
    assert flight.offboard(0) == flight.arm(0) == 0
    flight.run(9.0, stream)
    said = (
        {"vx": 0.0, "vy": 0.0, "vz": 0.0}
        | dict.fromkeys(("afx", "afy", "afz", "yaw", "yaw_rate"), math.nan)
        | fields
    )
    m = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b111, 0, 0, 0, *said.values())
    flight.run(seconds, lambda f: f.send(0, m))
    return flight


def test_an_absurd_acceleration_leaves_no_integral_that_flies_the_vehicle_away_afterwards():
    flight = _offboard_for(0.5, afx=9e5, afy=0.0)
    assert np.abs(flight.pilots.cascade.position.integral).max() < 10.0


def test_an_absurd_yaw_rate_turns_the_vehicle_and_does_not_tip_it_over():
    flight = _offboard_for(1.0, vx=5.0, yaw_rate=9e5)
    assert flight.mode(0) == "OFFBOARD"
    assert flight.pilots.est.r_nb[0, 2, 2] > math.cos(math.radians(60))
    assert np.abs(flight.world.truth().omega_b[0]).max() < math.radians(260)


@pytest.mark.parametrize("frame", [1, 8])
def test_a_setpoint_that_no_vehicle_could_follow_is_refused(frame):
    flight = ready()
    for k in range(9):
        values = [0.0] * 11
        values[k] = 3.4e38
        flight.send(0, mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, 0, *values))
    refused = 9 if frame == 1 else 6  # of a position in body axes nothing is read
    assert flight.pilots.vehicles[0].counts["refused setpoint"] == refused


def test_a_variance_that_rounding_made_negative_is_small_and_correlated_with_nothing():
    cov = np.full((2, 15, 15), 0.5) + np.eye(15)
    cov[1, 3, 3] = -1e-3
    sound = _repaired(cov.copy())
    assert np.array_equal(sound[0], cov[0])
    assert sound[1, 3, 3] > 0.0 and np.count_nonzero(sound[1, 3]) == np.count_nonzero(sound[1, :, 3]) == 1
    assert (np.linalg.eigvalsh(sound[1]) > 0.0).all()
