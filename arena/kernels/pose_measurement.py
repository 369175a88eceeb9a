"""Poses as emulated cameras measure them: true poses with noise and injected offsets.

The axes are those of the capture system.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.arrays import floats, integers

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats

_H = math.sqrt(0.5)


class PoseMeasurement:
    """Emulated measurement of the poses of B rigid bodies.

    rows: row of each body in the true poses (B,)
    noise: standard normal numbers of the next frames: position, rotation (N, B, 6)
    sigma_m, sigma_rad: standard deviation of position [m] and rotation [rad]
    offset_n, rotation: injected offset [m] [NED] (B, 3) and rotation [-] wxyz (B, 4)
    position_w: output: position [m] [z-up capture axes] (B, 3)
    quat_xyzw_wf: output: rotation from the body's FLU axes to the capture axes [-] (B, 4)
    """

    def __init__(self, rows: NDArray[np.int64], frames: int, sigma_m: float, sigma_rad: float) -> None:
        b = len(rows)
        self.rows, self.noise = integers(rows), floats(frames, b, 6)
        self.sigma_m, self.sigma_rad = sigma_m, sigma_rad
        self.offset_n, self.rotation = floats(b, 3), floats(b, 4)
        self.position_w, self.quat_xyzw_wf = floats(b, 3), floats(b, 4)

    def measure(self, p_n: Floats, q_nb: Floats, frame: int) -> None:
        """Compute the measured poses of all bodies.

        p_n, q_nb: true positions [m] [NED] (V, 3) and attitudes [-] wxyz (V, 4)
        frame: row of `noise`
        """
        for i in range(len(self.rows)):
            row, noise, offset = self.rows[i], self.noise, self.offset_n
            north = p_n[row, 0] + self.sigma_m * noise[frame, i, 0] + offset[i, 0]
            east = p_n[row, 1] + self.sigma_m * noise[frame, i, 1] + offset[i, 1]
            down = p_n[row, 2] + self.sigma_m * noise[frame, i, 2] + offset[i, 2]
            self.position_w[i, 0], self.position_w[i, 1], self.position_w[i, 2] = east, north, -down
            self._turn(i, (q_nb[row, 0], q_nb[row, 1], q_nb[row, 2], q_nb[row, 3]), frame)

    def _turn(self, i: int, q_nb: rotations.Quaternion, frame: int) -> None:
        """Compute the measured attitude of body i.

        This is `arena.geometry.q_wf_from_q_nb`, written out. q_nb: its true attitude wxyz.
        """
        sigma, noise, turn = self.sigma_rad, self.noise, self.rotation
        error = rotations.from_rotation_vector(
            sigma * noise[frame, i, 3], sigma * noise[frame, i, 4], sigma * noise[frame, i, 5]
        )
        a, b, c, d = rotations.product(
            (turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3]), rotations.product(q_nb, error)
        )
        self.quat_xyzw_wf[i, 0], self.quat_xyzw_wf[i, 1] = _H * (b + c), _H * (b - c)
        self.quat_xyzw_wf[i, 2], self.quat_xyzw_wf[i, 3] = _H * (a - d), _H * (a + d)
