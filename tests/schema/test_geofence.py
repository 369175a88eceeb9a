"""The geofence of the YAML: one box for all vehicles, with the room's walls where none are given."""

from __future__ import annotations

from pathlib import Path

import pytest

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


def test_missing_walls_are_the_rooms_less_the_margin(folder: Path) -> None:
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
