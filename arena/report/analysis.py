"""Computes the measures of one flight, such as the tracking error, from its log in memory.

Reads no files. A measure without data is None.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import RPY
from arena.flight_log.flight import Flight
from arena.geometry import Array
from arena.report.happenings import estimated, tracked
from arena.report.held_setpoints import Spans, constant_spans, last_row_of_held_setpoint, setpoints
from arena.report.landings import (
    FELL_M,
    air_time_s,
    armed_rows,
    flown_times,
    has_landed,
    landing_drift,
    largest_fall,
    last_touchdown,
)


def analyse(flight: Flight, *, disarmed: bool | None = None, first_row_s: float = 0.0) -> dict[str, Any]:
    """Return all measures of a flight as a JSON-ready object, in metres, seconds and degrees.

    disarmed: whether the vehicle was disarmed at the end; None: as the log last reported.
    first_row_s: time of the first row on the time axis of the results [s].
    """
    spans, flights = constant_spans(flight), flown_times(flight)
    found: dict[str, Any] = {
        "rows": int(flight.t.size),
        "duration_s": _round(flight.t[-1], 2),
        "log_hz": _round(_rate(flight), 2),
        "judged_by": flight.position_source,
        "flown": bool(flights),
        "took_off_s": _round(flight.t[flights[0][0]] + first_row_s, 3) if flights else None,
        "in_air_s": _round(air_time_s(flight), 2),
        "tracking": tracking(flight),
        "setpoints": setpoints(flight, spans),
        "landing": landing(flight, not armed_rows(flight)[-1] if disarmed is None else disarmed, spans),
        "estimator": estimator(flight),
        "modes": modes(flight),
        "battery_end": _round(_last(flight.numbers.get("info.battery")), 1),
    }
    for part in (found["landing"], *found["modes"], *found["setpoints"]["each"]):
        for key in _MOMENTS & part.keys():
            part[key] = None if part[key] is None else round(part[key] + first_row_s, 3)
    return found


_MOMENTS = {"begun_s", "touchdown_s", "t_s", "at_s", "until_s"}
"""Keys of moments in the measures of a flight."""


def tracking(flight: Flight) -> dict[str, float | None]:
    """Return the rms and the maximum of the tracking error in the air [m].

    The tracking error is the distance between position and position reference in OFFBOARD.

    Only the time in the air counts, because the vehicle cannot follow a setpoint before its take-off.
    Climbs and steps of the reference are included, so a large step increases both values.
    """
    distance = np.linalg.norm(flight.pos - flight.group("pos_ref"), axis=1)[tracked(flight)]
    return {"rms_m": _round(_rms(distance)), "max_m": _round(_max(distance))}


def landing(flight: Flight, disarmed: bool, spans: Spans) -> dict[str, Any]:
    """Return how the landing ended, its horizontal drift, and its distance from the last setpoint [m].

    A vehicle that did not fly has not landed.

    drift_m: horizontal distance from the place where the landing mode began to the place of the touchdown; None if the
        vehicle did not land in a landing mode.
    error_m: horizontal distance of the landing place from the last position setpoint in OFFBOARD. It is known only if this
        setpoint was held for at least 1.5 s, because a vehicle cannot reach a setpoint that jumps directly before the landing.
    spans: time spans with a constant setpoint.
    """
    landed = has_landed(flight)
    drift, touchdown = landing_drift(flight), last_touchdown(flight)
    found: dict[str, Any] = {
        "landed": landed and disarmed and not largest_fall(flight) > FELL_M,
        "drift_m": None if drift is None else _round(drift.distance_m),
        "begun_s": None if drift is None else _round(drift.begun_s, 3),
        "touchdown_s": None if touchdown is None else _round(flight.t[touchdown], 3),
        "error_m": None,
    }
    held = last_row_of_held_setpoint(flight, spans)
    if held is None or not flown_times(flight):
        return found
    target = flight.group("pos_ref")[held, :2]
    error = float(np.linalg.norm(_last_place(flight) - target)) if landed else math.nan
    return {**found, "error_m": _round(error), "target_ne": [_round(x, 3) for x in target]}


def _last_place(flight: Flight) -> Array:
    """Return the last known position with the vehicle landed: north and east [m] (2,), or NaN if unknown."""
    pos = flight.pos[flight.landed, :2]
    seen = pos[np.isfinite(pos).all(axis=1)]
    return seen[-1] if len(seen) else np.full(2, np.nan)


def estimator(flight: Flight) -> dict[str, float | None]:
    """Return the rms and the maximum of the estimate's error in the air: position [m] and yaw [deg].

    The error is the estimate minus the ground truth, or, for a real vehicle, minus motion capture.
    """
    if flight.position_source == "estimate":
        return {"pos_rms_m": None, "pos_max_m": None, "yaw_rms_deg": None, "yaw_max_deg": None}
    error, turned = flight.group("err.pos"), flight.group("err.att_euler", RPY)[:, 2]
    if flight.position_source == "capture":
        error = flight.group("ekf.pos") - flight.pos
        turned = flight.group("ekf.att_euler", RPY)[:, 2] - flight.euler[:, 2]
        turned = (turned + np.pi) % (2 * np.pi) - np.pi
    flying = estimated(flight)
    distance = np.linalg.norm(error, axis=1)[flying]
    yaw = np.degrees(np.abs(turned))[flying]
    return {
        "pos_rms_m": _round(_rms(distance)),
        "pos_max_m": _round(_max(distance)),
        "yaw_rms_deg": _round(_rms(yaw), 3),
        "yaw_max_deg": _round(_max(yaw), 3),
    }


def modes(flight: Flight) -> list[dict[str, Any]]:
    """List all changes of the flight mode and of the armed flag in a flight.

    Each entry has the time [s], the flight mode and the armed flag.
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
