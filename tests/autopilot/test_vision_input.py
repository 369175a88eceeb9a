"""Poses of external vision: which are accepted, and their preparation by the EKF2_EV_* parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.geometry import quat_from_euler
from arena.kernels.arrays import array

LEVEL, NONE = (1.0, 0.0, 0.0, 0.0), (math.nan,) * 4
P_N, VAR_P, VAR_YAW = (1.0, 2.0, -3.0), (0.01, 0.02, 0.03), 0.04
ACCEPTED, REFUSED, REPEATED = range(3)


def estimator(**values: float) -> Estimator:
    """Return an estimator of two vehicles. values: parameters of the second one"""
    params = Params(2)
    for name, value in values.items():
        params.set(1, name, value)
    est = Estimator(params, 2, 0.004)
    est.predict(np.tile([0.0, 0.0, -9.8], (2, 1)), np.zeros((2, 3)))
    return est


def see(est: Estimator, i: int, q_nb=LEVEL, p_n=P_N, var_p=VAR_P, var_yaw=VAR_YAW, now: float = 1.0) -> None:
    est.vision_input.receive(i, p_n, q_nb, var_p, var_yaw)
    est.fuse_vision(now)


def prepared(est: Estimator) -> list[float]:
    return array(est.vision_input.prepared)[1].tolist()


def counts(est: Estimator) -> list[int]:
    return np.asarray(est.vision_input.counts)[1].tolist()


def test_default_ekf2_ev_ctrl_fuses_nothing():
    est = estimator()
    see(est, 1)
    assert not est.aligned.any() and not est.vision_input.waiting_rows()


def test_only_vehicles_that_fuse_vision_use_their_poses():
    est = estimator(EKF2_EV_CTRL=11)
    see(est, 0)
    see(est, 1)
    assert est.aligned.tolist() == [False, True]
    assert prepared(est) == [*P_N, *LEVEL, *VAR_P, VAR_YAW]
    assert est.p_n[1].tolist() == list(P_N)


def test_a_parameter_that_changes_acts_on_the_next_pose():
    est = estimator()
    see(est, 1)
    est.params.set(1, "EKF2_EV_CTRL", 11)
    see(est, 1)
    assert est.aligned[1]


def test_noise_mode_1_ignores_the_variances_of_the_message():
    est = estimator(EKF2_EV_CTRL=11, EKF2_EV_NOISE_MD=1)
    see(est, 1)
    assert prepared(est) == [*P_N, *LEVEL, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("given", [True, False], ids=["attitude of the pose", "estimated attitude"])
def test_position_of_the_measured_point_is_subtracted_in_body_axes(given):
    east = tuple(quat_from_euler(np.array([0.0, 0.0, math.pi / 2])).tolist())
    est = estimator(EKF2_EV_CTRL=11, EKF2_EV_POS_X=0.1, EKF2_EV_POS_Z=-0.05)
    est.q_nb[1] = LEVEL if given else east
    see(est, 1, east if given else NONE)
    assert prepared(est)[:3] == pytest.approx([1.0, 1.9, -2.95])


@pytest.mark.parametrize("name", ["EKF2_EV_POS_X", "EKF2_EV_POS_Y", "EKF2_EV_POS_Z"])
def test_offset_that_no_vehicle_has_is_refused(name):
    """A ground station could write 1e30, and the estimate became NaN."""
    table = Params(1)
    table.set(0, name, 0.25)
    with pytest.raises(ValueError, match=name):
        table.set(0, name, 1e30)
    assert table[name][0] == 0.25


@pytest.mark.parametrize("value", [1e4, -1e4, math.nan, math.inf])
@pytest.mark.parametrize("axis", range(3))
def test_pose_without_a_possible_position_is_refused(axis, value):
    est = estimator(EKF2_EV_CTRL=11)
    see(est, 1, p_n=tuple(value if k == axis else 0.0 for k in range(3)))
    assert counts(est) == [0, 1, 0] and not est.aligned[1]


def test_attitude_is_normalised_and_one_that_is_not_a_quaternion_is_left_out():
    est = estimator(EKF2_EV_CTRL=11)
    see(est, 1, (0.0, 0.0, 0.0, 1.09))
    assert prepared(est)[3:7] == [0.0, 0.0, 0.0, 1.0]
    for q_nb in ((0.8, 0.0, 0.0, 0.0), (1.2, 0.0, 0.0, 0.0), (1.0, math.nan, 0.0, 0.0)):
        see(est, 1, q_nb)
        assert np.isnan(prepared(est)[3:7]).all()


def test_variances_that_are_not_given_count_as_zero():
    est = estimator(EKF2_EV_CTRL=11)
    see(est, 1, var_p=(-1.0, math.nan, math.inf), var_yaw=0.0)
    assert prepared(est)[7:] == [0.0] * 4


@pytest.mark.parametrize("q_nb", [LEVEL, NONE])
def test_repeated_pose_is_dropped_in_flight_only(q_nb):
    est = estimator(EKF2_EV_CTRL=11)
    vision = est.vision_input
    for flying, accepted in ((False, 2), (True, 2)):
        vision.flying[1] = flying
        vision.receive(1, P_N, q_nb, VAR_P, VAR_YAW)
        assert vision.waiting_rows() == ([] if flying else [1])
        vision.receive(1, P_N, q_nb, (1.0, 1.0, 1.0), 1.0)
        est.fuse_vision(1.0)
        assert counts(est)[ACCEPTED] == accepted
    assert counts(est) == [2, 0, 2]
    vision.receive(1, (1.0, 2.0, -3.001), q_nb, VAR_P, VAR_YAW)
    assert counts(est) == [3, 0, 2] and vision.waiting_rows() == [1]


def test_pose_waits_while_external_vision_has_failed():
    est = estimator(EKF2_EV_CTRL=11)
    est.vision_input.failed[1] = True
    see(est, 1)
    assert not est.aligned[1] and not est.vision_input.waiting_rows()
    est.vision_input.failed[1] = False
    est.fuse_vision(1.0)
    assert est.aligned[1]
