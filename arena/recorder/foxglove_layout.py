"""Layout for Foxglove: 3D view, plots of each vehicle, modes, log and state. Pure.

The format is that of a layout which the app exports, because `foxglove.layouts` makes another format, for notebooks only.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from arena.recorder.viewer_plots import DrawnVehicle, Plot, control_plots, position_plots
from arena.recorder.viewer_poses import ROOT
from arena.wire.viewer_topics import Content, topic_name

MAX_PLOTTED = 12
"""Number of vehicles with plots, because a layout with many tabs is slow."""

Json = dict[str, Any]
_RECEIVED = "receiveTime"
_SHOWN = (Content.MODEL, Content.PATH, Content.SETPOINT_POSE)
_BACKGROUND = "#eef0f4"


class _Panels:
    """Panels of a Foxglove layout while it is being built.

    config: panel id -> settings.
    """

    def __init__(self) -> None:
        self.config: Json = {}

    def add(self, kind: str, title: str, **settings: Any) -> str:
        """Add a panel to the layout and return its id.

        kind: type of panel in Foxglove.
        """
        identity = f"{kind}!{len(self.config)}"
        titles = {"foxglovePanelTitle": title, "lichtblickPanelTitle": title} if title else {}
        self.config[identity] = {**titles, **settings}
        return identity


def foxglove_layout(vehicles: Sequence[DrawnVehicle], size_m: Sequence[float]) -> str:
    """Return the layout file for Foxglove as JSON. Users load it with the menu item `Import from file`.

    vehicles: vehicles of the arena; the first `MAX_PLOTTED` get plots.  size_m: size of the room, north, east, height [m].
    """
    panels = _Panels()
    scene = panels.add("3D", "", **_view(vehicles, size_m))
    modes = panels.add("StateTransitions", "flight mode", isSynced=True, paths=_modes(vehicles))
    log = panels.add("RosOut", "log", topicToRender=topic_name(Content.LOG), minLogLevel=2, searchTerms=[])
    left = _split("column", scene, _split("column", modes, log, 50), 62)
    layout = {
        "configById": panels.config,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", left, _tabs(panels, vehicles), 56),
    }
    return json.dumps(layout, indent=1) + "\n"


def _tabs(panels: _Panels, vehicles: Sequence[DrawnVehicle]) -> str:
    """Add the tabs: two tabs with plots for each vehicle, and one tab for the health of motion capture and links."""
    tabs = []
    for vehicle in vehicles[:MAX_PLOTTED]:
        for title, plots in (
            (vehicle.name, position_plots(vehicle)),
            (f"{vehicle.name} control", control_plots(vehicle)),
        ):
            tabs.append({"title": title, "layout": _column([_plot(panels, plot) for plot in plots])})
    tabs.append({"title": "health", "layout": _column(_health(panels, vehicles))})
    return panels.add("Tab", "", activeTabIdx=0, tabs=tabs)


def _health(panels: _Panels, vehicles: Sequence[DrawnVehicle]) -> list[str]:
    shown = vehicles[:MAX_PLOTTED]
    rates = [_series(f"{topic_name(Content.MOCAP_HEALTH)}.rate", "frames")]
    rates += [_series(f"{topic_name(Content.BODY_HEALTH, v.name)}.rate", v.name) for v in shown]
    links = [_series(f"{topic_name(Content.LINK, v.name)}.down", v.name) for v in shown]
    lost = [_series(f"{topic_name(Content.LINK, v.name)}.lost", v.name) for v in shown]
    found = [
        panels.add("Plot", title, paths=paths, **_PLOT)
        for title, paths in (
            ("motion capture: poses [1/s]", rates),
            ("MAVLink: datagrams from the vehicle [1/s]", links),
            ("MAVLink: lost messages [1/s]", lost),
        )
    ]
    table = panels.add("Table", "battery", topicPath=topic_name(Content.BATTERY, vehicles[0].name))
    return [*found, table]


_PLOT: Json = {
    "isSynced": True,
    "xAxisVal": "timestamp",
    "showLegend": True,
    "legendDisplay": "left",
    "sidebarDimension": 125,
    "showXAxisLabels": True,
    "showYAxisLabels": True,
    "showPlotValuesInLegend": False,
}


def _plot(panels: _Panels, plot: Plot) -> str:
    paths = [_series(c.foxglove, c.label, c.colour) for c in plot.curves]
    return panels.add("Plot", plot.title, paths=paths, **_PLOT)


def _series(path: str, label: str, colour: str | None = None) -> Json:
    found = {"value": path, "enabled": True, "label": label, "timestampMethod": _RECEIVED}
    return found if colour is None else {**found, "color": colour}


def _modes(vehicles: Sequence[DrawnVehicle]) -> list[Json]:
    return [_series(f"{topic_name(Content.STATE, v.name)}.mode", v.name) for v in vehicles]


def _view(vehicles: Sequence[DrawnVehicle], size_m: Sequence[float]) -> Json:
    """Return the settings of the 3D view: the camera sees the whole room from the south-east."""
    north, east, height = size_m
    topics: Json = {topic_name(Content.SCENE): {"visible": True}}
    for v in vehicles:
        topics |= {topic_name(content, v.name): {"visible": True} for content in _SHOWN}
        topics[topic_name(Content.SETPOINT_POSE, v.name)] |= {"type": "axis", "axisScale": 0.2}
        for content in (Content.ESTIMATED_POSE, Content.CAPTURED_POSE, Content.TRUE_POSE):
            topics[topic_name(content, v.name)] = {"visible": False}
    frames = {
        f"frame:{v.name}/{source}": {"visible": False} for v in vehicles for source in ("truth", "mocap")
    }
    return {
        "fixedFrame": ROOT,
        "followTf": ROOT,
        "followMode": "follow-none",
        "scene": {
            "backgroundColor": _BACKGROUND,
            "transforms": {"axisSize": 0.15, "lineWidth": 0, "showLabel": False, "enablePreloading": True},
        },
        "cameraState": {
            "perspective": True,
            "distance": round(1.1 * math.hypot(north, east) + 0.5 * height, 1),
            "phi": 65,
            "thetaOffset": 60,
            "targetOffset": [0, 0, 0.3 * height],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.1,
            "far": 5000,
        },
        "topics": topics,
        "transforms": frames,
        "layers": {},
    }


def _split(direction: str, first: Any, second: Any, percentage: float) -> Json:
    """Return a layout of two panels, side by side (`row`) or one above the other (`column`).

    percentage: share of the first [%].
    """
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}


def _column(panels: Sequence[str]) -> Any:
    """Return a layout of several panels of equal height, one above the other."""
    if len(panels) == 1:
        return panels[0]
    return _split("column", panels[0], _column(panels[1:]), round(100 / len(panels), 2))
