"""Preparation of vision samples by the EKF2_EV_* parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.autopilot.estimation.estimator import VisionSample
from arena.autopilot.estimation.vision_input import vision_batch
from arena.autopilot.param_table import Params
from arena.geometry import quat_from_euler

NAN4 = (math.nan,) * 4
LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]] * 2)


def params(**values: float) -> Params:
    found = Params(2)
    for name, value in values.items():
        found.set(1, name, value)
    return found


def sample(q_nb=(1.0, 0.0, 0.0, 0.0)) -> VisionSample:
    return VisionSample(p_n=(1.0, 2.0, -3.0), q_nb=q_nb, var_p=(0.01, 0.02, 0.03), var_yaw=0.04)


def test_default_ekf2_ev_ctrl_fuses_nothing():
    assert vision_batch({0: sample(), 1: sample()}, Params(2), LEVEL) is None


def test_only_vehicles_that_fuse_vision_are_in_the_batch():
    batch = vision_batch({0: sample(), 1: sample()}, params(EKF2_EV_CTRL=11), LEVEL)
    assert batch is not None and batch.idx.tolist() == [1]
    assert batch.p_n.tolist() == [[1.0, 2.0, -3.0]] and batch.var_p.tolist() == [[0.01, 0.02, 0.03]]


def test_noise_mode_1_ignores_the_variances_of_the_message():
    batch = vision_batch({1: sample()}, params(EKF2_EV_CTRL=11, EKF2_EV_NOISE_MD=1), LEVEL)
    assert batch is not None and not batch.var_p.any() and not batch.var_yaw.any()


@pytest.mark.parametrize("given", [True, False], ids=["attitude of the sample", "estimated attitude"])
def test_position_of_the_measured_point_is_subtracted_in_body_axes(given):
    east = quat_from_euler(np.array([0.0, 0.0, math.pi / 2]))
    set_to = params(EKF2_EV_CTRL=11, EKF2_EV_POS_X=0.1, EKF2_EV_POS_Z=-0.05)
    q = tuple(east.tolist()) if given else NAN4
    batch = vision_batch({1: sample(q)}, set_to, LEVEL if given else np.stack([LEVEL[0], east]))
    assert batch is not None and batch.p_n[0] == pytest.approx([1.0, 1.9, -2.95])
