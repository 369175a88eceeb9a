"""Mass, sensor noise and wind of one vehicle without a profile of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.plan import Plan, make_plan
from arena.schema import Arena, load_arena, load_profile

TEXT = """\
defaults:
  autopilot: builtin
  sensors: {imu: {accel_noise_m_s2: 0.1}, baro: {noise_m: 0.2}}
vehicles:
  uav1:
    mass_kg: 1.8
    sensors: {baro: {noise_m: 0.5}}
    wind_m_s: [1, 0, 0]
  uav2: {start: {position: [2, 0, 0]}}
"""


@pytest.fixture
def arena(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Arena:
    monkeypatch.chdir(tmp_path)
    Path("arena.yaml").write_text(TEXT)
    return load_arena("arena.yaml")


def bodies(plan: Plan) -> dict[str, dict[str, object]]:
    return {v["name"]: v for v in plan.slices["world.json"]["vehicles"]}


def test_mass_replaces_that_of_the_profile_and_moves_the_hover_thrust(arena: Arena) -> None:
    heavy, other = arena.vehicles
    iris = load_profile("iris")
    assert (heavy.profile.mass_kg, other.profile.mass_kg) == (1.8, iris.mass_kg)
    assert heavy.profile.inertia_kg_m2 == iris.inertia_kg_m2
    slices = bodies(make_plan(arena))
    hover = [slices[name]["params"]["MPC_THR_HOVER"] for name in ("uav1", "uav2")]  # type: ignore[index]
    assert hover[0] > hover[1] == iris.hover_command


def test_sensor_noise_is_merged_key_by_key(arena: Arena) -> None:
    one, two = (v.profile.sensors for v in arena.vehicles)
    iris = load_profile("iris").sensors
    assert (one.baro.noise_m, two.baro.noise_m) == (0.5, 0.2)
    assert one.imu.accel_noise_m_s2 == two.imu.accel_noise_m_s2 == 0.1
    assert one.imu.gyro_noise_rad_s == iris.imu.gyro_noise_rad_s and one.mag == iris.mag


def test_wind_reaches_the_world_for_one_vehicle(arena: Arena) -> None:
    slices = bodies(make_plan(arena))
    assert (slices["uav1"]["wind_m_s"], slices["uav2"]["wind_m_s"]) == ([1.0, 0.0, 0.0], None)


def test_origins_name_the_line_of_each_override(arena: Arena) -> None:
    found = {key: origin.source for key, origin in arena.origins.items()}
    assert found["vehicles.uav1.mass_kg"] == "arena.yaml:6"
    assert found["vehicles.uav1.sensors.baro.noise_m"] == "arena.yaml:7"
    assert found["vehicles.uav2.sensors.baro.noise_m"] == "arena.yaml:3"
    assert found["vehicles.uav2.mass_kg"] == "default: the profile's"


def test_resolved_yaml_keeps_the_overrides(arena: Arena) -> None:
    plan = make_plan(arena)
    Path("resolved.yaml").write_text(plan.yaml)
    assert make_plan(load_arena("resolved.yaml")).slices == plan.slices
