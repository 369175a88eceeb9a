"""Test that docs/reference/slices.md lists every key of every slice."""

from __future__ import annotations

import re

import pytest

from arena.plan import make_plan
from arena.plan.replay import ReplayedVehicle, ReplaySettings, make_replay_plan
from arena.schema import load_arena

from .pages import ROOT

YAML = """
copilot: {}
geofence: {north: [-3, 3], east: [-1.5, 1.5], up: 2}
mocap: {source: natnet, server: 127.0.0.3}
px4: {home: stand-in}
tools: {ros2: true}
vehicles:
  uav1: {start: {position: [0, 0, 0]}, autopilot: builtin, program: hover.py, neighbours: [uav2]}
  uav2: {start: {position: [1, 0, 0]}, autopilot: hardware, profile: iris, radio: none, url: "udpin:127.0.0.1:15000"}
  uav3: {start: {position: [2, 0, 0]}, autopilot: px4}
"""
FUSED = """
sim: {processes: one}
vehicles:
  uav1: {autopilot: builtin, program: hover.py}
"""
PAGE = (ROOT / "docs/reference/slices.md").read_text()
SECTIONS = dict(re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))


@pytest.fixture(scope="module")
def slices(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slices")
    (folder / "hover.py").write_text("")
    made = {}
    for text in (YAML, FUSED):
        (folder / "arena.yaml").write_text(text)
        made |= make_plan(load_arena(folder / "arena.yaml")).slices
    vehicle = ReplayedVehicle(name="uav1", id=1, body="uav1", simulated=True)
    settings = ReplaySettings(name="lab", sources=["flight.mcap"], vehicles=[vehicle], size_m=(7.0, 4.0, 3.0))
    return made | {"replay.json": make_replay_plan(settings).slices["replay.json"]}


@pytest.mark.parametrize("section", sorted(SECTIONS))
def test_section_lists_exactly_the_keys_of_its_slices(slices, section):
    kind = section.partition(".")[0]
    found = [content for name, content in slices.items() if name.split(".")[0] == kind]
    assert found, section
    listed = set(re.findall(r"^\| `(\w+)` \|", SECTIONS[section], re.M))
    assert {key for content in found for key in content} - {"name"} == listed


def test_every_kind_of_slice_has_a_section(slices):
    assert {name.split(".")[0] for name in slices} == {section.partition(".")[0] for section in SECTIONS}
