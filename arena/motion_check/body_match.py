"""Search for the captured rigid body that moves with a vehicle.

It compares only the sizes of rotation rates, so the axes of a body may be wrong. Pure.

The size of the rotation rate does not depend on the direction of a body's axes. A body that is fixed to the vehicle
therefore has the gyroscope's rotation rate at each time, even if its axes are defined wrongly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from arena.geometry import Array
from arena.motion_check.rotation import LARGEST_DELAY_S

MOVES_WITH = 0.9  # smallest correlation of a body that moves with the vehicle
_TOO_SIMILAR = (
    0.05  # another body whose correlation is at most so much smaller could be the vehicle's as well
)
_SMALLEST_RATIO, _LARGEST_RATIO = 0.7, 1.4
_STEP_S = 0.02
_FEWEST_SAMPLES = 10

Rates = tuple[Array, Array]


@dataclass(frozen=True, kw_only=True)
class BodyMatch:
    """Agreement of a captured body's rotation with the vehicle's gyroscope.

    correlation: of the sizes of both rotation rates over time, -1 to 1 [-]
    ratio: captured rotation rate divided by the measured one, root mean squares [-]
    """

    body: str
    correlation: float
    ratio: float

    @property
    def moves_with_vehicle(self) -> bool:
        """True if the body rotates as the gyroscope measures, so that it can be the vehicle's body."""
        return self.correlation >= MOVES_WITH and _SMALLEST_RATIO <= self.ratio <= _LARGEST_RATIO


def match_body(body: str, captured: Rates, gyro: Rates) -> BodyMatch:
    """Compare the rotation rates of a captured body with those of the vehicle's gyroscope.

    They are compared at the delay at which they agree best.

    captured, gyro: times [s] (N,) and rates [rad/s] [FRD] (N, 3), from `captured_rates` and `mean_rates`
    """
    ct, cw = captured[0], np.linalg.norm(captured[1], axis=1)
    gt, gw = gyro[0], np.linalg.norm(gyro[1], axis=1)
    if len(ct) < _FEWEST_SAMPLES or len(gt) < _FEWEST_SAMPLES:
        return BodyMatch(body=body, correlation=0.0, ratio=0.0)
    ratio = _rms(np.interp(gt, ct, cw)) / max(_rms(gw), 1e-9)
    delays = np.arange(-LARGEST_DELAY_S, LARGEST_DELAY_S + _STEP_S / 2.0, _STEP_S)
    best = max(_correlation(np.interp(gt + delay, ct, cw), gw) for delay in delays)
    return BodyMatch(body=body, correlation=best, ratio=ratio)


def similar_bodies(own: BodyMatch, others: Mapping[str, BodyMatch]) -> list[str]:
    """Return the names of other bodies whose rotation matches the gyroscope about as well as the vehicle's own body."""
    return [
        name
        for name, other in others.items()
        if other.moves_with_vehicle and other.correlation >= own.correlation - _TOO_SIMILAR
    ]


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum()) / scale if scale > 1e-9 else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))
