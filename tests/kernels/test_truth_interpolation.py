"""Search in the ring of the truth page, by the compiled and by the interpreted kernel."""

from __future__ import annotations

import bisect
from types import ModuleType

import numpy as np
import pytest

from arena.kernels.arrays import view
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAME = "truth_interpolation"
VERSIONS = [
    pytest.param(interpreted_modules(NAME)[NAME], id="interpreted"),
    pytest.param(compiled_modules(NAME)[NAME], id="compiled", marks=needs_compiled),
]
HEAD, WIDTH, RING, PERIOD_S = 3, 4, 7, 0.004


@pytest.mark.parametrize("kernel", VERSIONS)
@pytest.mark.parametrize("oldest", [0, 5, 13])
def test_last_sample_before_a_time_is_found_in_the_ring(kernel: ModuleType, oldest: int) -> None:
    page, newest = np.full(HEAD + RING * WIDTH, np.nan), oldest + RING - 2
    times = [PERIOD_S * number for number in range(oldest, newest + 1)]
    for number, time_s in enumerate(times, oldest):
        page[HEAD + number % RING * WIDTH] = time_s
    for time_s in [*times, *(t + 1e-4 for t in times), times[0] - 1e-4]:
        found = kernel.sample_before(view(page), HEAD, WIDTH, RING, oldest, newest, time_s)
        assert found == oldest + bisect.bisect_right(times, time_s) - 1
