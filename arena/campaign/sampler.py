"""Random samples of several ranges: uniform points and Latin hypercubes. Pure."""

from __future__ import annotations

from typing import Literal

import numpy as np

from arena.geometry import Array


def random_points(count: int, ranges: int, rng: np.random.Generator) -> Array:
    """Return random points (count, ranges), each coordinate uniformly distributed in [0, 1)."""
    return rng.random((count, ranges))


def latin_hypercube(count: int, ranges: int, rng: np.random.Generator) -> Array:
    """Return a Latin hypercube sample (count, ranges) in [0, 1).

    Each of `count` equal parts of each range contains exactly one point.

    Source: McKay, Beckman, Conover, Technometrics 21 (1979) 239.
    """
    parts = (
        np.stack([rng.permutation(count) for _ in range(ranges)], axis=1) if ranges else np.zeros((count, 0))
    )
    return (parts + rng.random((count, ranges))) / count


def in_range(share: Array, low: float, high: float, scale: Literal["linear", "log"]) -> Array:
    """Scale numbers between 0 and 1 to values between `low` and `high`, linearly or logarithmically.

    share: the numbers; 0 gives `low`, 1 gives `high`.
    scale: `linear`, or `log`: equal differences of `share` give equal ratios of values.
    """
    if scale == "log":
        return np.asarray(np.exp(np.log(low) + share * (np.log(high) - np.log(low))))
    return low + share * (high - low)


def whole_numbers(share: Array, low: float, high: float, scale: Literal["linear", "log"]) -> Array:
    """Scale numbers between 0 (included) and 1 (excluded) to integers between `low` and `high`.

    share: the numbers; 0 gives the lowest integer. On a linear scale, uniformly distributed numbers give all integers with the
        same probability.
    scale: as in `in_range`.
    """
    first, last = np.ceil(low), np.floor(high)
    if scale == "log":
        return np.asarray(np.clip(np.round(in_range(share, low, high, "log")), first, last))
    return np.asarray(np.minimum(first + np.floor(share * (last - first + 1)), last))
