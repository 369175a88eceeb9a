"""Plots that the layouts for Foxglove and PlotJuggler show for each vehicle: titles and fields. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from arena.wire.viewer_topics import Content, topic_name

_COLOURS = {"estimate": "#1f77b4", "setpoint": "#ff7f0e", "actual": "#2ca02c"}
_ROTORS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f")
_EAST, _NORTH, _UP = "xyz"  # axes of the frame `arena`


@dataclass(frozen=True, kw_only=True)
class DrawnVehicle:
    """Vehicle that a viewer layout shows.

    simulated: it has true poses; else its captured poses are drawn.
    rotors: number of rotors.
    """

    name: str
    simulated: bool
    rotors: int


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Curve of a plot: the plotted topic and fields, label and colour.

    topic: name of the topic.
    fields: names of the nested fields.
    label, colour: as shown.
    """

    topic: str
    fields: tuple[str, ...]
    label: str
    colour: str

    @property
    def foxglove(self) -> str:
        """Path of the plotted values in Foxglove's notation, such as `/uav1/attitude.yaw`."""
        return ".".join((self.topic, *self.fields))

    @property
    def plotjuggler(self) -> str:
        """Name of the curve in PlotJuggler's notation, such as `/uav1/attitude/yaw`."""
        return "/".join((self.topic, *self.fields))


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Plot with a title and its curves."""

    title: str
    curves: tuple[Curve, ...]


def _curve(vehicle: DrawnVehicle, content: Content, field: str, label: str, colour: str) -> Curve:
    return Curve(
        topic=topic_name(content, vehicle.name), fields=tuple(field.split(".")), label=label, colour=colour
    )


def _position(vehicle: DrawnVehicle, title: str, axis: str) -> Plot:
    """Return the plot of one coordinate: estimate, setpoint, and the true or captured position."""
    actual = (Content.TRUE_POSE, "truth") if vehicle.simulated else (Content.CAPTURED_POSE, "captured")
    shown = (
        (Content.ESTIMATED_POSE, "estimate", "estimate"),
        (Content.SETPOINT_POSE, "setpoint", "setpoint"),
        (*actual, "actual"),
    )
    field = f"pose.position.{axis}"
    return Plot(
        title=title,
        curves=tuple(_curve(vehicle, content, field, label, _COLOURS[key]) for content, label, key in shown),
    )


def position_plots(vehicle: DrawnVehicle) -> tuple[Plot, ...]:
    """Return the plots of actual and desired values of north, east, height and yaw."""
    yaw = (
        _curve(vehicle, Content.ATTITUDE, "yaw", "estimate", _COLOURS["estimate"]),
        _curve(vehicle, Content.POSITION_SETPOINT, "yaw", "setpoint", _COLOURS["setpoint"]),
    )
    return (
        _position(vehicle, "north [m]", _NORTH),
        _position(vehicle, "east [m]", _EAST),
        _position(vehicle, "height [m]", _UP),
        Plot(title="yaw [rad]", curves=yaw),
    )


def control_plots(vehicle: DrawnVehicle) -> tuple[Plot, ...]:
    """Return the plots of attitude with its setpoint, motor outputs, battery, and pose age."""
    found = []
    for angle in ("roll", "pitch"):
        curves = (
            _curve(vehicle, Content.ATTITUDE, angle, "estimate", _COLOURS["estimate"]),
            _curve(vehicle, Content.ATTITUDE_SETPOINT, angle, "setpoint", _COLOURS["setpoint"]),
        )
        found.append(Plot(title=f"{angle} [rad]", curves=curves))
    outputs = (
        _curve(vehicle, Content.ACTUATORS, f"rotor{k}", f"rotor {k}", _ROTORS[k - 1])
        for k in range(1, vehicle.rotors + 1)
    )
    battery = _curve(vehicle, Content.BATTERY, "voltage", "voltage", _COLOURS["estimate"])
    gap = _curve(vehicle, Content.BODY_HEALTH, "gap", "gap", _COLOURS["estimate"])
    return (
        *found,
        Plot(title="motor outputs [-]", curves=tuple(outputs)),
        Plot(title="battery [V]", curves=(battery,)),
        Plot(title="longest gap between poses [s]", curves=(gap,)),
    )
