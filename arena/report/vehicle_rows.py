"""Table rows about the vehicles of a run: flights, errors, and constant position setpoints. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.report import errors
from arena.report.analysis import analyse
from arena.report.fates import fate_of
from arena.report.figures import Drawn
from arena.report.happening import Happening
from arena.report.happenings import disarming_of
from arena.report.landings import flown_times, touchdown_row
from arena.report.run_data import RunData


def vehicle_row(one: Drawn, run: RunData, found: Sequence[Happening]) -> dict[str, Any]:
    flight, fate = one.flight, fate_of(one.name, run, found)
    spans = flown_times(flight)
    tracking = errors.measures(one.t, errors.norm(errors.tracking_error(flight)))
    estimate = errors.measures(one.t, errors.norm(errors.estimate_error(flight)))
    up = errors.measures(one.t, np.where(flight.armed, -flight.pos[:, 2], np.nan).clip(min=0.0))
    off = disarming_of(one.name, run)
    analysis = analyse(flight, disarmed=off is not None)
    down = spans[-1] if spans and flight.landed[spans[-1][1]] else None
    return {
        "name": one.name,
        "colour": one.colour,
        "fate": fate,
        "took_off_s": float(one.t[spans[0][0]]) if spans else None,
        "touchdown_s": float(one.t[touchdown_row(flight, *down)]) if down else None,
        "landed_s": float(one.t[down[1]]) if down else None,
        "disarmed": off,
        "height": up,
        "tracking": tracking,
        "estimate": estimate,
        "settled": _worst_setpoint(analysis, float(one.t[0])),
        "landing_m": analysis["landing"]["error_m"],
        "drift_m": analysis["landing"]["drift_m"],
        "begun_s": None if (begun := analysis["landing"]["begun_s"]) is None else begun + float(one.t[0]),
        "battery": analysis["battery_end"],
        "source": {"truth": "simulator", "capture": "motion capture", "estimate": "autopilot's estimate"}[
            flight.position_source
        ],
    }


def _worst_setpoint(analysis: Mapping[str, Any], start_s: float) -> Mapping[str, Any] | None:
    """Return the constant position setpoint with the largest error, of those at which the vehicle settled.

    None means that the vehicle has not settled at any constant position setpoint.

    `at_s` is the time of the measured row. start_s: time of the first row [s].
    """
    known = [e for e in analysis["setpoints"]["each"] if e["error_m"] is not None and e["settled"]]
    worst = max(known, key=lambda e: e["error_m"], default=None)
    return None if worst is None else {**worst, "at_s": worst["at_s"] + start_s}


def error_rows(vehicles: Sequence[Drawn], chart: str) -> list[dict[str, Any]]:
    """Return one table row per vehicle with statistics of its tracking errors or estimator errors.

    chart: figure that shows these errors, `tracking` or `estimator`. Vehicles without values get no row.
    """
    rows = []
    for one in vehicles:
        cells = [
            (row, errors.measures(one.t, row.values(one.flight))) for row in errors.ROWS if row.chart == chart
        ]
        if any(found is not None for _, found in cells):
            rows.append({"name": one.name, "colour": one.colour, "cells": cells})
    return rows


def setpoint_rows(vehicles: Sequence[Drawn]) -> list[dict[str, Any]]:
    """Return one table row per time span with a constant position setpoint."""
    return [
        {
            **each,
            "name": one.name,
            "colour": one.colour,
            "until_s": each["until_s"] + float(one.t[0]),
            "at_s": each["at_s"] + float(one.t[0]),
        }
        for one in vehicles
        for each in analyse(one.flight)["setpoints"]["each"]
    ]
