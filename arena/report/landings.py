"""Ends of one vehicle's flights: touchdown, landing by the land detector, and disarming. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.link_record import StatusText

TAKEN_OFF_M = 0.1
"""Height above the start from which a vehicle counts as in the air [m]."""
LANDING_MODES = frozenset({"AUTO.LAND", "AUTO.PRECLAND", "DESCEND"})
_ON_FLOOR_M = 0.03
FELL_M = 0.2
"""Height loss after a disarming above which the vehicle was disarmed in the air [m]."""
_FALL_S = 2.0
_UNKNOWN_S = 1.0
_ARMING = ("Armed", "Disarmed")
"""First words of the STATUSTEXTs with which PX4 and the built-in autopilot report arming and disarming."""


@dataclass(frozen=True, kw_only=True)
class Disarming:
    """Last disarming of a vehicle.

    at_s: its time [s], on the axis of the given times.
    in_log: True if a row of the log is disarmed; False if only a text or an event reports the disarming, because the log has
        ended before the next row.
    """

    at_s: float
    in_log: bool


def flown_times(flight: Flight) -> list[tuple[int, int]]:
    """Return (first row in the air, row of the landing) of each flight in a log.

    A flight without a landing ends in the last row.

    A flight begins `TAKEN_OFF_M` above the ground, because autopilots report the take-off when the motors start. It ends when
    the land detector reports the landing. A flight whose height is unknown for `_UNKNOWN_S` counts, too. While telemetry is
    missing, the last reported state holds.
    """
    air = _reported_in_air(flight)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], air, [False]]).astype(int)))
    spans = [(int(a), min(int(b), air.size - 1)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    up = -flight.pos[:, 2]
    if not np.isfinite(up).any():
        return spans
    found = []
    for first, last in spans:
        # A log that begins in the air has no row before the flight: then the lowest place of the flight is the ground.
        ground = up[first] if first > 0 and np.isfinite(up[first]) else np.nanmin(up)
        climbed = np.flatnonzero(up[first : last + 1] - ground > TAKEN_OFF_M)
        if not climbed.size:
            climbed = _long_unknown(up[first : last + 1], flight.t[first : last + 1])
        if climbed.size:
            found.append((first + int(climbed[0]), last))
    return found


def has_landed(flight: Flight) -> bool:
    """Return whether the land detector has reported the landing of the last flight in a log.

    The report may come later than the end of the flight. Return False if the vehicle did not fly.
    """
    spans = flown_times(flight)
    return bool(spans) and bool(flight.landed[spans[-1][1] :].any())


def ends_in_air(flight: Flight) -> bool:
    """Return whether a log ends during a flight: its vehicle is armed, and no landing is reported."""
    spans = flown_times(flight)
    return bool(spans) and bool(_reported_in_air(flight)[spans[-1][1]])


def armed_rows(flight: Flight) -> NDArray[np.bool_]:
    """Return a mask of the log rows in which a vehicle is armed, as last reported (n,)."""
    return _last_reported(flight, "info.is_armed", flight.armed)


def _reported_in_air(flight: Flight) -> NDArray[np.bool_]:
    """Return a mask of the log rows in which a vehicle is armed and has not landed, as last reported (n,)."""
    return armed_rows(flight) & ~_last_reported(flight, "info.is_landed", flight.landed)


def _last_reported(flight: Flight, column: str, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return in each row the last reported value of a flag, such as armed (n,). It is False before the first report.

    column: column of the log, NaN where the flag is unknown.  flags: the same flag, False where it is unknown (n,).
    """
    known = np.isfinite(flight.numbers.get(column, np.zeros(flags.size)))
    newest = np.maximum.accumulate(np.where(known, np.arange(flags.size), -1))
    return np.where(newest >= 0, flags[np.maximum(newest, 0)], False)


def _long_unknown(up: Array, t: Array) -> NDArray[np.intp]:
    """Return the log rows in which the height is unknown, or no rows if this lasts less than `_UNKNOWN_S`.

    up: height, NaN if unknown [m] (k,).  t: times of the rows [s] (k,).
    """
    rows = np.flatnonzero(~np.isfinite(up))
    return rows if rows.size and t[rows[-1]] - t[rows[0]] >= _UNKNOWN_S else rows[:0]


def touchdown_row(flight: Flight, first: int, last: int) -> int:
    """Return the log row of the touchdown: from this row on, the height is within 3 cm of the final height.

    first, last: rows of a flight, see `flown_times`. Returns `last` if the vehicle did not land.
    """
    up = -flight.pos[first : last + 1, 2]
    if not flight.landed[last] or not np.isfinite(up[-1]):
        return last
    above = np.flatnonzero(up - up[-1] > _ON_FLOOR_M)
    return min(last, first + int(above[-1]) + 1) if above.size else last


def air_time_s(flight: Flight) -> float:
    """Return how long a vehicle was in the air: from take-off to touchdown, sum of all flights in a log [s]."""
    return sum(float(flight.t[touchdown_row(flight, a, b)] - flight.t[a]) for a, b in flown_times(flight))


def last_touchdown(flight: Flight) -> int | None:
    """Return the log row of the last touchdown, or None if the vehicle did not fly or did not land."""
    spans = flown_times(flight)
    return touchdown_row(flight, *spans[-1]) if spans and flight.landed[spans[-1][1]] else None


@dataclass(frozen=True, kw_only=True)
class LandingDrift:
    """Horizontal drift of a vehicle during its last landing.

    distance_m: horizontal distance between the two places [m].  begun_s: time at which the landing mode began [s].
    touchdown_s: time of the touchdown [s].
    """

    distance_m: float
    begun_s: float
    touchdown_s: float


def landing_drift(flight: Flight) -> LandingDrift | None:
    """Return the horizontal drift from the start of the landing mode to the last touchdown.

    None if the vehicle did not land in a landing mode, or if a position is unknown. Times are those of the log [s].
    """
    down = last_touchdown(flight)
    if down is None or flight.mode[down] not in LANDING_MODES:
        return None
    other = [k for k in range(down) if flight.mode[k] not in LANDING_MODES]
    begin = max(other[-1] + 1 if other else 0, flown_times(flight)[-1][0])
    moved = flight.pos[down, :2] - flight.pos[begin, :2]
    if begin >= down or not np.isfinite(moved).all():
        return None
    return LandingDrift(
        distance_m=float(np.linalg.norm(moved)),
        begun_s=float(flight.t[begin]),
        touchdown_s=float(flight.t[down]),
    )


def largest_fall(flight: Flight) -> float:
    """Return how far a vehicle fell in the 2 s after a disarming: the largest value of all disarmings [m], NaN if unknown."""
    armed = armed_rows(flight)
    falls = [_fall_after(flight, int(row)) for row in np.flatnonzero(armed[:-1] & ~armed[1:])]
    return max((fall for fall in falls if np.isfinite(fall)), default=np.nan)


def _fall_after(flight: Flight, off: int) -> float:
    """Return how far a vehicle fell in the 2 s after the log row `off` [m], NaN if its height is unknown."""
    up = -flight.pos[off : int(np.searchsorted(flight.t, flight.t[off] + _FALL_S, "right")), 2]
    known = up[np.isfinite(up)]
    return float(known[0] - known.min()) if known.size else np.nan


def disarming(
    flight: Flight, t: np.ndarray, texts: Sequence[StatusText], events_s: Sequence[float] = ()
) -> Disarming | None:
    """Return the last disarming in a log, or None if the vehicle was never armed or is still armed at the end.

    A vehicle that falls silent while it is armed is still armed.

    t: times of the rows [s] (n,).  texts: the autopilot's STATUSTEXTs.  events_s: times at which the router reported the disarming [s].
    """
    last = armed_rows(flight)
    armed = np.flatnonzero(last)
    if not armed.size:
        return None
    if not last[-1]:
        return Disarming(at_s=float(t[armed[-1] + 1]), in_log=True)
    off = np.flatnonzero(~last)
    armed_s = float(t[off[-1] + 1]) if off.size else float(t[0])
    newest = [x for x in texts if x.at_s > armed_s and x.text.startswith(_ARMING)][-1:]
    if newest and newest[0].text.startswith("Disarmed"):
        return Disarming(at_s=newest[0].at_s, in_log=False)
    later = [at for at in events_s if at > float(t[-1])]
    return Disarming(at_s=later[-1], in_log=False) if later else None
