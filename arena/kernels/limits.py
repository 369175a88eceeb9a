"""Limits of numbers and of vectors with two elements, in plain floats."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Pair = tuple[float, float]


def within(x: float, low: float, high: float) -> float:
    """Limit x to the range low .. high. NaN stays NaN."""
    if x < low:
        return low
    return high if x > high else x


def length(x: float, y: float) -> float:
    """Return the length of the vector (x, y)."""
    return math.sqrt(x * x + y * y)


def shortened(x: float, y: float, most: float) -> Pair:
    """Limit the length of the vector (x, y) to `most`."""
    share = min(1.0, most / max(length(x, y), 1e-9))
    return x * share, y * share


def sum_within(x: float, y: float, dx: float, dy: float, most: float) -> Pair:
    """Return (x, y) + (dx, dy), with the second vector shortened if the sum is longer than `most`.

    The first vector has priority: it is kept up to the limit, and the second vector is shortened. The sum ends
    where the ray from the first vector along the second leaves the circle of radius `most`.
    """
    if length(x + dx, y + dy) <= most:
        return x + dx, y + dy
    x, y = shortened(x, y, most)
    left = most * most - (x * x + y * y)
    if left <= 1e-9:  # the first vector alone reaches the limit
        return x, y
    size = max(length(dx, dy), 1e-9)
    ahead = (x * dx + y * dy) / size
    share = (math.sqrt(ahead * ahead + left) - ahead) / size
    return x + dx * share, y + dy * share
