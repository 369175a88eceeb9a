"""Preparation of external vision samples for the estimator, according to the EKF2_EV_* parameters. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from arena.autopilot.estimation.estimator import VisionSample
from arena.autopilot.param_table import Params
from arena.kernels import rotations

_NOT_GIVEN = 0.0  # variance


class VisionInput:
    """Prepares external vision samples of V vehicles for the estimator, according to the EKF2_EV_* parameters."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._read_params()

    def _read_params(self) -> None:
        p = self._params
        self._version = p.version
        self._control: list[float] = p["EKF2_EV_CTRL"].tolist()
        self._noise_mode: list[float] = p["EKF2_EV_NOISE_MD"].tolist()
        self._offsets_b = p.columns("EKF2_EV_POS_X", "EKF2_EV_POS_Y", "EKF2_EV_POS_Z").tolist()

    def prepare(
        self, i: int, sample: VisionSample, q_nb: Callable[[], Sequence[float]]
    ) -> VisionSample | None:
        """Return the sample to fuse, or None if the parameters of vehicle i disable the fusion.

        EKF2_EV_CTRL 0 fuses nothing. With EKF2_EV_NOISE_MD 1 the variances in the messages are ignored. EKF2_EV_POS_X, _Y
        and _Z are the position of the measured point in body axes.

        sample: newest sample of vehicle i
        q_nb: function that returns the estimated attitude of vehicle i [-] wxyz (4,), used for a sample without an attitude
        """
        if self._version != self._params.version:
            self._read_params()
        if not self._control[i]:
            return None
        if self._noise_mode[i]:
            sample = sample._replace(var_p=(_NOT_GIVEN,) * 3, var_yaw=_NOT_GIVEN)
        offset_b = self._offsets_b[i]
        if any(offset_b):
            a, b, c, d = sample.q_nb if math.isfinite(sample.q_nb[0]) else q_nb()
            x, y, z = rotations.rotated((a, b, c, d), (offset_b[0], offset_b[1], offset_b[2]))
            p = sample.p_n
            sample = sample._replace(p_n=(p[0] - x, p[1] - y, p[2] - z))
        return sample
