"""Parameters of the built-in autopilot: each one is read by the autopilot or the world, or declared without effect."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from arena.builtin_parameters import SPECS, WITHOUT_EFFECT, effect_problem
from arena.params.facts.parameter_table import parameters

ROOT = Path(__file__).parents[1] / "arena"
# PX4's airframe for multirotors and the simulation set other defaults than the parameter reference
OTHER_DEFAULT = {
    "IMU_INTEG_RATE",
    "NAV_ACC_RAD",
    "RTL_DESCEND_ALT",
    "RTL_RETURN_ALT",
    "SYS_AUTOSTART",
    "SYS_FAILURE_EN",
}


def read_names() -> set[str]:
    """Return every text in the code of the autopilot and the world; gains of the rate controller are composed of two."""
    found: set[str] = set()
    for folder in ("autopilot", "sim"):
        for file in (ROOT / folder).rglob("*.py"):
            tree = ast.parse(file.read_text())
            found |= {
                n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)
            }
    gains = {f"MC_{axis}RATE_{term}" for axis in ("ROLL", "PITCH", "YAW") for term in "PIDK"}
    return found | gains


def test_every_parameter_is_read_or_declared_without_effect() -> None:
    read = read_names()
    assert {name for name in SPECS if name not in read} == set(WITHOUT_EFFECT)


@pytest.mark.parametrize("name", sorted(set(SPECS) - OTHER_DEFAULT))
def test_default_is_that_of_px4(name: str) -> None:
    known = parameters("1.16")[name]
    assert SPECS[name].default == pytest.approx(known.default)
    assert (SPECS[name].type == "int32") is (known.type == "INT32")


def test_unused_parameter_is_named_with_the_reason() -> None:
    assert effect_problem("MC_AIRMODE", 1) == (
        "the built-in autopilot does not use MC_AIRMODE: it never raises the thrust for roll, pitch or yaw"
    )
    assert effect_problem("MC_AIRMODE", 0) == "", "the default changes nothing"
    assert effect_problem("SENS_BOARD_ROT", 2) == "the built-in autopilot has no SENS_BOARD_ROT"
    assert effect_problem("MPC_XY_P", 1.2) == ""
