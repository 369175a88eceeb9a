"""Layout for PlotJuggler: one tab of plots per vehicle and subject. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from arena.recorder.viewer_plots import DrawnVehicle, Plot, control_plots, position_plots

MAX_PLOTTED = 12
"""Number of vehicles with plots."""


def plotjuggler_layout(vehicles: Sequence[DrawnVehicle]) -> str:
    """Return the PlotJuggler layout as XML.

    vehicles: vehicles of the arena; the first `MAX_PLOTTED` get plots.
    """
    root = ElementTree.Element("root")
    window = ElementTree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for vehicle in vehicles[:MAX_PLOTTED]:
        _add_tab(window, vehicle.name, position_plots(vehicle))
        _add_tab(window, f"{vehicle.name} control", control_plots(vehicle))
    ElementTree.SubElement(window, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _add_tab(window: ElementTree.Element, title: str, plots: Sequence[Plot]) -> None:
    """Add a tab with plots of equal height, one above the other."""
    tab = ElementTree.SubElement(window, "Tab", tab_name=title, containers="1")
    container = ElementTree.SubElement(tab, "Container")
    sizes = ";".join(f"{1 / len(plots):.6f}" for _ in plots)
    splitter = ElementTree.SubElement(
        container, "DockSplitter", orientation="-", sizes=sizes, count=str(len(plots))
    )
    for plot in plots:
        area = ElementTree.SubElement(splitter, "DockArea", name=plot.title)
        drawn = ElementTree.SubElement(
            area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false"
        )
        ElementTree.SubElement(drawn, "limitY")
        for curve in plot.curves:
            ElementTree.SubElement(drawn, "curve", name=curve.plotjuggler, color=curve.colour)
