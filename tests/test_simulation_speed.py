"""Speed of a simulation as a number, and the factor on time limits that follows from it."""

from __future__ import annotations

import math

import pytest

from arena.simulation_speed import slowdown, speed_of


@pytest.mark.parametrize(
    ("value", "speed", "factor"),
    [("max", math.inf, 1.0), (5, 5.0, 1.0), (1.0, 1.0, 1.0), (0.25, 0.25, 4.0), ("0.5", 0.5, 2.0)],
)
def test_speed_and_slowdown(value: float | str, speed: float, factor: float) -> None:
    assert (speed_of(value), slowdown(value)) == (speed, factor)


def test_word_other_than_max_is_refused() -> None:
    with pytest.raises(ValueError, match="fast"):
        speed_of("fast")
