"""The estimator under stress: its errors are as small as it claims, and it does not follow an impossible pose.

No bound is fitted to a result. Errors and innovations are normalised by the variance that the filter claims: if the claim is
right, their mean square is chi-square over its degrees of freedom. Innovations are nearly independent, errors are not; so the
degrees of freedom are estimated from the autocorrelation of the series (`stress.freedom`, after Bartlett) and added over axes. The
chance that a sound filter fails in a flight, one in a thousand, is divided among its comparisons (Bonferroni). The two vehicles
with the parameters of an arena assume more noise than there is (PX4 accepts no less than 10 mm and 0.05 rad), so only the upper
bound can hold for them. The bounds are sharp enough to find each mistake of BREAKS, which is put into the filter on purpose.

A pose that jumps is followed no further than dead reckoning drifts: 5 sigma of the claimed error, and 0.05 m in 1 s, which a tilt
error of 10 mrad causes, g * 0.01 * (1 s)^2 / 2. In 5 s the drift exceeds the jump, so there the bound is half the smallest jump.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from stress import AS_ARENA, FAULTS, STRESSES, Fate, Log, Stress, StressFlight, judge, misled, together

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.constants import GRAVITY_M_S2
from arena.kernels.arrays import array, floats
from arena.kernels.error_covariance import ErrorCovariance

MISLED = [Stress(name=name, matched=False) for name in FAULTS]
LATE = [Stress(name=name, matched=False, noaid_s=5.0) for name in ("0.5 m north", "frozen")]


BREAKS = ("none", "late", "overconfident", "rates of the end")


def break_filter(flight: StressFlight, first: int) -> None:
    """Put one mistake into each of the vehicles from row `first` + 1 on.

    1: a pose is taken as received at the step. 2: half the noise is assumed. 3: the rates at the end of a period hold for all of it.
    """
    est, predict = flight.est, flight.est.predict
    flight.claimed[first + 2] = 0.25
    est._delay_s[first + 1] -= 0.5 * est.dt

    def predict_by_the_end(accel_b, gyro_b):
        est.omega_b[first + 3] = gyro_b[first + 3] - est.gyro_bias[first + 3]
        predict(accel_b, gyro_b)

    est.predict = predict_by_the_end


@pytest.fixture(scope="module")
def hard_flight() -> tuple[StressFlight, Log]:
    """Ten sound filters and four of BREAKS in one hard flight."""
    flight = StressFlight([*STRESSES, *AS_ARENA, *(Stress(name=name, delay_ms=5.0) for name in BREAKS)])
    break_filter(flight, len(STRESSES) + len(AS_ARENA))
    flight.take_off()
    flight.run(3.0, StressFlight.hard)
    return flight, flight.log(8.0, StressFlight.hard)


def test_errors_and_innovations_in_hard_flight_are_as_large_as_claimed(hard_flight):
    flight, log = hard_flight
    stresses = [*STRESSES, *AS_ARENA]
    assert (np.degrees(log.tilt) > 20.0).mean() > 0.5, "the flight is not hard enough"
    alpha = 1e-3 / (5 * (len(stresses) + 1))
    verdicts = [(s.name, v) for i, s in enumerate(stresses) for v in judge(log.series(i), alpha, s.matched)]
    verdicts += [
        ("all", v)
        for v in judge(together([log.series(i) for i in range(len(STRESSES))]), alpha, matched=False)
    ]
    assert not [(name, v) for name, v in verdicts if not v.holds]
    assert all(flight.mode(i) == "OFFBOARD" for i in range(len(stresses)))


def test_mistakes_in_the_filter_are_found(hard_flight):
    _, log = hard_flight
    first = len(STRESSES) + len(AS_ARENA)
    sound = {
        name: all(v.holds for v in judge(log.series(first + i), 1e-3 / 20)) for i, name in enumerate(BREAKS)
    }
    assert sound == {name: name == "none" for name in BREAKS}


@pytest.fixture(scope="module")
def fates() -> list[Fate]:
    """Results of false poses: first in a hover, MISLED and LATE, then in hard flight, MISLED."""
    flight = StressFlight([*MISLED, *LATE, *MISLED], hz=500)
    hovering, hard = range(len(MISLED) + len(LATE)), range(len(MISLED) + len(LATE), len(flight.stresses))

    def fly(f: StressFlight) -> None:
        f.hover(rows=hovering)
        f.hard(rows=hard)

    flight.take_off()
    flight.run(4.0, fly)
    flight.faults = [FAULTS[s.name]() for s in flight.stresses]
    return misled(flight, 12.0, fly)


def test_false_pose_in_a_hover_is_reported_in_time_and_not_followed(fates):
    for s, fate in zip([*MISLED, *LATE], fates, strict=False):
        assert s.noaid_s - 0.1 < fate.declared_s < s.noaid_s + 0.2, s
        assert fate.drawn_m < (0.05 if s.noaid_s == 1.0 else 0.25), s
        assert fate.astray_m < 5.0 * fate.sigma_m, s
        assert fate.tilt_deg < 20.0, s


def test_false_pose_in_hard_flight_ends_upright_on_the_ground(fates):
    for name, fate in zip(FAULTS, fates[len(MISLED) + len(LATE) :], strict=True):
        assert fate.declared_s < 1.2, name
        assert fate.tilt_deg < 60.0, name  # it flies with up to MPC_TILTMAX_AIR, 45
        assert fate.landed_off_m < 6.0, name  # the setpoints lie on a circle of this diameter
        assert fate.disarmed, name


@pytest.mark.nightly
def test_long_campaign_of_hard_flights_and_false_poses():
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    import estimator

    assert estimator.in_hard_flight(3, 60.0)
    assert estimator.when_poses_lie()


def hovering() -> Estimator:
    """Return an estimator after 3 s at rest."""
    params = Params(1)
    params.set(0, "EKF2_EV_CTRL", 15)
    est = Estimator(params, 1, 0.004)
    for k in range(750):
        est.predict(np.array([[0.0, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))
        if k % 4 == 0:
            see(est, 0.004 * k, 0.0)
    return est


def see(est: Estimator, now: float, north: float) -> None:
    est.vision_input.receive(0, (north, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1e-6,) * 3, 1e-6)
    est.fuse_vision(now)


@pytest.mark.parametrize(("comes_back", "followed"), [(False, False), (True, True)])
def test_rejected_jump_stays_rejected_until_the_pose_returns(comes_back, followed):
    est = hovering()
    for k in range(1500):
        now = 3.0 + 0.004 * k
        est.predict(np.array([[0.0, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))
        if k % 4 == 0:
            see(est, now, 0.0 if comes_back and k > 250 else 0.8)
    assert bool(now - est.last_xy[0] < 0.1) is followed
    assert abs(est.p_n[0, 0]) < 0.05


def test_bounds_accept_a_sound_series_and_reject_a_wrong_one():
    """A first-order Markov series of unit variance is sound; one 1.5 times as large, or off by 3, is wrong."""
    rng, wrong, missed = np.random.default_rng(3), 0, 0
    for _ in range(200):
        z = np.zeros(2000)
        for k in range(1, len(z)):
            z[k] = 0.95 * z[k - 1] + math.sqrt(1 - 0.95**2) * rng.normal()
        wrong += not judge({"sound": [z]}, 0.02)[0].holds
        missed += any(v.holds for v in judge({"larger": [1.5 * z], "off": [z + 3.0]}, 0.02))
    assert wrong <= 14  # of 200 at a chance of 0.02: 4 expected, 14 are five sigma more
    assert missed <= 14


def test_negative_variance_is_made_small_and_uncorrelated():
    cov = np.full((2, 15, 15), 0.5) + np.eye(15)
    cov[1, 3, 3] = -1e-3
    covariance = ErrorCovariance(0.004, 2, floats(2, 3, 3), floats(2, 3), floats(2, 3))
    sound = array(covariance.cov)
    sound[:] = cov
    covariance.repair(0)
    covariance.repair(1)
    assert np.array_equal(sound[0], cov[0])
    assert sound[1, 3, 3] > 0.0 and np.count_nonzero(sound[1, 3]) == np.count_nonzero(sound[1, :, 3]) == 1
    assert (np.linalg.eigvalsh(sound[1]) > 0.0).all()
