"""The kernel `standstill` gives the same results compiled and interpreted, and the loss of any one condition ends a standstill."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.kernels.kernel_versions import arrays_of, compiled_modules, interpreted_modules, needs_compiled

MODULES = ("rotor_dynamics", "free_flight", "standstill")
VEHICLES = 3
VERSIONS = [
    pytest.param(interpreted_modules, id="interpreted"),
    pytest.param(compiled_modules, id="compiled", marks=needs_compiled),
]


def standing(modules: dict[str, ModuleType]) -> tuple[Any, dict[str, np.ndarray]]:
    """Return the kernel and the arrays of rotors and bodies: two vehicles stand, the third flies."""
    rotors = modules["rotor_dynamics"].RotorDynamics(VEHICLES, 4, 64, 32)
    bodies = modules["free_flight"].FreeFlight(np.array([False, False, True]), 0.002)
    arrays = arrays_of(rotors) | arrays_of(bodies)
    arrays["speed_w"][2], arrays["motors"][2] = 1.0, 0.5
    arrays["speed_w"][0], arrays["rate_w"][0] = 5e-5, 5e-4
    return modules["standstill"].Standstill(rotors, bodies, 0.004), arrays


@pytest.mark.parametrize("version", VERSIONS)
def test_standstill_begins_after_a_tenth_of_a_second(version: Callable[..., dict[str, ModuleType]]) -> None:
    standstill, arrays = standing(version(*MODULES))
    assert [standstill.check() for _ in range(30)] == [False] * 24 + [True] * 6
    assert not arrays["speed_w"][:2].any() and not arrays["rate_w"][:2].any()
    assert (arrays["speed_w"][2] == 1.0).all(), "a vehicle in free flight is not held"
    standstill.end()
    assert not standstill.check()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    ("name", "value"),
    [("motors", 0.01), ("spin", 0.01), ("speed_w", -2e-4), ("rate_w", 2e-3), ("wind_n", 0.1)],
)
def test_one_condition_of_one_vehicle_ends_the_standstill(
    version: Callable[..., dict[str, ModuleType]], name: str, value: float
) -> None:
    standstill, arrays = standing(version(*MODULES))
    for _ in range(25):
        stands = standstill.check()
    assert stands
    arrays[name][2, 2] = value
    assert standstill.check(), "of the vehicle in free flight"
    arrays[name][1, 2] = value
    assert not standstill.check() and standstill.still_periods == 0
