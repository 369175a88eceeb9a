"""Tracking errors and estimate errors of a flight over time, and their rms, p95 and maximum. Pure.

Tracking error: position against setpoint. Estimate error: estimate against actual position.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arena.flight_log.columns import RPY
from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.figures import Curve, Drawn, Figure, Panel, over_time
from arena.report.happenings import estimated, tracked

_DEG = 180.0 / np.pi


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Rms, 95th percentile and maximum of the absolute value of an error over a flight.

    p95: 95th percentile.

    at_s: time of the maximum [s].
    """

    rms: float
    p95: float
    max: float
    at_s: float


def measures(t: Array, error: Array) -> Measures | None:
    """Return the rms, p95 and maximum of an error (n,) at the times t [s] (n,). Return None without values.

    NaN values are left out.
    """
    known = np.isfinite(error)
    if not known.any():
        return None
    size = np.abs(error[known])
    return Measures(
        rms=float(np.sqrt((size * size).mean())),
        p95=float(np.percentile(size, 95.0)),
        max=float(size.max()),
        at_s=float(t[known][size.argmax()]),
    )


def tracking_error(flight: Flight) -> Array:
    """Return the tracking error: position minus setpoint [m] [NED] (n, 3).

    It is NaN outside OFFBOARD and on the floor.
    """
    return np.where(tracked(flight)[:, None], flight.pos - flight.group("pos_ref"), np.nan)


def estimate_error(flight: Flight) -> Array:
    """Return the estimate error: estimated minus actual position [m] [NED] (n, 3), in the air only.

    NaN if neither the truth nor motion capture is in the log.
    """
    if flight.position_source == "estimate":
        return np.full((flight.t.size, 3), np.nan)
    return np.where(estimated(flight)[:, None], flight.group("ekf.pos") - flight.pos, np.nan)


def yaw_tracking_error(flight: Flight) -> Array:
    """Return the yaw tracking error: yaw minus yaw setpoint [deg] (n,), -180..180.

    It is NaN outside OFFBOARD and on the floor.
    """
    reference = flight.numbers.get("pos_ref.yaw")
    if reference is None or not np.isfinite(reference).any():
        reference = flight.group("att_euler_ref", RPY)[:, 2]
    return np.where(tracked(flight), _wrapped(flight.euler[:, 2] - reference), np.nan)


def yaw_estimate_error(flight: Flight) -> Array:
    """Return the yaw estimate error: estimated minus actual yaw [deg] (n,), -180..180, in the air only.

    It is NaN if the actual yaw is unknown.
    """
    if flight.position_source == "estimate":
        return np.full(flight.t.size, np.nan)
    return np.where(
        estimated(flight), _wrapped(flight.group("ekf.att_euler", RPY)[:, 2] - flight.euler[:, 2]), np.nan
    )


def _wrapped(angle: Array) -> Array:
    wrapped: Array = (angle * _DEG + 180.0) % 360.0 - 180.0
    return wrapped


def norm(error: Array) -> Array:
    """Return the Euclidean norm of each row of an error (n, 3) -> (n,)."""
    distance: Array = np.linalg.norm(error, axis=1)
    return distance


@dataclass(frozen=True, kw_only=True)
class Row:
    """Row of a report's table of errors: which error it shows, and how to compute it from a log.

    label: name of the error.  unit: its unit.  digits: digits to show.  chart: figure that shows the error.
    values: function from a log to the error (n,).
    """

    label: str
    unit: str
    digits: int
    chart: str
    values: Callable[[Flight], Array]


def _part(error: Callable[[Flight], Array], k: int, sign: float = 1.0) -> Callable[[Flight], Array]:
    return lambda flight: sign * error(flight)[:, k]


ROWS: tuple[Row, ...] = (
    Row(
        label="tracking error, distance",
        unit="m",
        digits=3,
        chart="tracking",
        values=lambda f: norm(tracking_error(f)),
    ),
    Row(label="tracking error, north", unit="m", digits=3, chart="tracking", values=_part(tracking_error, 0)),
    Row(label="tracking error, east", unit="m", digits=3, chart="tracking", values=_part(tracking_error, 1)),
    Row(
        label="tracking error, up",
        unit="m",
        digits=3,
        chart="tracking",
        values=_part(tracking_error, 2, -1.0),
    ),
    Row(label="tracking error, yaw", unit="deg", digits=2, chart="tracking", values=yaw_tracking_error),
    Row(
        label="estimate error, distance",
        unit="mm",
        digits=1,
        chart="estimator",
        values=lambda f: 1e3 * norm(estimate_error(f)),
    ),
    Row(
        label="estimate error, north",
        unit="mm",
        digits=1,
        chart="estimator",
        values=_part(estimate_error, 0, 1e3),
    ),
    Row(
        label="estimate error, east",
        unit="mm",
        digits=1,
        chart="estimator",
        values=_part(estimate_error, 1, 1e3),
    ),
    Row(
        label="estimate error, up",
        unit="mm",
        digits=1,
        chart="estimator",
        values=_part(estimate_error, 2, -1e3),
    ),
    Row(label="estimate error, yaw", unit="deg", digits=2, chart="estimator", values=yaw_estimate_error),
)


def tracking_figure(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of the tracking errors over time: distance, components and yaw."""
    return _figure(vehicles, tracking_error, yaw_tracking_error, 1.0, "m")


def estimator_figure(vehicles: Sequence[Drawn]) -> Figure:
    """Return the figure of the estimate errors over time: distance, components and yaw."""
    return _figure(vehicles, estimate_error, yaw_estimate_error, 1e3, "mm")


def _figure(
    vehicles: Sequence[Drawn],
    error: Callable[[Flight], Array],
    yaw: Callable[[Flight], Array],
    scale: float,
    unit: str,
) -> Figure:
    parts = [("distance", lambda f: norm(error(f)) * scale)]
    parts += [
        (title, _part(error, k, sign * scale))
        for k, (title, sign) in enumerate((("north", 1.0), ("east", 1.0), ("up", -1.0)))
    ]
    digits = ".3f" if unit == "m" else ".1f"
    panels = [
        Panel(
            title=f"{title} [{unit}]", curves=[_curve(title, values)], digits=digits, zero=title == "distance"
        )
        for title, values in parts
    ]
    panels.append(Panel(title="yaw [deg]", curves=[_curve("yaw", yaw)], digits=".2f", least=2.0))
    return over_time(vehicles, panels, height=115, legend=False)


def _curve(label: str, values: Callable[[Flight], Array]) -> Curve:
    return Curve(label=label, values=lambda one: values(one.flight), width=1.3)
