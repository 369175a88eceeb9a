"""Section of the report page about a smoke flight: name, rules with their worst values, failures. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from arena.report.html_page import number
from arena.report.run_data import RunData


def scenario_rows(run: RunData) -> dict[str, Any]:
    """Return name, file, seed, rules and failures of the smoke flight, or {} if the run was not a smoke flight."""
    if not run.scenario:
        return {}
    verdict = run.scenario.get("verdict") or {}
    judged = [*verdict.get("steps", ()), *verdict.get("rules", ())]
    failures = [(one["place"], one["failure"]) for one in judged if one.get("failure")]
    return {
        "name": run.scenario.get("scenario", ""),
        "about": run.scenario.get("about", ""),
        "file": run.scenario.get("file", ""),
        "seed": run.scenario.get("seed", ""),
        "arena": found[1]
        if (found := re.search(r" \[(.+)\]$", str(run.scenario.get("scenario", ""))))
        else "",
        "allowed": list(run.outcome.get("failed") or ()) if run.scenario.get("passed") else [],
        "rules": [_rule_row(rule, run) for rule in verdict.get("rules", ())],
        "failures": [f"{place['file']}:{place['line']}: {text}" for place, text in failures]
        + list(verdict.get("problems", ())),
    }


def _rule_row(rule: Mapping[str, Any], run: RunData) -> dict[str, Any]:
    """Return the table row of one rule of a smoke flight.

    worst: worst value of the rule with its unit, as text.
    level: "good", "bad", or "soft" for a rule that was not checked, because the scenario failed before.
    """
    worst, text = rule.get("worst"), str(rule["place"]["text"])
    shown = "" if worst is None else f"{number(worst)} {rule.get('unit', '')}".rstrip()
    if worst is not None and text == "inside geofence":
        shown = f"{number(abs(worst))} m {'outside' if worst > 0.0 else 'inside'}"
        shown += f" ({side})" if (side := _nearest_side(rule, run)) else ""
    elif worst is not None and rule.get("unit") == "%":
        shown = f"{worst:.4g} %"
    if text == "no process fails" and run.scenario.get("passed"):
        allowed = [str(what).partition(":")[0] for what in run.outcome.get("failed") or ()]
        text += f", except those that the scenario allows ({', '.join(allowed)})" if allowed else ""
    outcome = str(rule.get("outcome", ""))
    return {
        "text": text,
        "result": _RESULTS.get(outcome, outcome),
        "level": "good" if outcome == "passed" else "bad" if outcome == "failed" else "soft",
        "worst": shown,
        "at_s": None if worst is None else rule.get("at_s"),
        "who": rule.get("who", ""),
        "vehicles": [name for name in run.names if name in str(rule.get("who", "")).split(" and ")],
        "chart": next((chart for word, chart in _CHARTS if word in text), "timeline"),
    }


_RESULTS = {"failed": "FAILED", "not reached": "not checked: the scenario failed before"}

_CHARTS = (
    ("separation", "separation"),
    ("tilt", "attitude"),
    ("battery", "battery"),
    ("touchdown", "velocity"),
    ("speed", "velocity"),
    ("height", "height"),
    ("tracking", "tracking"),
    ("estimate error", "estimator"),
    ("geofence", "position"),
    ("outside", "position"),
    ("drift", "position"),
)
"""Word in a rule -> figure that shows its quantity."""


def _nearest_side(rule: Mapping[str, Any], run: RunData) -> str:
    """Return the side of the geofence or room that was nearest to a vehicle, such as `ceiling`.

    Returns "" if it is unknown. The room counts if there is no geofence.
    """
    flight, at_s = run.flights.get(str(rule.get("who"))), rule.get("at_s")
    low_high = _limits(run)
    if flight is None or at_s is None or low_high is None:
        return ""
    row = min(int(np.searchsorted(flight.t + flight.t0 - run.origin_s, float(at_s))), flight.t.size - 1)
    north, east, down = (float(x) for x in flight.pos[row])
    (south, n), (west, e), top = low_high
    beyond = {
        "south": south - north,
        "north": north - n,
        "west": west - east,
        "east": east - e,
        "ceiling": -down - top,
    }
    return max(beyond, key=lambda side: beyond[side]) if np.isfinite(list(beyond.values())).all() else ""


def _limits(run: RunData) -> tuple[tuple[float, float], tuple[float, float], float] | None:
    """Return the limits of the geofence or room [m]: south, north, west, east, height. Return None if unknown."""
    fence = (run.plan.get("slices", {}).get("recorder.json") or {}).get("fence")
    if fence:
        return tuple(fence["north"]), tuple(fence["east"]), float(fence["up"])
    if not run.size_m:
        return None
    n, e, top = (float(x) for x in run.size_m)
    return (-n / 2.0, n / 2.0), (-e / 2.0, e / 2.0), top
