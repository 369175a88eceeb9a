"""Rotations of the kernels: compared with `arena.geometry`, compiled and interpreted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena import geometry
from arena.kernels import rotations
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

RNG = np.random.default_rng(3)
ATTITUDES = [tuple((q / np.linalg.norm(q)).tolist()) for q in RNG.normal(size=(40, 4))] + [
    (1.0, 0.0, 0.0, 0.0)
] * 2
PAIRS = list(zip(ATTITUDES, [*ATTITUDES[1:], ATTITUDES[0]], strict=True))
VECTOR = (0.3, -2.0, 1.1)


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_rotations_agree_with_geometry(a, b):
    assert rotations.euler(a) == pytest.approx(geometry.euler_from_quat(a), abs=1e-12)
    assert rotations.rotated(a, VECTOR) == pytest.approx(geometry.quat_rotate(a, VECTOR), abs=1e-12)
    back = geometry.quat_rotate(geometry.quat_conj(a), VECTOR)
    assert rotations.rotated_back(a, VECTOR) == pytest.approx(back, abs=1e-12)
    turned = geometry.quat_log(geometry.quat_between(a, b))
    assert rotations.rotation_vector(a, b) == pytest.approx(turned, abs=1e-12)
    between = geometry.quat_slerp(a, b, 0.3)
    assert rotations.slerp(a, b, 0.3) == pytest.approx(between, abs=1e-12)


def results(module):
    """Return the results of all functions as text, which distinguishes every bit of a number, and NaN."""
    pairs = [*PAIRS, ((math.nan, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0))]
    found = [[module.euler(a), module.rotated(a, VECTOR), module.rotated_back(a, VECTOR)] for a, _ in pairs]
    return repr([*found, *([module.rotation_vector(a, b), module.slerp(a, b, 0.3)] for a, b in pairs)])


@needs_compiled
def test_compiled_and_interpreted_rotations_are_equal():
    compiled, interpreted = (
        read("rotations")["rotations"] for read in (compiled_modules, interpreted_modules)
    )
    assert compiled is not interpreted and results(compiled) == results(interpreted)
