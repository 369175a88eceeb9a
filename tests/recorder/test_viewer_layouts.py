"""Layouts for Foxglove and PlotJuggler: every topic and field in them exists in a record."""

from __future__ import annotations

import functools
import json
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from viewer_records import UAV1, full_flight

from arena.recorder.foxglove_layout import MAX_PLOTTED, foxglove_layout
from arena.recorder.plotjuggler_layout import plotjuggler_layout
from arena.recorder.viewer_plots import DrawnVehicle

REAL = DrawnVehicle(name="uav1", simulated=False, rotors=6)
SIMULATED = DrawnVehicle(name="uav1", simulated=True, rotors=4)
SIZE_M = (8.0, 6.0, 3.0)


@functools.cache
def newest() -> dict[str, Any]:
    """Return the last message of each topic of a record."""
    return {topic: messages[-1][1] for topic, messages in full_flight().messages().items()}


def value_at(topic: str, fields: list[str]) -> Any:
    return functools.reduce(getattr, fields, newest()[topic])


def panels(vehicles: list[DrawnVehicle]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(foxglove_layout(vehicles, SIZE_M))["configById"]
    return found


def shown_panels(node: Any, config: dict[str, Any]) -> list[str]:
    """Return the ids of all panels below a node of the layout, those in tabs included."""
    if isinstance(node, str):
        tabs = config[node].get("tabs", ())
        return [node, *(name for tab in tabs for name in shown_panels(tab["layout"], config))]
    return shown_panels(node["first"], config) + shown_panels(node["second"], config)


@pytest.mark.parametrize("vehicle", [REAL, SIMULATED], ids=["real", "simulated"])
def test_every_path_of_the_foxglove_layout_exists(vehicle):
    paths = [p["value"] for panel in panels([vehicle]).values() for p in panel.get("paths", ())]
    assert len(paths) > 25
    for path in paths:
        topic, *fields = path.split(".")
        assert isinstance(value_at(topic, fields), (float, int, str)), path


def test_every_topic_of_the_foxglove_layout_exists():
    config = panels([SIMULATED])
    topics = set(config["3D!0"]["topics"])
    topics |= {
        panel[key] for panel in config.values() for key in ("topicPath", "topicToRender") if key in panel
    }
    assert topics <= set(newest())


def test_every_panel_is_in_the_layout_once():
    layout = json.loads(foxglove_layout([SIMULATED, REAL], SIZE_M))
    shown = shown_panels(layout["layout"], layout["configById"])
    assert sorted(shown) == sorted(layout["configById"])


def test_3d_view_shows_the_room_and_hides_the_frames_of_other_sources():
    view = panels([SIMULATED])["3D!0"]
    assert view["topics"]["/scene"]["visible"] and view["topics"]["/uav1/model"]["visible"]
    assert view["transforms"]["frame:uav1/truth"] == {"visible": False}
    assert view["cameraState"]["distance"] > np.hypot(*SIZE_M[:2])


@pytest.mark.parametrize("vehicle", [REAL, SIMULATED], ids=["real", "simulated"])
def test_every_curve_of_the_plotjuggler_layout_exists(vehicle):
    root = ElementTree.fromstring(plotjuggler_layout([vehicle]))
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) > 20
    topics = sorted(newest(), key=len, reverse=True)
    for curve in curves:
        topic = next(t for t in topics if curve.startswith(f"{t}/"))
        fields = curve.removeprefix(f"{topic}/").split("/")
        assert isinstance(value_at(topic, fields), float), curve


def test_splitters_of_the_plotjuggler_layout_count_their_plots():
    root = ElementTree.fromstring(plotjuggler_layout([SIMULATED]))
    splitters = list(root.iter("DockSplitter"))
    assert [tab.attrib["tab_name"] for tab in root.iter("Tab")] == ["uav1", "uav1 control"]
    for splitter in splitters:
        sizes = splitter.attrib["sizes"].split(";")
        assert len(splitter) == int(splitter.attrib["count"]) == len(sizes)


def test_plots_name_their_unit():
    config = panels([SIMULATED])
    titles = [panel["foxglovePanelTitle"] for name, panel in config.items() if name.startswith("Plot")]
    assert titles and all(re.search(r"\[.+\]$", title) for title in titles)


def test_large_arenas_have_plots_of_the_first_vehicles_and_modes_of_all():
    many = [DrawnVehicle(name=f"uav{k}", simulated=True, rotors=4) for k in range(1, 49)]
    config = panels(many)
    (tabs,) = (panel["tabs"] for name, panel in config.items() if name.startswith("Tab!"))
    assert len(tabs) == 2 * MAX_PLOTTED + 1
    (modes,) = (panel["paths"] for name, panel in config.items() if name.startswith("StateTransitions"))
    assert len(modes) == 48
    assert UAV1.name in {path["label"] for path in modes}
