"""Functions of arrays that give the same bits on all CPUs of one architecture; and no room that changes a flight uses others."""

from __future__ import annotations

import ast
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arena import portable_math

ROOT = Path(__file__).parents[1] / "arena"
FLIGHT_ROOMS = (
    *("sim", "autopilot", "mocap/emulator", "pose_forwarder", "fused", "mavlink_router", "emulated_sensors"),
    *("vehicle_models", "geometry", "recorder", "wire", "uav", "trajectories", "controllers"),
    *("obstacles.py", "obstacle_surface.py", "thrust_curve.py"),
)
_NAMES = (
    "sin cos tan arcsin arccos arctan arctan2 sinh cosh tanh exp exp2 expm1 log log2 log10 log1p power float_power cbrt"
    " dot vdot inner matmul tensordot linalg"
)
CHOSEN_BY_CPU = set(_NAMES.split())
"""Functions of numpy whose results depend on the type of the CPU."""


def calls(tree: ast.AST) -> list[str]:
    """Return the uses of numpy's functions that depend on the CPU, of the operator @, and of ** with a fraction.

    numpy computes ** 0.5 as a square root, which is exact.
    """
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id="np"), attr=name) if name in CHOSEN_BY_CPU:
                found.append(f"line {node.lineno}: np.{name}")
            case ast.BinOp(op=ast.MatMult()):
                found.append(f"line {node.lineno}: @")
            case ast.BinOp(op=ast.Pow(), right=ast.Constant(value=exponent)) if (
                exponent % 1 and exponent != 0.5
            ):
                found.append(f"line {node.lineno}: ** {exponent}")
    return found


@pytest.mark.parametrize("room", FLIGHT_ROOMS)
def test_room_that_changes_a_flight_uses_no_function_that_depends_on_the_cpu(room: str) -> None:
    files = [ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py"))
    assert files
    wrong = {file.name: found for file in files if (found := calls(ast.parse(file.read_text())))}
    assert not wrong


@pytest.mark.parametrize(
    "name", ["sin", "cos", "tan", "arctan", "arcsin", "arccos", "exp", "arctan2", "power"]
)
def test_function_is_numpys_up_to_the_last_bits(name: str) -> None:
    ours, theirs = getattr(portable_math, name), getattr(np, name)
    arguments = 2 if name in ("arctan2", "power") else 1
    values = np.random.default_rng(1).random((arguments, 4, 3)) * 0.98 + 0.01
    assert ours(*values).shape == (4, 3) and ours(*values).dtype == np.float64
    assert np.abs(ours(*values) - theirs(*values)).max() <= 1e-15 * np.abs(theirs(*values)).max() * 4
    number: Any = ours(*values[:, 0, 0])
    assert isinstance(number, float) and number == ours(*values)[0, 0]


def test_element_without_a_result_is_nan() -> None:
    assert np.isnan(portable_math.sin([math.inf, math.nan])).all()
    assert math.isnan(portable_math.arcsin(2.0)) and math.isnan(portable_math.exp(1e9))


def test_products_solutions_and_inverses() -> None:
    rng = np.random.default_rng(2)
    a, b, many = rng.normal(size=(5, 5)), rng.normal(size=(5, 3)), rng.normal(size=(4, 2, 5))
    close = {"rtol": 1e-12, "atol": 1e-12}
    assert np.allclose(portable_math.product(a, b), a @ b, **close)
    assert np.allclose(portable_math.product(many, b), many @ b, **close)
    assert np.allclose(portable_math.product(a[0], b), a[0] @ b, **close)
    assert np.allclose(portable_math.solve(a, b), np.linalg.solve(a, b), **close)
    assert np.allclose(portable_math.right_inverse(b.T), np.linalg.pinv(b.T), **close)
    assert portable_math.norm([3.0, 4.0]) == 5.0
    with pytest.raises(ValueError, match="lower rank than 3"):
        portable_math.right_inverse([[1.0, 2.0, 0.0, 1.0], [2.0, 4.0, 0.0, 2.0], [0.0, 0.0, 1.0, 0.0]])
