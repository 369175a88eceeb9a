"""`geofence:` is one box for everybody: what the YAML draws, what of it is the room's, and what it becomes for each vehicle."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from arena.params.facts.parameter_table import parameters, versions
from arena.params.generation.generate import generate
from arena.plan.text import arena_yaml
from arena.schema import Arena, load_arena
from arena.schema.arena import Fence

VEHICLES = """\
vehicles:
  uav1: {autopilot: builtin, start: {position: [1, 0.5, 0]}}
  uav2: {autopilot: builtin, start: {position: [-2, -1, -0.5]}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(text: str) -> Arena:
    Path("arena.yaml").write_text(text)
    return load_arena("arena.yaml")


def test_walls_that_are_not_given_are_the_rooms_and_the_margin_is_taken_off_once(folder: Path) -> None:
    room = "world: {size: [8, 6, 4]}\n"
    assert load(room + VEHICLES).geofence is None
    assert load(room + "geofence: {}\n" + VEHICLES).geofence == Fence(north=(-4, 4), east=(-3, 3), up=4)
    drawn = load(room + "geofence: {north: [-3, 2], up: 2.5, margin_m: 0.25}\n" + VEHICLES)
    assert drawn.geofence == Fence(north=(-2.75, 1.75), east=(-2.75, 2.75), up=2.25)
    told = {key: drawn.origins[f"geofence.{key}"].source for key in ("north", "east", "up")}
    assert told == {
        "north": "arena.yaml:2, less margin_m",
        "east": "default: the room's, less margin_m",
        "up": "arena.yaml:2, less margin_m",
    }


def test_the_resolved_yaml_draws_the_same_box(folder: Path) -> None:
    arena = load("geofence: {north: [-3, 2], margin_m: 0.25}\n" + VEHICLES)
    again = load(arena_yaml(arena))
    assert again.geofence == arena.geofence
    assert [v.params for v in again.vehicles] == [v.params for v in arena.vehicles]


def test_each_vehicles_circle_holds_the_whole_box_and_no_more_and_its_height_counts_from_where_it_stands(
    folder: Path,
) -> None:
    arena = load("geofence: {north: [-3, 2], up: 2.5}\n" + VEHICLES)
    assert arena.geofence is not None
    for v in arena.vehicles:
        n, e, d = v.position
        corners = [math.dist((n, e), (x, y)) for x in arena.geofence.north for y in arena.geofence.east]
        assert max(corners) <= v.params["GF_MAX_HOR_DIST"] < max(corners) + 0.002
        centre = v.profile.ground_clearance_m - d
        assert v.params["GF_MAX_VER_DIST"] == pytest.approx(2.5 - centre, abs=0.001)
        assert v.params["GF_ACTION"] == 5
        assert 0 < v.params["RTL_RETURN_ALT"] < v.params["GF_MAX_VER_DIST"]
        assert 0 < v.params["MIS_TAKEOFF_ALT"] < v.params["GF_MAX_VER_DIST"]
        assert arena.origins[f"vehicles.{v.name}.params.GF_MAX_VER_DIST"].source == "arena.yaml:1"


def test_without_a_geofence_nothing_changes(folder: Path) -> None:
    fenced, free = load("geofence: {}\n" + VEHICLES), load(VEHICLES)
    for a, b in zip(fenced.vehicles, free.vehicles, strict=True):
        assert {"GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "MIS_TAKEOFF_ALT"}.isdisjoint(b.params)
        assert {k: v for k, v in b.params.items() if "RTL" not in k}.items() <= dict(a.params).items()


@pytest.mark.parametrize("version", [str(v) for v in versions()])
def test_every_version_gets_it_in_its_own_limits(version: str, folder: Path) -> None:
    needs = load("geofence: {up: 2}\n" + VEHICLES).vehicles[0].needs
    values, known = generate(needs, version).values, parameters(version)
    for name in ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "MIS_TAKEOFF_ALT"):
        low, high = known[name].min, known[name].max
        assert known[name].type == "FLOAT"
        assert (low is None or values[name] >= low) and (high is None or values[name] <= high)


def test_a_real_vehicle_may_stand_anywhere_in_the_box(folder: Path) -> None:
    served = "mocap: {source: natnet, server: 10.0.0.2}\n"
    (real,) = load(
        served + "geofence: {}\nvehicles:\n  uav1: {autopilot: hardware, url: 'udpin:0.0.0.0:14580'}\n"
    ).vehicles
    assert real.params["GF_MAX_HOR_DIST"] == pytest.approx(math.hypot(7, 4), abs=0.001)


def test_without_poses_there_is_no_home_and_it_is_said(folder: Path) -> None:
    (blind,) = load("geofence: {}\nvehicles:\n  uav1: {autopilot: builtin, forward: false}\n").vehicles
    assert "GF_MAX_HOR_DIST" not in blind.params
    assert any("geofence: " in words and "no home" in words for words in blind.cannot)
