"""The estimator of the navigation experiment: converges from a wrong guess, and does not use wild distances."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

FILE = Path(__file__).parents[2] / "examples" / "thesis" / "navigation" / "range_filter.py"
BEACONS = np.array(
    [[3.4, 1.9, -0.3], [3.4, -1.9, -2.9], [-3.4, 1.9, -2.9], [-3.4, -1.9, -0.3], [0.0, 1.9, -0.3]]
)
NOISE_M, STEP_S = 0.05, 0.02


@pytest.fixture(scope="module")
def module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("range_filter", FILE)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def errors(module: ModuleType, wild: float = 0.0) -> np.ndarray:
    """Return the error of the position [m] (n,) on a circle of 1 m with 1 rad/s, after 10 s. wild: error of every 20th distance [m]."""
    random, found = np.random.default_rng(2), []
    one = module.RangeFilter([1.2, -0.3, -1.2], 0.3)
    for k in range(2000):
        t = k * STEP_S
        pos = np.array([np.cos(t), np.sin(t), -1.5 + 0.1 * np.sin(2 * t)])
        acc = np.array([-np.cos(t), -np.sin(t), -0.4 * np.sin(2 * t)])
        one.predict(acc + random.normal(0.0, 0.1, 3), STEP_S)
        beacon = BEACONS[k % len(BEACONS)]
        distance = np.linalg.norm(pos - beacon) + random.normal(0.0, NOISE_M)
        one.correct(beacon, distance + wild * (k % 20 == 7), NOISE_M)
        if t > 10.0:
            found.append(np.linalg.norm(one.pos - pos))
    return np.array(found)


def test_estimate_converges_from_a_wrong_guess(module: ModuleType) -> None:
    assert np.sqrt((errors(module) ** 2).mean()) < NOISE_M


def test_wild_distances_are_not_used(module: ModuleType) -> None:
    assert np.sqrt((errors(module, wild=5.0) ** 2).mean()) < NOISE_M
