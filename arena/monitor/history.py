"""History of the plotted quantities of all vehicles over the last seconds. Pure."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.geometry import euler_from_quat
from arena.live_view.fleet import FleetSnapshot

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of a plot: its name and its values.

    name: text in the legend. values: function that returns the value of each vehicle (N,).
    """

    name: str
    values: Callable[[FleetSnapshot], Array]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A plot that the user can choose: title with unit, and lines such as actual value and setpoint.

    span: least height of the plot, in its unit, so that noise is not drawn over the whole plot.
    """

    title: str
    lines: tuple[Line, ...]
    span: float


def _axis(name: str, column: int, sign: float = 1.0) -> Quantity:
    def line(label: str, field: str) -> Line:
        return Line(name=label, values=lambda f: sign * np.asarray(getattr(f, field))[:, column])

    lines = (line("setpoint", "set_p_n"), line("estimate", "est_p_n"), line("actual", "p_n"))
    return Quantity(title=f"{name} [m]", lines=lines, span=1.0)


def _speed(name: str, column: int, sign: float = 1.0) -> Quantity:
    def line(label: str, field: str) -> Line:
        return Line(name=label, values=lambda f: sign * np.asarray(getattr(f, field))[:, column])

    lines = (line("setpoint", "set_v_n"), line("estimate", "est_v_n"), line("actual", "v_n"))
    return Quantity(title=f"{name} [m/s]", lines=lines, span=1.0)


def _angle(name: str, column: int) -> Quantity:
    def line(label: str, field: str) -> Line:
        return Line(name=label, values=lambda f: euler_degrees(np.asarray(getattr(f, field)))[:, column])

    lines = (line("setpoint", "set_q_nb"), line("estimate", "est_q_nb"), line("actual", "q_nb"))
    return Quantity(title=f"{name} [deg]", lines=lines, span=10.0)


def _rotor(number: int) -> Line:
    return Line(name=str(number + 1), values=lambda f: f.motors[:, number])


def _tracking_error(fleet: FleetSnapshot) -> Array:
    return np.asarray(100.0 * np.linalg.norm(fleet.set_p_n - fleet.p_n, axis=1))


def _estimate_error(fleet: FleetSnapshot) -> Array:
    error = 100.0 * np.linalg.norm(fleet.est_p_n - fleet.p_n, axis=1)
    return np.where(fleet.has_true, error, np.nan)


QUANTITIES: tuple[Quantity, ...] = (
    _axis("north", 0),
    _axis("east", 1),
    _axis("height", 2, -1.0),
    _speed("speed north", 0),
    _speed("speed east", 1),
    _speed("climb", 2, -1.0),
    _angle("roll", 0),
    _angle("pitch", 1),
    _angle("yaw", 2),
    Quantity(
        title="body rates [deg/s]",
        span=20.0,
        lines=tuple(
            Line(name=name, values=lambda f, k=k: np.degrees(f.omega_b[:, k]))  # type: ignore[misc]
            for k, name in enumerate(("roll", "pitch", "yaw"))
        ),
    ),
    Quantity(title="rotor outputs [-]", span=1.0, lines=tuple(_rotor(k) for k in range(4))),
    Quantity(
        title="thrust setpoint [-]", span=1.0, lines=(Line(name="thrust", values=lambda f: f.set_thrust),)
    ),
    Quantity(
        title="position errors [cm]",
        span=10.0,
        lines=(
            Line(name="to the setpoint", values=_tracking_error),
            Line(name="of the estimate", values=_estimate_error),
        ),
    ),
    Quantity(title="battery [%]", span=10.0, lines=(Line(name="charge", values=lambda f: f.battery),)),
    Quantity(
        title="pose age [ms]", span=50.0, lines=(Line(name="age", values=lambda f: 1e3 * f.pose_age_s),)
    ),
)
BY_TITLE = {quantity.title: quantity for quantity in QUANTITIES}


def euler_degrees(q_nb: Array) -> Array:
    """Return roll, pitch, yaw [deg] (N, 3); NaN for unknown attitudes. q_nb: [-] wxyz (N, 4)."""
    known = np.isfinite(q_nb).all(axis=1)
    found = np.full((len(q_nb), 3), np.nan)
    if known.any():
        found[known] = np.degrees(euler_from_quat(q_nb[known]))
    return found


class History:
    """Recent snapshots of all vehicles, for the plots.

    The history covers the last `seconds`, with at most `rate_hz` snapshots per second.

    Times are those of the run [s].
    """

    def __init__(self, *, seconds: float = 30.0, rate_hz: float = 10.0) -> None:
        self._period_s, self._seconds = 1.0 / rate_hz, seconds
        self._samples: list[tuple[float, FleetSnapshot]] = []

    def add(self, time_s: float, fleet: FleetSnapshot) -> bool:
        """Add a snapshot of all vehicles. Ignore it and return False if it is too soon after the last snapshot.

        A time that goes back, such as after a jump in a replay, begins a new history.
        """
        if self._samples and time_s < self._samples[-1][0] - 1e-9:
            self._samples.clear()
        if self._samples and time_s < self._samples[-1][0] + self._period_s - 1e-6:
            return False
        self._samples.append((time_s, fleet))
        first = next(i for i, (t, _) in enumerate(self._samples) if t >= time_s - self._seconds)
        del self._samples[:first]
        return True

    def of_vehicle(self, row: int) -> tuple[Array, FleetSnapshot] | None:
        """Return the sample times [s] (T,) and the states of one vehicle at these times.

        The states have one row per time. Returns None without a sample.

        row: index of the vehicle.
        """
        if not self._samples:
            return None
        fleets = [fleet for _, fleet in self._samples]
        changes = {
            field.name: _column([getattr(fleet, field.name)[row] for fleet in fleets])
            for field in dataclasses.fields(FleetSnapshot)
        }
        return np.array([t for t, _ in self._samples]), FleetSnapshot(**changes)


def _column(values: list[Any]) -> Any:
    return np.array(values) if isinstance(values[0], np.ndarray | np.generic) else tuple(values)


def plot(quantity: Quantity, times: Array, states: FleetSnapshot, window_s: float) -> tuple[Array, ...]:
    """Return the data of a plot as arrays for the library uPlot: times, values of each line, range of the axis.

    Times are relative to the newest time [s], from -window_s to 0.

    All have the same shape. The first time has unknown values, so that all plots have the same range of time. The last array
    is not drawn: its values alternate between the ends of the axis, which is at least `quantity.span` high.
    times: [s] (T,).  states: one row per time.
    """
    ago = np.concatenate([[-window_s], np.maximum(times - times[-1], -window_s)])
    lines = [np.concatenate([[np.nan], np.asarray(line.values(states), float)]) for line in quantity.lines]
    known = np.concatenate(lines)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    more = 0.5 * max(quantity.span - (high - low), 0.0)
    return ago, *lines, np.where(np.arange(len(ago)) % 2, high + more, low - more)
