"""Time spans of a flight with a constant position setpoint, and the position error at the end of each. Pure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from arena.flight_log.flight import Flight
from arena.report.happenings import in_air

Spans = list[tuple[int, int]]
"""(first row, last row) of each time span."""

_SAME_M = 0.002
HELD_S = 1.5
"""Least duration of a held setpoint [s]."""
SETTLED_S, SETTLED_M_S = 3.0, 0.25
"""A vehicle counts as settled if it was in the air for so long with a setpoint [s], or is slower than this at its end [m/s]."""
# POSITION_TARGET_LOCAL_NED comes 10 times per second: rows show the old reference until the next message.
_BEFORE_CHANGE_S = 0.15
# The autopilot can send the reference of the landing mode before the HEARTBEAT with this mode.
_MODE_LATER_S = 1.2
_NEAR_M = 0.15  # of a landing's reference from the place of the vehicle, north and east
_SPEED_S = 0.25  # time over which the speed at the end of a held setpoint is measured


def constant_spans(flight: Flight) -> Spans:
    """Find the time spans in OFFBOARD in which the position setpoint was constant for at least `HELD_S`.

    Return (first row, last row) of each span.
    """
    ref = flight.group("pos_ref")
    held = flight.offboard & np.isfinite(ref).all(axis=1)
    moved = np.concatenate([[True], np.abs(np.diff(ref, axis=0)).max(axis=1) > _SAME_M])
    spans, first = [], None
    for i in range(flight.t.size):
        if first is not None and (not held[i] or moved[i]):
            spans.append((first, i - 1))
            first = None
        if held[i] and first is None:
            first = i
    if first is not None:
        spans.append((first, flight.t.size - 1))
    return [(a, b) for a, b in spans if flight.t[b] - flight.t[a] >= HELD_S]


def last_row_of_held_setpoint(flight: Flight, spans: Spans) -> int | None:
    """Return the last log row of the setpoint that was held at the end of OFFBOARD. Return None if it was not held.

    The setpoint was held if it was constant for at least `HELD_S`.

    Rows at the end of OFFBOARD that already have the reference of the next mode do not count: the message with the reference
    can come before the message with the mode.

    spans: time spans with a constant setpoint, from `constant_spans`.
    """
    flown = np.flatnonzero(flight.offboard)
    if not flown.size or not spans:
        return None
    held, end = spans[-1][1], int(flown[-1])
    if flight.t[end] - flight.t[held] > _MODE_LATER_S:
        return None
    ref = flight.group("pos_ref")
    after = ref[held + 1 : end + 1]
    # A landing begins at the place of the vehicle, and its reference stays there. A setpoint that jumped is elsewhere.
    begin = flight.pos[min(held + 1, end), :2]
    return None if (np.abs(after[:, :2] - begin).max(axis=1) > _NEAR_M).any() else held


def setpoints(flight: Flight, spans: Spans) -> dict[str, Any]:
    """Measure the position error [m] at the end of each time span with a constant setpoint.

    Return the number of held setpoints, the largest error
    of those at which the vehicle had settled, and a list of all. `at_s`: time of the measured row [s].

    settled: the vehicle was in the air for at least `SETTLED_S` with this setpoint, or slower than `SETTLED_M_S` at its end.
        The climb after the take-off and setpoints that the vehicle did not reach in time are not settled.
    spans: time spans with a constant setpoint, from `constant_spans`.
    """
    pos, ref, air = flight.pos, flight.group("pos_ref"), in_air(flight)
    each: list[dict[str, Any]] = []
    for first, last in spans:
        row = max(first, int(np.searchsorted(flight.t, flight.t[last] - _BEFORE_CHANGE_S)))
        error = float(np.linalg.norm(pos[row] - ref[row]))
        each.append(
            {
                "ned": [round(float(x), 3) for x in ref[row]],
                "at_s": round(float(flight.t[row]), 3),
                "until_s": round(float(flight.t[last]), 2),
                "error_m": round(error, 4) if math.isfinite(error) else None,
                "settled": _settled(flight, air, first, row),
            }
        )
    known = [e["error_m"] for e in each if e["error_m"] is not None and e["settled"]]
    return {"count": len(each), "worst_m": max(known, default=None), "each": each}


def _settled(flight: Flight, air: np.ndarray, first: int, row: int) -> bool:
    """Return whether the vehicle had settled at a held setpoint in a log row.

    first: first row of the setpoint.
    """
    if not air.any():  # the log of a part of a flight
        begin = first
    elif not air[row]:
        return False
    else:
        begin = first + int(np.flatnonzero(air[first : row + 1])[0])
    if flight.t[row] - flight.t[begin] >= SETTLED_S:
        return True
    before = max(begin, int(np.searchsorted(flight.t, flight.t[row] - _SPEED_S)))
    lasted = float(flight.t[row] - flight.t[before])
    moved = float(np.linalg.norm(flight.pos[row] - flight.pos[before]))
    return lasted > 0.0 and moved < SETTLED_M_S * lasted
