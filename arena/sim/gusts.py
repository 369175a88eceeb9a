"""Random gusts: Dryden turbulence of MIL-F-8785C for heights below 1000 ft. Pure, batched over vehicles.

Source: MIL-F-8785C, "Flying qualities of piloted airplanes", 1980, section 3.7.3.4 (low altitude). With the
height h [ft] and the wind speed W20 at 20 ft (6.1 m) above the ground:

    sigma_w = 0.1 W20                                  L_w = h
    sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    L_u = L_v = h / (0.177 + 0.000823 h)^1.2

u is along the steady wind, v across, w down. White noise passes through the filters of the same section, at
the airspeed V:

    H_u = sigma_u sqrt(2 a) / (s + a)                            a = V / L_u
    H_v = sigma_v sqrt(3 a) (s + a / sqrt(3)) / (s + a)^2        a = V / L_v; the same for w with L_w

The filters are discretised exactly: the states have the covariance of the continuous filters at any step.
Each state is divided by its standard deviation, so that the variance stays right while V and h change.

The specification is for heights of 10 ft (3.05 m) and more; below, the values at 10 ft are used. It assumes
that the vehicle flies through the gusts quickly. For a vehicle that hovers, gusts drift past at the speed W20
at least. Each vehicle has gusts of its own, also beside another vehicle. Not modelled: gusts of rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arena.portable_math import exp, power

Array = NDArray[np.float64]

_FOOT_M = 0.3048
_LOWEST_FT, _HIGHEST_FT = 10.0, 1000.0
_STREAM = 8785  # of the random generators: another number than those of the sensors
_BLOCK = 256
_NOISES = 5  # u has one filter state, v and w have two
_RHO = 1.0 / math.sqrt(2.0)  # correlation of the two states of v and of w
_OUT = (math.sqrt(1.5), math.sqrt(0.75) * (1.0 / math.sqrt(3.0) - 1.0))  # from the two states to v or w


class Gusts:
    """Generator of random gusts for V vehicles.

    Each vehicle has a random generator of its own. Adding a vehicle therefore does not change the gusts at the other vehicles.

    ids: system ids, which are part of the seeds
    wind_20ft: wind speed at 20 ft (6.1 m) above the ground, W20 [m/s]
    step_s: time between two calls of `step` [s]
    """

    def __init__(self, ids: Sequence[int], *, seed: int, wind_20ft: float, step_s: float) -> None:
        self._wind, self._h = wind_20ft, step_s
        self._streams = [np.random.default_rng([seed, vehicle, _STREAM]) for vehicle in ids]
        first = np.stack([s.standard_normal(_NOISES) for s in self._streams])
        self._u: Array = first[:, 0].copy()
        # Both states of v (row 0) and w (row 1), with their stationary covariance (2, V) each.
        self._one: Array = first[:, 1:3].T.copy()
        self._two: Array = _RHO * self._one + math.sqrt(1.0 - _RHO * _RHO) * first[:, 3:5].T
        self._next = _BLOCK

    def step(self, height: Array, v_n: Array, wind_n: Array) -> Array:
        """Return the gusts at each vehicle for the next step [m/s] [NED] (V, 3).

        height: height above the floor [m] (V,)
        v_n: velocity of the vehicles [m/s] [NED] (V, 3)
        wind_n: steady wind at the vehicles [m/s] [NED] (V, 3)
        """
        feet = np.minimum(np.maximum(height / _FOOT_M, _LOWEST_FT), _HIGHEST_FT)
        shape = 0.177 + 0.000823 * feet
        air_n = v_n - wind_n
        travel = np.maximum(np.sqrt((air_n * air_n).sum(1)), self._wind) * self._h  # of the air [m]
        along_lengths = travel / (feet * _FOOT_M) * power(shape, 1.2)
        noise = self._draw()
        decay = exp(-along_lengths)
        self._u = decay * self._u + np.sqrt(1.0 - decay * decay) * noise[:, 0]
        self._filter(np.stack([along_lengths, travel / (feet * _FOOT_M)]), noise)
        sigma_w = 0.1 * self._wind
        sigma_u = sigma_w / power(shape, 0.4)
        across, down = _OUT[0] * self._one + _OUT[1] * self._two
        return _ned(wind_n, sigma_u * self._u, sigma_u * across, sigma_w * down)

    def _filter(self, x: Array, noise: Array) -> None:
        """Advance the filters of the lateral gust v and the vertical gust w by one step.

        Each of these filters has two states.

        x: the step multiplied by V / L of v and w [-] (2, V)
        """
        t, decay = math.sqrt(2.0) * x, exp(-x)
        square = decay * decay
        # Covariance of the noise of one step: what the decay of the stationary covariance leaves to fill.
        q11 = 1.0 - square
        q12 = _RHO - square * (t + _RHO)
        q22 = 1.0 - square * (t * t + 2.0 * _RHO * t + 1.0)
        l11 = np.sqrt(q11)
        l21 = q12 / l11
        l22 = np.sqrt(np.maximum(q22 - l21 * l21, 0.0))
        first, second = noise[:, 1:3].T, noise[:, 3:5].T
        self._two = decay * (t * self._one + self._two) + l21 * first + l22 * second
        self._one = decay * self._one + l11 * first

    def _draw(self) -> Array:
        """Return independent standard normal numbers for the next step (V, 5)."""
        if self._next == _BLOCK:
            self._block = np.stack([s.standard_normal((_BLOCK, _NOISES)) for s in self._streams], axis=1)
            self._next = 0
        self._next += 1
        return np.asarray(self._block[self._next - 1])


def _ned(wind_n: Array, along: Array, across: Array, down: Array) -> Array:
    """Rotate gusts from the direction of the steady wind to NED (V, 3).

    wind_n: steady wind [m/s] [NED] (V, 3)
    along: part along the horizontal wind, or along north if there is no wind (V,)
    across: part to the right of `along` (V,)
    down: vertical part (V,)
    """
    speed = np.hypot(wind_n[:, 0], wind_n[:, 1])
    still = speed == 0.0
    north = np.where(still, 1.0, wind_n[:, 0] / np.where(still, 1.0, speed))
    east = np.where(still, 0.0, wind_n[:, 1] / np.where(still, 1.0, speed))
    return np.stack([along * north - across * east, along * east + across * north, down], axis=1)
