"""Measures of two flights side by side, such as their tracking errors. Pure."""

from __future__ import annotations

import numpy as np

from arena.report import errors
from arena.report.analysis import analyse
from arena.report.flight_pair import Pair, Side
from arena.report.landings import air_time_s, flown_times


def pair_figures(pair: Pair) -> list[tuple[str, str, int, float | None, float | None]]:
    """Compare two flights A and B: return (label, unit, decimals, value of A, value of B) of each measure."""
    a, b = _values(pair.a), _values(pair.b)
    rows = [(label, unit, digits, a[label], b[label]) for label, unit, digits in _LABELS]
    return [row for row in rows if row[3] is not None or row[4] is not None]


_LABELS = (
    ("time in the air", "s", 1),
    ("largest height above that at time 0", "m", 2),
    ("tracking error, rms", "m", 3),
    ("tracking error, p95", "m", 3),
    ("tracking error, max.", "m", 3),
    ("largest error at a settled held setpoint", "m", 3),
    ("yaw tracking error, rms", "deg", 2),
    ("estimate error, rms", "m", 4),
    ("estimate error, max.", "m", 4),
    ("largest tilt", "deg", 1),
    ("drift while landing", "m", 3),
    ("landing error (last setpoint held)", "m", 3),
    ("battery used", "%", 1),
)


def _values(side: Side) -> dict[str, float | None]:
    flight, found = side.flight, analyse(side.flight)
    tracking = errors.measures(side.t, errors.norm(errors.tracking_error(flight)))
    yaw = errors.measures(side.t, errors.yaw_tracking_error(flight))
    estimate = errors.measures(side.t, errors.norm(errors.estimate_error(flight)))
    up = -flight.pos[:, 2][np.isfinite(flight.pos[:, 2])]
    tilt = np.degrees(np.arccos(np.clip(np.cos(flight.euler[:, 0]) * np.cos(flight.euler[:, 1]), -1.0, 1.0)))[
        flight.armed
    ]
    battery = flight.numbers.get("info.battery", np.zeros(0))
    battery = battery[np.isfinite(battery)]
    return {
        "time in the air": air_time_s(flight) if flown_times(flight) else None,
        "largest height above that at time 0": float(up.max()) if up.size else None,
        "tracking error, rms": tracking.rms if tracking else None,
        "tracking error, p95": tracking.p95 if tracking else None,
        "tracking error, max.": tracking.max if tracking else None,
        "largest error at a settled held setpoint": found["setpoints"]["worst_m"],
        "yaw tracking error, rms": yaw.rms if yaw else None,
        "estimate error, rms": estimate.rms if estimate else None,
        "estimate error, max.": estimate.max if estimate else None,
        "largest tilt": float(np.nanmax(tilt)) if np.isfinite(tilt).any() else None,
        "drift while landing": found["landing"]["drift_m"],
        "landing error (last setpoint held)": found["landing"]["error_m"],
        "battery used": float(battery[0] - battery[-1]) if battery.size else None,
    }
