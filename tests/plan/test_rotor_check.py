"""Check of the rotors of simulated vehicles: roll, pitch, yaw and thrust must be controllable."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from arena.errors import InputError
from arena.plan import make_plan
from arena.schema import load_arena

IRIS = Path(__file__).parents[2] / "profiles" / "iris.yaml"
REAL = "autopilot: hardware, forward: false, url: 'udpin:0.0.0.0:14540'"


def rotor(angle_deg: float, direction: str) -> dict[str, Any]:
    a = math.radians(angle_deg)
    return {"position_m": [0.25 * math.cos(a), 0.25 * math.sin(a), 0.0], "direction": direction}


def problems(folder: Path, rotors: list[dict[str, Any]], keys: str = "") -> list[str]:
    """Return the problems of an arena with one vehicle that has these rotors."""
    profile = {**yaml.safe_load(IRIS.read_text()), "rotors": rotors, "num_rotors": len(rotors)}
    (folder / "own.yaml").write_text(yaml.safe_dump(profile))
    (folder / "arena.yaml").write_text(f"vehicles:\n  uav1: {{profile: ./own.yaml, {keys}}}\n")
    try:
        make_plan(load_arena(folder / "arena.yaml"))
    except InputError as error:
        return [str(problem) for problem in error.problems]
    return []


TRI = [rotor(60, "ccw"), rotor(-60, "ccw"), rotor(180, "cw")]
SAME_WAY = [rotor(a, "cw") for a in (45, 135, 225, 315)]
SIDES = [rotor(45, "cw"), rotor(-45, "cw"), rotor(135, "ccw"), rotor(-135, "ccw")]  # front cw, rear ccw
LINE = [
    {"position_m": [x, 0.0, 0.0], "direction": d}
    for x, d in ((0.3, "cw"), (0.1, "ccw"), (-0.1, "cw"), (-0.3, "ccw"))
]


@pytest.mark.parametrize("rotors", [TRI, SAME_WAY, SIDES, LINE], ids=["tri", "same way", "sides", "line"])
def test_rotors_that_cannot_control_all_axes_are_refused(
    tmp_path: Path, rotors: list[dict[str, Any]]
) -> None:
    (problem,) = problems(tmp_path, rotors)
    assert (
        "vehicles.uav1.profile: got iris" in problem
        and "control only 3 of roll, pitch, yaw and thrust" in problem
    )


@pytest.mark.parametrize("count", [4, 5, 6, 8])
def test_rotors_in_a_ring_are_accepted(tmp_path: Path, count: int) -> None:
    ring = [rotor(360.0 * (k + 0.5) / count, "ccw" if k % 2 else "cw") for k in range(count)]
    assert problems(tmp_path, ring) == []


def test_real_tricopter_is_accepted(tmp_path: Path) -> None:
    assert problems(tmp_path, TRI, REAL) == []
