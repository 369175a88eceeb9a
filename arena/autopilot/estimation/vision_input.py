"""Samples of external vision that the estimator fuses in one step, prepared as the EKF2_EV_* parameters demand. Pure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.estimation.estimator import VisionSample
from arena.autopilot.param_table import Params
from arena.geometry import quat_rotate

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class VisionBatch(NamedTuple):
    """Samples of external vision of m vehicles, as arrays in the order of the arguments of `Estimator.fuse_vision`.

    idx: rows of the vehicles (m,)
    p_n: position of the autopilot [m] [NED] (m, 3)
    q_nb: attitude [-] wxyz, NaN if not given (m, 4)
    var_p, var_yaw: variances [m2] (m, 3) and [rad2] (m,), 0 if not given
    """

    idx: Index
    p_n: Array
    q_nb: Array
    var_p: Array
    var_yaw: Array


def vision_batch(samples: dict[int, VisionSample], params: Params, q_nb: Array) -> VisionBatch | None:
    """Return the samples to fuse, or None if there are none.

    EKF2_EV_CTRL 0 fuses nothing. With EKF2_EV_NOISE_MD 1 the variances in the messages are ignored. EKF2_EV_POS_X, _Y
    and _Z are the position of the measured point in body axes.

    samples: newest sample of each vehicle, by row
    q_nb: estimated attitudes of all vehicles [-] wxyz (V, 4), used for samples without an attitude
    """
    control = params["EKF2_EV_CTRL"]
    rows = [row for row in samples if control[row]]
    if not rows:
        return None
    idx, chosen = np.array(rows), [samples[row] for row in rows]
    p, q = np.array([s.p_n for s in chosen]), np.array([s.q_nb for s in chosen])
    from_message = params["EKF2_EV_NOISE_MD"][idx] == 0
    var_p = np.array([s.var_p for s in chosen]) * from_message[:, None]
    var_yaw = np.array([s.var_yaw for s in chosen]) * from_message
    offset_b = params.columns("EKF2_EV_POS_X", "EKF2_EV_POS_Y", "EKF2_EV_POS_Z")[idx]
    if offset_b.any():
        p = p - quat_rotate(np.where(np.isfinite(q), q, q_nb[idx]), offset_b)
    return VisionBatch(idx, p, q, var_p, var_yaw)
