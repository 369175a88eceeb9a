"""Two flights on one time axis, aligned at a common moment such as takeoff, and their differences. Pure.

The flights are called A and B. Differences are B minus A.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from arena.errors import InputError
from arena.flight_log.columns import NED, RPY
from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.errors import Measures, measures
from arena.report.landings import flown_times

Moment = Literal["step", "offboard", "takeoff"]
MOMENTS: tuple[Moment, ...] = get_args(Moment)
_STEP_M = 0.1
_LEAST_S = 0.5  # two flights must have at least so much time in common
_DEG = 180.0 / np.pi


@dataclass(frozen=True, kw_only=True)
class Side:
    """Flight in a comparison of two flights. Its times and positions are relative to a common moment, such as the takeoff.

    label: text for the page, such as `A: uav1 of two_quads`.  flight: its log; positions and yaw are relative to those at the
    common moment.  t: time since the common moment [s] (n,).  zero_s: time of the common moment in the log [s].
    p_n: actual position at the common moment [m] [NED] (3,).  yaw: actual yaw there [rad].
    """

    label: str
    flight: Flight
    t: Array
    zero_s: float
    p_n: Array
    yaw: float


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Pair of flights that are compared.

    name: name of the pair.
    a, b: the flights.
    moment: common moment by which they are aligned.
    """

    name: str
    a: Side
    b: Side
    moment: Moment


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Differences of the values of two flights (B minus A). They end when the first of the flights leaves OFFBOARD.

    t: times since the common moment [s] (m,).  position: [m] [NED] (m, 3).  yaw: [deg] (m,).
    """

    t: Array
    position: Array
    yaw: Array

    def measures(self) -> Mapping[str, Measures | None]:
        """Return rms, p95 and maximum of the difference: distance, north, east, up [m] and yaw [deg]."""
        return {
            "distance": measures(self.t, np.linalg.norm(self.position, axis=1)),
            "north": measures(self.t, self.position[:, 0]),
            "east": measures(self.t, self.position[:, 1]),
            "up": measures(self.t, -self.position[:, 2]),
            "yaw": measures(self.t, self.yaw),
        }


def pairs(
    a: Sequence[Flight], b: Sequence[Flight], names: tuple[str, str], moment: Moment | None = None
) -> list[Pair]:
    """Return the pairs of flights to compare: vehicles with equal names in both sources, else in their order.

    a, b: flights of both sources.  names: names of the sources.  moment: by which the flights are aligned; None for the first one
        of `MOMENTS` that both flights contain.
    Raises InputError if a pair cannot be aligned or has no common time.
    """
    own = {flight.name: flight for flight in b}
    same = [(flight, own[flight.name]) for flight in a if flight.name in own]
    found = same or list(zip(a, b, strict=False))
    return [_pair(one, other, names, moment) for one, other in found]


def _pair(a: Flight, b: Flight, names: tuple[str, str], moment: Moment | None) -> Pair:
    both = (m for m in MOMENTS if moment_row(a, m) is not None and moment_row(b, m) is not None)
    by: Moment = moment if moment is not None else next(both, MOMENTS[0])
    name = a.name if a.name == b.name else f"{a.name} and {b.name}"
    sides = [
        _side(f"{letter}: {_label(flight, source)}", flight, by)
        for letter, flight, source in zip("AB", (a, b), names, strict=True)
    ]
    return Pair(name=name, a=sides[0], b=sides[1], moment=by)


def _label(flight: Flight, source: str) -> str:
    return flight.name if source == flight.name else f"{flight.name} of {source}"


def _side(label: str, flight: Flight, moment: Moment) -> Side:
    row = moment_row(flight, moment)
    if row is None:
        others = ", ".join(m for m in MOMENTS if moment_row(flight, m) is not None) or "none"
        raise InputError(f"{label}: the log does not contain the event `{moment}`. Choose one of: {others}")
    known = np.flatnonzero(np.isfinite(flight.pos).all(axis=1))
    if not known.size:
        raise InputError(f"{label}: the log contains no position")
    near = int(known[np.abs(known - row).argmin()])
    p_n, yaw = flight.pos[near], float(np.nan_to_num(flight.euler[near, 2]))
    return Side(
        label=label,
        flight=_relative(flight, p_n, yaw),
        t=flight.t - flight.t[row],
        zero_s=float(flight.t[row]),
        p_n=p_n,
        yaw=yaw,
    )


def moment_row(flight: Flight, moment: Moment) -> int | None:
    """Return the log row of the moment that aligns two flights, such as takeoff; None if the log has none.

    step: first setpoint in OFFBOARD that is more than `_STEP_M` away from the place where OFFBOARD began.
    offboard: entry into OFFBOARD while armed.  takeoff: first row in the air.
    """
    if moment == "takeoff":
        spans = flown_times(flight)
        return spans[0][0] if spans else None
    rows = np.flatnonzero(flight.offboard)
    if moment == "step" and rows.size:
        start = flight.pos[rows[0]]
        rows = rows[np.linalg.norm(flight.group("pos_ref")[rows] - start, axis=1) > _STEP_M]
    return int(rows[0]) if rows.size else None


def _relative(flight: Flight, p_n: Array, yaw: float) -> Flight:
    """Return the flight with its positions and yaw angles relative to one position and yaw.

    p_n: reference position [m] [NED] (3,). yaw: reference yaw [rad]. The actual yaw is in -pi..pi. Estimated and desired yaw
    differ from it by at most pi, so that +179 deg and -179 deg are drawn 2 deg apart.
    """
    numbers = dict(flight.numbers)
    for group in ("truth.pos", "mocap.pos", "ekf.pos", "pos_ref"):
        for k, part in enumerate(NED):
            if f"{group}.{part}" in numbers:
                numbers[f"{group}.{part}"] = numbers[f"{group}.{part}"] - p_n[k]
    angles = [
        f"{group}.{RPY[2]}"
        for group in ("truth.att_euler", "mocap.att_euler", "ekf.att_euler", "att_euler_ref", "pos_ref")
    ]
    actual = wrapped(flight.euler[:, 2] - yaw)
    for column in angles:
        if column in numbers:
            turned = wrapped(numbers[column] - yaw)
            numbers[column] = np.where(np.isfinite(actual), actual + wrapped(turned - actual), turned)
    return replace(flight, numbers=numbers)


def wrapped(angle: Array) -> Array:
    """Wrap angles [rad] into the range -pi..pi."""
    found: Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return found


def difference(pair: Pair) -> Difference:
    """Return the difference B minus A of two flights at the times of A.

    Raises InputError if the flights have no common time.
    """
    a, b = pair.a, pair.b
    last = min(_end(a), _end(b))
    rows = (a.t >= max(0.0, b.t[0])) & (a.t <= last)
    t = a.t[rows]
    if t.size < 2 or t[-1] - t[0] < _LEAST_S:
        raise InputError(
            f"{a.label} and {b.label} cannot be compared: aligned at the event `{pair.moment}`, the logs overlap by less than "
            f"{_LEAST_S:g} s"
        )
    at_b = np.stack([_interpolated(t, b.t, column) for column in b.flight.pos.T], axis=1)
    yaw_b = _interpolated(t, b.t, _continuous(b.flight.euler[:, 2]))
    turned = wrapped(yaw_b - a.flight.euler[rows, 2]) * _DEG
    return Difference(t=t, position=at_b - a.flight.pos[rows], yaw=turned)


def _end(side: Side) -> float:
    """Return the time until which a flight is compared with a second one [s].

    It is the last row in OFFBOARD, or the last row of the log without OFFBOARD.
    """
    rows = np.flatnonzero(side.flight.offboard)
    return float(side.t[rows[-1]] if rows.size else side.t[-1])


def _continuous(angle: Array) -> Array:
    """Return an angle [rad] (n,) without jumps of 2 pi. NaN values stay."""
    found, known = np.array(angle), np.isfinite(angle)
    found[known] = np.unwrap(angle[known])
    return found


def _interpolated(t: Array, own: Array, values: Array) -> Array:
    """Interpolate values linearly. Return the values at the new times (m,).

    t: wanted times [s] (m,).  values: (n,); NaN values are left out.  own: times of the values [s] (n,).
    The result is NaN before the first and after the last value, and if all values are NaN.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.full(t.size, np.nan)
    return np.interp(t, own[known], values[known], left=np.nan, right=np.nan)
