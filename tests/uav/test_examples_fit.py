"""The first example's places stay in its room, away from the walls and from each other."""

from __future__ import annotations

import ast
from math import pi
from pathlib import Path

import numpy as np
import pytest

from arena.schema.loader import load_yaml

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAM = EXAMPLES / "01_two_quads" / "position_setpoints.py"


def steps() -> list:
    tree = ast.parse(PROGRAM.read_text())
    value = next(n.value for n in tree.body if isinstance(n, ast.Assign) and n.targets[0].id == "STEPS")
    return eval(ast.unparse(value), {"pi": pi})


@pytest.mark.parametrize("folder", ["01_two_quads", "10_ten_quads"])
def test_places_keep_half_a_metre_from_walls_and_vehicles_keep_two_from_each_other(folder):
    arena = load_yaml(EXAMPLES / folder / "arena.yaml").data
    size = np.array(arena.get("world", {"size": [7, 4, 3]})["size"], float)
    starts = np.array([v["start"]["position"] for v in arena["vehicles"].values()], float)
    places = np.array([place for place, _, _ in steps()])
    flown = starts[:, None, :] + places[None, :, :]
    assert (np.abs(flown[..., :2]) <= size[:2] / 2 - 0.5).all()
    assert (-flown[..., 2] <= 2.5 - 0.5).all() and (-flown[..., 2] >= 0.5).all()
    apart = np.linalg.norm(starts[:, None] - starts[None], axis=-1) + 10 * np.eye(len(starts))
    assert apart.min() >= 2.0


def test_a_first_program_is_short():
    code = [line for line in PROGRAM.read_text().split('"""')[2].splitlines() if line.strip()]
    assert len(code) <= 20
