"""Figure of the vehicles' attitude: roll, pitch, tilt and body rates. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from arena.flight_log.columns import RPY
from arena.geometry import Array
from arena.report.figures import Curve, Drawn, Figure, Panel, column, desired, over_time, three

_DEG = 180.0 / np.pi


def attitude(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of roll and pitch (actual, estimated, desired), tilt, and body rates (estimated, desired)."""
    panels = [
        Panel(title=f"{part} [deg]", curves=three("att_euler", "att_euler_ref", part, _DEG), digits=".1f")
        for part in RPY[:2]
    ]
    tilt = Curve(label="actual", values=_tilt)
    panels.append(Panel(title="tilt [deg]", curves=[tilt], digits=".1f", zero=True))
    for part in RPY[:2]:
        rates = (
            Curve(label="actual", values=_rate(part)),
            Curve(label="desired", values=desired("ang_vel_ref", part, _DEG), dash="dash", width=1.1),
        )
        panels.append(Panel(title=f"{part} rate [deg/s]", curves=rates, digits=".1f"))
    return over_time(vehicles, panels, height=130)


def _tilt(one: Drawn) -> Array:
    """Return the tilt: the angle between the body z axis and the vertical [deg] (n,)."""
    roll, pitch = one.flight.euler[:, 0], one.flight.euler[:, 1]
    tilt: Array = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0)) * _DEG
    return tilt


def _rate(part: str) -> Callable[[Drawn], Array]:
    """Return a function that reads one body rate of a vehicle's log [deg/s] (n,).

    Motion capture measures no body rates, so the autopilot's estimate is used.
    """
    return lambda one: column("truth.ang_vel" if one.flight.simulated else "ekf.ang_vel", part, _DEG)(one)
