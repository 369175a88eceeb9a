"""Preparation of vision samples by the EKF2_EV_* parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.autopilot.estimation.estimator import VisionSample
from arena.autopilot.estimation.vision_input import VisionInput
from arena.autopilot.param_table import Params
from arena.geometry import quat_from_euler

NAN4 = (math.nan,) * 4


def params(**values: float) -> Params:
    found = Params(2)
    for name, value in values.items():
        found.set(1, name, value)
    return found


def sample(q_nb=(1.0, 0.0, 0.0, 0.0)) -> VisionSample:
    return VisionSample(p_n=(1.0, 2.0, -3.0), q_nb=q_nb, var_p=(0.01, 0.02, 0.03), var_yaw=0.04)


def prepared(given: Params, i: int, used: VisionSample, q_nb=(1.0, 0.0, 0.0, 0.0)) -> VisionSample | None:
    return VisionInput(given).prepare(i, used, lambda: list(q_nb))


def test_default_ekf2_ev_ctrl_fuses_nothing():
    assert prepared(Params(2), 0, sample()) is None


def test_only_vehicles_that_fuse_vision_have_a_sample_to_fuse():
    assert prepared(params(EKF2_EV_CTRL=11), 0, sample()) is None
    assert prepared(params(EKF2_EV_CTRL=11), 1, sample()) == sample()


def test_a_parameter_that_changes_acts_on_the_next_sample():
    changing = Params(2)
    vision = VisionInput(changing)
    assert vision.prepare(1, sample(), list) is None
    changing.set(1, "EKF2_EV_CTRL", 11)
    assert vision.prepare(1, sample(), list) == sample()


def test_noise_mode_1_ignores_the_variances_of_the_message():
    found = prepared(params(EKF2_EV_CTRL=11, EKF2_EV_NOISE_MD=1), 1, sample())
    assert found is not None and not any(found.var_p) and not found.var_yaw


@pytest.mark.parametrize("given", [True, False], ids=["attitude of the sample", "estimated attitude"])
def test_position_of_the_measured_point_is_subtracted_in_body_axes(given):
    east = tuple(quat_from_euler(np.array([0.0, 0.0, math.pi / 2])).tolist())
    set_to = params(EKF2_EV_CTRL=11, EKF2_EV_POS_X=0.1, EKF2_EV_POS_Z=-0.05)
    found = prepared(set_to, 1, sample(east if given else NAN4), (1.0, 0.0, 0.0, 0.0) if given else east)
    assert found is not None and found.p_n == pytest.approx([1.0, 1.9, -2.95])


@pytest.mark.parametrize("name", ["EKF2_EV_POS_X", "EKF2_EV_POS_Y", "EKF2_EV_POS_Z"])
def test_offset_that_no_vehicle_has_is_refused(name):
    """A ground station could write 1e30, and the estimate became NaN."""
    table = Params(1)
    table.set(0, name, 0.25)
    with pytest.raises(ValueError, match=name):
        table.set(0, name, 1e30)
    assert table[name][0] == 0.25
