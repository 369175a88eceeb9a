"""The estimator is honest under stress: it errs by no more than it says, and follows no pose that cannot be.

How the bounds come about, none of them from a result. Errors and innovations are normalised by the variance that the filter
itself claims: if it is right their mean square is chi-square over its degrees of freedom. Innovations are nearly independent,
errors are not, so the degrees are counted by the series' own autocorrelation (`stress.freedom`, after Bartlett) and added over
axes. One chance in a thousand that a sound filter fails any comparison of a flight is shared out among them (Bonferroni). The two
vehicles with an arena's parameters are told more noise than there is (PX4 takes no less than 10 mm and 0.05 rad), so for them
only the upper bound can hold. These bounds fail: BREAKS are mistakes put into the filter on purpose, and each is found.

A body that jumps is followed no further than dead reckoning drifts: 5 sigma of what the filter claims, and 0.05 m in 1 s, which
is a tilt wrong by 10 mrad, g * 0.01 * (1 s)^2 / 2. In 5 s that grows past the jump, so there half the smallest jump is the bound.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from stress import AS_ARENA, FAULTS, STRESSES, Stress, StressFlight, judge, misled, together

from arena.autopilot.estimation.estimator import Estimator, VisionSample
from arena.autopilot.mavlink.external_vision import from_odometry
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.constants import GRAVITY_M_S2
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_records import Odometry

MISLED = [Stress(name=name, matched=False) for name in FAULTS]
LATE = [Stress(name=name, matched=False, noaid_s=5.0) for name in ("0.5 m north", "frozen")]


def test_errors_and_innovations_are_as_large_as_the_filter_claims_in_hard_flight():
    stresses = [*STRESSES, *AS_ARENA]
    flight = StressFlight(stresses)
    flight.take_off()
    flight.run(3.0, StressFlight.hard)
    log = flight.log(12.0, StressFlight.hard)
    assert (np.degrees(log.tilt) > 20.0).mean() > 0.5, "not hard enough to prove anything"
    alpha = 1e-3 / (5 * (len(stresses) + 1))
    verdicts = [(s.name, v) for i, s in enumerate(stresses) for v in judge(log.series(i), alpha, s.matched)]
    verdicts += [
        ("all", v)
        for v in judge(together([log.series(i) for i in range(len(STRESSES))]), alpha, matched=False)
    ]
    assert not [(name, v) for name, v in verdicts if not v.holds]
    assert all(flight.mode(i) == "OFFBOARD" for i in range(len(stresses)))


BREAKS = ("none", "late", "sure of itself", "rates of the end")


def break_it(est: Estimator) -> None:
    """Row 1: a pose is taken to have been heard at the very step, as it was once. Row 2: half the noise is believed. Row 3: the
    rates at the end of a period are taken for all of it, as it was once."""
    fuse, predict, believed = est.fuse_vision, est.predict, np.array([1.0, 1.0, 0.25, 1.0])
    est._delay_s[1] -= 0.5 * est.dt

    def fuse_sure(idx, p, q, var_p, var_yaw, now):
        fuse(idx, p, q, var_p * believed[idx, None], var_yaw * believed[idx], now)

    def predict_by_the_end(accel_b, gyro_b):
        est.omega_b[3] = gyro_b[3] - est.gyro_bias[3]
        predict(accel_b, gyro_b)

    est.fuse_vision, est.predict = fuse_sure, predict_by_the_end


def test_each_filter_broken_on_purpose_is_found_and_the_sound_one_is_not():
    flight = StressFlight([Stress(name=name, delay_ms=5.0) for name in BREAKS])
    break_it(flight.est)
    flight.take_off()
    log = flight.log(5.0, StressFlight.hard)
    sound = {name: all(v.holds for v in judge(log.series(i), 1e-3 / 20)) for i, name in enumerate(BREAKS)}
    assert sound == {name: name == "none" for name in BREAKS}


def misled_flight(stresses: list[Stress]) -> StressFlight:
    flight = StressFlight(stresses, hz=500)
    flight.take_off()
    flight.run(3.0, StressFlight.hover)
    return flight


def let_go_wrong(flight: StressFlight) -> None:
    flight.faults = [FAULTS[s.name]() for s in flight.stresses]


def test_a_false_pose_does_not_draw_a_hovering_vehicle_away_and_is_declared_in_time():
    flight = misled_flight([*MISLED, *LATE])
    let_go_wrong(flight)
    for s, fate in zip(flight.stresses, misled(flight, 5.3, StressFlight.hover), strict=True):
        assert s.noaid_s - 0.1 < fate.declared_s < s.noaid_s + 0.2, s
        assert fate.drawn_m < (0.05 if s.noaid_s == 1.0 else 0.25), s
        assert fate.astray_m < 5.0 * fate.sigma_m, s
        assert fate.tilt_deg < 20.0, s


def test_in_hard_flight_a_false_pose_ends_upright_on_the_ground_near_by():
    flight = misled_flight(MISLED)
    flight.run(3.0, StressFlight.hard)
    let_go_wrong(flight)
    fates = misled(flight, 12.0, StressFlight.hard)
    for name, fate in zip(FAULTS, fates, strict=True):
        assert fate.declared_s < 1.2, name
        assert fate.tilt_deg < 60.0, name  # it flies with up to MPC_TILTMAX_AIR, 45
        assert fate.landed_off_m < 6.0, name  # the setpoints lie on a circle of this diameter
        assert fate.disarmed, name


def hovering() -> Estimator:
    """An estimator that has stood still for three seconds."""
    est = Estimator(Params(1), 1, 0.004)
    for k in range(750):
        est.predict(np.array([[0.0, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))
        if k % 4 == 0:
            see(est, 0.004 * k, 0.0)
    return est


def see(est: Estimator, now: float, north: float) -> None:
    p, q = np.array([[north, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0, 0.0]])
    est.fuse_vision(np.array([0]), p, q, np.full((1, 3), 1e-6), np.full(1, 1e-6), now)


@pytest.mark.parametrize(("comes_back", "followed"), [(False, False), (True, True)])
def test_a_gate_that_rejected_does_not_widen_until_it_lets_the_jump_in_and_lets_the_truth_back_in(
    comes_back, followed
):
    est = hovering()
    for k in range(2500):
        now = 3.0 + 0.004 * k
        est.predict(np.array([[0.0, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))
        if k % 4 == 0:
            see(est, now, 0.0 if comes_back and k > 250 else 0.8)
    assert bool(now - est.last_xy[0] < 0.1) is followed
    assert abs(est.p_n[0, 0]) < 0.05


def test_a_pose_that_repeats_to_the_last_bit_is_news_on_the_ground_and_none_in_the_air():
    vehicle = Vehicle(0, "uav1", 1, Params(1), Estimator(Params(1), 1, 0.004))
    pose = VisionSample((1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0), (1e-6,) * 3, 1e-6)
    for flying, wanted in ((False, pose), (True, None)):
        vehicle.inputs.flying = flying
        vehicle.vision = None
        vehicle.set_vision(pose)
        vehicle.vision = None
        vehicle.set_vision(pose)
        assert vehicle.vision == wanted
    assert vehicle.counts["vision repeated"] == 2


def test_the_age_of_a_pose_is_its_parameter_whatever_stamp_it_bears():
    none = [math.nan] * 21
    poses = []
    for stamp in (0, 1_000_000, 2**60):
        said = mavlink.MAVLink_odometry_message(
            stamp, 1, 12, 1, 2, 3, [1, 0, 0, 0], *none[:6], none, none, 0, 2, 0
        )
        data = Codec(1, 197).pack(said)
        poses.append(from_odometry(Odometry.read(data, parse_frames(data).frames[0])))
    assert poses[0] is not None
    assert poses[0] == poses[1] == poses[2]


def test_the_bounds_hold_for_what_is_sound_and_fail_for_what_is_not():
    """A first-order Markov series of unit variance is sound by construction; half again as large, or off by three, is not."""
    rng, wrong, missed = np.random.default_rng(3), 0, 0
    for _ in range(200):
        z = np.zeros(2000)
        for k in range(1, len(z)):
            z[k] = 0.95 * z[k - 1] + math.sqrt(1 - 0.95**2) * rng.normal()
        wrong += not judge({"sound": [z]}, 0.02)[0].holds
        missed += any(v.holds for v in judge({"larger": [1.5 * z], "off": [z + 3.0]}, 0.02))
    assert wrong <= 14  # of 200 at a chance of 0.02: 4 expected, 14 are five sigma more
    assert missed <= 14
