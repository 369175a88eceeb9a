"""Computes measures of one flight, such as the tracking error, from its log in memory. Reads no files. A measure without data is None."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import RPY
from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.happenings import tracked

_SAME_M = 0.002
_CONSTANT_S = 1.5
# POSITION_TARGET_LOCAL_NED comes 10 times per second: rows show the old reference until the next message.
_BEFORE_CHANGE_S = 0.15


def analyse(flight: Flight, *, disarmed: bool | None = None) -> dict[str, Any]:
    """Return all measures of a flight as a JSON-ready object, in metres, seconds and degrees.

    disarmed: whether the vehicle was disarmed at the end; None: as in the last row of the log.
    """
    return {
        "rows": int(flight.t.size),
        "duration_s": _round(flight.t[-1], 2),
        "log_hz": _round(_rate(flight), 2),
        "judged_by": flight.position_source,
        "flown": bool(flight.armed.any()),
        "tracking": tracking(flight),
        "setpoints": setpoints(flight),
        "landing": landing(flight, not flight.armed[-1] if disarmed is None else disarmed),
        "estimator": estimator(flight),
        "modes": modes(flight),
        "battery_end": _round(_last(flight.numbers.get("info.battery")), 1),
    }


def tracking(flight: Flight) -> dict[str, float | None]:
    """Return rms and maximum of the tracking error, the distance between position and position reference in
    OFFBOARD [m].

    Only the time in the air counts, because the vehicle cannot follow a setpoint before its take-off.
    Climbs and steps of the reference are included, so a large step increases both values.
    """
    distance = np.linalg.norm(flight.pos - flight.group("pos_ref"), axis=1)[tracked(flight)]
    return {"rms_m": _round(_rms(distance)), "max_m": _round(_max(distance))}


def constant_spans(flight: Flight) -> list[tuple[int, int]]:
    """Find the time spans in OFFBOARD in which the position reference was constant for at least 1.5 s. Return
    (first row, last row) of each span.
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
    return [(a, b) for a, b in spans if flight.t[b] - flight.t[a] >= _CONSTANT_S]


def setpoints(flight: Flight) -> dict[str, Any]:
    """Measure the position error [m] at the end of each time span with a constant position reference.
    Return the number of spans, the largest error, and a list of all spans. `at_s`: time of the measured row [s].
    """
    pos, ref = flight.pos, flight.group("pos_ref")
    each = []
    for first, last in constant_spans(flight):
        row = max(first, int(np.searchsorted(flight.t, flight.t[last] - _BEFORE_CHANGE_S)))
        error = float(np.linalg.norm(pos[row] - ref[row]))
        each.append(
            {
                "ned": [_round(x, 3) for x in ref[row]],
                "at_s": _round(flight.t[row], 3),
                "until_s": _round(flight.t[last], 2),
                "error_m": _round(error),
            }
        )
    known = [e["error_m"] for e in each if e["error_m"] is not None]
    return {"count": len(each), "worst_m": max(known, default=None), "each": each}


def landing(flight: Flight, disarmed: bool) -> dict[str, Any]:
    """Return whether the vehicle has landed and was disarmed, and the horizontal distance of the landing point from its target [m].

    The error is known from the landing on, also if the log ends before the disarming.
    The target is the last position reference in OFFBOARD, or, if unknown, the position at the end of OFFBOARD.
    """
    flown = np.flatnonzero(flight.offboard)
    down = bool(flight.landed[-1] and disarmed)
    if not flown.size:
        return {"landed": down, "error_m": None}
    target = flight.group("pos_ref")[flown[-1], :2]
    target = (
        target if np.isfinite(target).all() else flight.pos[flown[-1], :2]
    )  # the position may be NaN in this row
    error = float(np.linalg.norm(_last_place(flight) - target)) if flight.landed[-1] else math.nan
    return {"landed": down, "error_m": _round(error), "target_ne": [_round(x, 3) for x in target]}


def _last_place(flight: Flight) -> Array:
    """Return north and east [m] (2,) of the last known position at which the vehicle was landed; NaN if
    unknown.
    """
    pos = flight.pos[flight.landed, :2]
    seen = pos[np.isfinite(pos).all(axis=1)]
    return seen[-1] if len(seen) else np.full(2, np.nan)


def estimator(flight: Flight) -> dict[str, float | None]:
    """Return rms and maximum of the error of the state estimate while armed: position [m] and yaw [deg].

    The error is the estimate minus the ground truth, or, for a real vehicle, minus motion capture.
    """
    if flight.position_source == "estimate":
        return {"pos_rms_m": None, "pos_max_m": None, "yaw_rms_deg": None, "yaw_max_deg": None}
    error, turned = flight.group("err.pos"), flight.group("err.att_euler", RPY)[:, 2]
    if flight.position_source == "capture":
        error = flight.group("ekf.pos") - flight.pos
        turned = flight.group("ekf.att_euler", RPY)[:, 2] - flight.euler[:, 2]
        turned = (turned + np.pi) % (2 * np.pi) - np.pi
    distance = np.linalg.norm(error, axis=1)[flight.armed]
    yaw = np.degrees(np.abs(turned))[flight.armed]
    return {
        "pos_rms_m": _round(_rms(distance)),
        "pos_max_m": _round(_max(distance)),
        "yaw_rms_deg": _round(_rms(yaw), 3),
        "yaw_max_deg": _round(_max(yaw), 3),
    }


def modes(flight: Flight) -> list[dict[str, Any]]:
    """List the changes of flight mode and armed flag. Each entry has the time [s], the flight mode and the
    armed flag.
    """
    found: list[dict[str, Any]] = []
    for t, mode, armed in zip(flight.t, flight.mode, flight.armed, strict=True):
        known = bool(mode)  # the mode is empty before the first heartbeat
        if known and (not found or (found[-1]["mode"], found[-1]["armed"]) != (mode, bool(armed))):
            found.append({"t_s": _round(t, 2), "mode": mode, "armed": bool(armed)})
    return found


def _rate(flight: Flight) -> float:
    return (flight.t.size - 1) / flight.t[-1] if flight.t.size > 1 and flight.t[-1] > 0 else math.nan


def _rms(x: Array) -> float:
    x = x[np.isfinite(x)]
    return float(np.sqrt((x * x).mean())) if x.size else math.nan


def _max(x: Array) -> float:
    x = x[np.isfinite(x)]
    return float(x.max()) if x.size else math.nan


def _last(x: NDArray[np.float64] | None) -> float:
    x = np.zeros(0) if x is None else x[np.isfinite(x)]
    return float(x[-1]) if x.size else math.nan


def _round(x: float, digits: int = 4) -> float | None:
    return round(float(x), digits) if math.isfinite(x) else None
