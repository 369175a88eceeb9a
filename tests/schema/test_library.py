"""The profiles that ship, the thrust curves, and finding both in a checkout and in a built package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.schema import load_profile, profile_names
from arena.schema.library import read_profile
from arena.thrust_curve import ThrustCurve, thrust_curve
from arena.vehicle_models.multirotor import LEAST_EFFECT, controlled_axes

ROOT = Path(__file__).parents[2]
CURVES = {name: load_profile(name).curve for name in ("iris", "intel_aero")}


def test_two_profiles_ship_with_arena() -> None:
    assert profile_names() == ["intel_aero", "iris"]


@pytest.mark.parametrize("name", ["iris", "intel_aero"])
def test_rotors_stand_in_px4s_order_and_balance(name: str) -> None:
    profile = load_profile(name)
    places = np.array([r.position_m for r in profile.rotors])
    assert [(x > 0, y > 0) for x, y, _ in places] == [
        (True, True),
        (False, False),
        (True, False),
        (False, True),
    ]
    assert [r.direction for r in profile.rotors] == ["ccw", "ccw", "cw", "cw"]
    assert np.abs(places.sum(axis=0)[:2]).max() < 1e-9, "equal thrusts must not turn it"
    ixx, iyy, izz = profile.inertia_kg_m2
    assert izz < ixx + iyy, "no rigid body has a moment above the sum of the others"
    assert profile.problems() == []


def test_every_figure_of_a_profile_names_its_source() -> None:
    for name in profile_names():
        for line in (ROOT / "profiles" / f"{name}.yaml").read_text().splitlines():
            if "mass_kg" in line or "inertia" in line or "radius_m" in line or "moment_ratio" in line:
                assert "#" in line, f"{name}: {line}"


def test_the_figures_of_the_thesis_hold() -> None:
    iris, aero = CURVES["iris"], CURVES["intel_aero"]
    u = np.linspace(0, 1, 11)
    assert np.allclose(iris.newtons(u), 34.068 * u**2 + 7.1202 * u)
    assert aero.max_newtons == pytest.approx(19.0, abs=0.01)
    t = np.linspace(5, 18.9, 20)
    assert np.allclose(aero.command(t), (np.tan((t - 10.37) / 8.84) + 1.478) / 2.955)
    hover = 1.52 * GRAVITY_M_S2
    assert iris.command(hover) == pytest.approx((hover - 14.906) / 45.34 + 0.561, abs=0.005), (
        "the tangent near hover"
    )
    assert iris.command(hover, 5.0) == pytest.approx(iris.command(hover / 0.8))


@pytest.mark.parametrize("name", CURVES)
@given(u=st.floats(0, 1))
def test_command_and_newtons_are_inverses(name: str, u: float) -> None:
    curve = CURVES[name]
    assert curve.command(curve.newtons(u)) == pytest.approx(u, abs=1e-9)
    assert curve.newtons(curve.command(u * curve.max_newtons)) == pytest.approx(
        u * curve.max_newtons, abs=1e-9
    )


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_never_wraps_and_never_falls(name: str) -> None:
    curve: ThrustCurve = CURVES[name]
    assert curve.newtons(0.0) == 0.0, "a motor that stands still gives nothing"
    assert np.all(np.diff(curve.newtons(np.linspace(0, 1, 2001))) > 0)
    for newtons, command in (
        (-5.0, 0.0),
        (24.26 if name == "intel_aero" else 60.0, 1.0),
        (1e9, 1.0),
        (np.inf, 1.0),
    ):
        assert curve.command(newtons) == pytest.approx(command, abs=1e-12) and curve.command(newtons) <= 1.0
    assert curve.command(10.0, 1e9) <= 1.0 and np.isfinite(curve.newtons(1.0, 1e9))
    assert curve.newtons(np.zeros((2, 3))).shape == (2, 3)


def test_a_curve_of_no_known_kind_is_refused() -> None:
    with pytest.raises(InputError, match="expected one of quadratic, tangent"):
        thrust_curve({"kind": "cubic"})


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg: 1.52", "mass_kg: -1", "mass_kg: got -1"),
        ("mass_kg: 1.52", "mass_kg: 9", "does not lift 9.0 kg"),
        ("num_rotors: 4", "num_rotors: 6", "`rotors` lists 4"),
        ("kind: quadratic", "kind: cubic", "thrust_curve"),
        ("radius_m: 0.275", "radius: 0.275", "Did you mean radius_m?"),
    ],
)
def test_problem_of_a_profile_has_its_line(old: str, new: str, words: str, tmp_path: Path) -> None:
    text = (ROOT / "profiles" / "iris.yaml").read_text()
    assert old in text
    (tmp_path / "p.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputError) as raised:
        read_profile(tmp_path / "p.yaml")
    assert words in str(raised.value) and f"{tmp_path}/p.yaml:" in str(raised.value)


def test_a_built_package_carries_profiles_and_templates(tmp_path: Path) -> None:
    build = [
        sys.executable,
        "setup.py",
        "-q",
        "build",
        "--build-base",
        str(tmp_path / "base"),
        "--build-lib",
        str(tmp_path / "lib"),
    ]
    egg = ["egg_info", "--egg-base", str(tmp_path)]
    env = {**os.environ, "ARENA_NO_COMPILE": "1"}  # this test needs no kernels, and they take 30 s
    subprocess.run(
        [*build[:3], *egg, *build[3:]], cwd=ROOT, env=env, check=True, capture_output=True, timeout=300
    )
    code = (
        "import arena, arena.schema as s; folder = s.data_folder('templates') / 'init';"
        "print(arena.__file__, s.profile_names(), sorted(p.name for p in folder.iterdir()))"
    )
    env = {**os.environ, "PYTHONPATH": str(tmp_path / "lib")}
    told = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=env,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    ).stdout
    assert str(tmp_path / "lib") in told and "['intel_aero', 'iris']" in told and "arena.yaml.j2" in told


@given(
    st.lists(
        st.tuples(*[st.floats(-1.0, 1.0)] * 2, st.sampled_from([-1.0, 1.0]), st.just(-1.0)),
        min_size=3,
        max_size=8,
    )
)
def test_controlled_axes_are_the_rank_that_numpy_finds(effect: list[tuple[float, ...]]) -> None:
    matrix = np.array(effect)
    scaled = matrix / np.maximum(np.abs(matrix).max(axis=0), 1e-9)
    sizes = np.linalg.svd(scaled, compute_uv=False)
    if np.abs(sizes - LEAST_EFFECT).min() > 1e-6:  # else both are right
        assert controlled_axes(effect) == (sizes > LEAST_EFFECT).sum()


@pytest.mark.parametrize("name", CURVES)
@given(share=st.floats(-0.5, 1.5))
def test_static_command_equals_the_command_at_rest(name: str, share: float) -> None:
    curve = CURVES[name]
    newtons = share * curve.max_newtons
    assert curve.static_command(newtons) == curve.command(newtons)
