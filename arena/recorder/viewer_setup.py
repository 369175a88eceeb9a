"""Channels and layouts for viewers, made from the JSON configuration (slice) of the recorder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arena.obstacles import obstacles_of
from arena.recorder.foxglove_channels import FoxgloveChannels, ViewedVehicle
from arena.recorder.foxglove_layout import foxglove_layout
from arena.recorder.foxglove_server import FoxgloveServer
from arena.recorder.mcap_file import MakeChannel
from arena.recorder.plotjuggler_layout import plotjuggler_layout
from arena.recorder.viewer_plots import DrawnVehicle
from arena.recorder.viewer_scene import Box, shape_of

FOXGLOVE_LAYOUT, PLOTJUGGLER_LAYOUT = "flight.foxglove.json", "flight.plotjuggler.xml"
_USUAL_ROTORS = 4


def viewer_channels(settings: Mapping[str, Any], channel: MakeChannel) -> FoxgloveChannels:
    """Return the output channels for viewers.

    settings: slice of the recorder.
    channel: creates a channel in the record.
    """
    vehicles = [
        ViewedVehicle(
            name=str(v["name"]),
            id=int(v["id"]),
            body=v["body"],
            index=v["index"],
            shape=shape_of(v["shape"]) if v.get("shape") else None,
        )
        for v in settings["vehicles"]
    ]
    return FoxgloveChannels(
        vehicles,
        channel,
        size_m=settings["size_m"],
        fence=_fence(settings.get("fence")),
        obstacles=obstacles_of(settings.get("obstacles")),
    )


def write_layouts(settings: Mapping[str, Any], folder: Path) -> None:
    """Write the layouts for Foxglove and PlotJuggler into the run folder.

    settings: slice of the recorder.

    Raises OSError if they cannot be written.
    """
    vehicles = [
        DrawnVehicle(name=str(v["name"]), simulated=v["index"] is not None, rotors=_rotors(v))
        for v in settings["vehicles"]
    ]
    (folder / FOXGLOVE_LAYOUT).write_text(foxglove_layout(vehicles, settings["size_m"]))
    (folder / PLOTJUGGLER_LAYOUT).write_text(plotjuggler_layout(vehicles))


def open_server(settings: Mapping[str, Any]) -> FoxgloveServer | None:
    """Return the WebSocket server for Foxglove, or None if it is not configured.

    settings: slice of the recorder.
    """
    if settings.get("foxglove") is None:
        return None
    address, port = settings["foxglove"]
    return FoxgloveServer(
        str(address),
        int(port),
        str(settings["arena"]),
        simulation_clock=settings["clock"] is not None,
    )


def _rotors(vehicle: Mapping[str, Any]) -> int:
    """Return the number of rotors of a vehicle, or 4 if its shape is unknown."""
    shape = vehicle.get("shape")
    return len(shape["rotors_m"]) if shape else _USUAL_ROTORS


def _fence(raw: Mapping[str, Any] | None) -> Box | None:
    if raw is None:
        return None
    (south, north), (west, east) = raw["north"], raw["east"]
    return (float(south), float(north)), (float(west), float(east)), (0.0, float(raw["up"]))
