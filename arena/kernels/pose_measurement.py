"""Poses as emulated cameras measure them: true poses with noise and injected offsets.

The axes are those of the capture system.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import rotations
from arena.kernels.arrays import floats, integers
from arena.kernels.capture_types import MeasuredBody

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Floats

_H = math.sqrt(0.5)
_ATTITUDE = 3  # column of the attitude in the numbers of one vehicle, after the position
_new = tuple.__new__  # a NamedTuple's constructor costs twice as much


class PoseMeasurement:
    """Emulated measurement of the poses of B rigid bodies.

    numbers: number of each body in the stream (B,)
    rows: row of each body in the true states (B,)
    noise: standard normal numbers of the next frames: position, rotation (N, B, 6)
    sigma_m, sigma_rad: standard deviation of position [m] and rotation [rad]
    offset_n, rotation: injected offset [m] [NED] (B, 3) and rotation [-] wxyz (B, 4)
    """

    def __init__(
        self,
        numbers: Sequence[int],
        rows: NDArray[np.int64],
        frames: int,
        sigma_m: float,
        sigma_rad: float,
        per_vehicle: int,
    ) -> None:
        """Create the measurement, without offsets.

        frames: N.  per_vehicle: numbers of one vehicle in a row of the truth page
        """
        b = len(rows)
        self.numbers, self.rows, self.noise = list(numbers), integers(rows), floats(frames, b, 6)
        self.sigma_m, self.sigma_rad, self.per_vehicle = sigma_m, sigma_rad, per_vehicle
        self.offset_n, self.rotation = floats(b, 3), floats(b, 4)
        for i in range(b):
            self.rotation[i, 0] = 1.0

    def measure(self, states: Floats, frame: int) -> list[MeasuredBody]:
        """Return the measured poses of all bodies.

        states: true states: row of the truth page (1 + V * per_vehicle,)
        frame: row of `noise`
        """
        found: list[MeasuredBody] = []
        sigma, noise, offset = self.sigma_m, self.noise, self.offset_n
        for i in range(len(self.rows)):
            at = 1 + self.rows[i] * self.per_vehicle
            north = states[at] + sigma * noise[frame, i, 0] + offset[i, 0]
            east = states[at + 1] + sigma * noise[frame, i, 1] + offset[i, 1]
            down = states[at + 2] + sigma * noise[frame, i, 2] + offset[i, 2]
            q = at + _ATTITUDE
            x, y, z, w = self._quat_xyzw_wf(
                i, (states[q], states[q + 1], states[q + 2], states[q + 3]), frame
            )
            found.append(
                _new(MeasuredBody, (self.numbers[i], (east, north, -down), (x, y, z, w), sigma, True))
            )
        return found

    def _quat_xyzw_wf(self, i: int, q_nb: rotations.Quaternion, frame: int) -> rotations.Quaternion:
        """Return the measured rotation of body i from its FLU axes to the capture axes, xyzw.

        This is `arena.geometry.q_wf_from_q_nb`, written out. q_nb: its true attitude wxyz.
        """
        sigma, noise, turn = self.sigma_rad, self.noise, self.rotation
        error = rotations.from_rotation_vector(
            sigma * noise[frame, i, 3], sigma * noise[frame, i, 4], sigma * noise[frame, i, 5]
        )
        a, b, c, d = rotations.product(
            (turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3]), rotations.product(q_nb, error)
        )
        return _H * (b + c), _H * (b - c), _H * (a - d), _H * (a + d)
