"""The section of a page about the smoke flight: name, rules with their worst values, failures. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from arena.report.html_page import number
from arena.report.run_data import RunData


def scenario_rows(run: RunData) -> dict[str, Any]:
    """Return name, file, seed and failures of the smoke flight; {} if the run was not a smoke flight."""
    if not run.scenario:
        return {}
    verdict = run.scenario.get("verdict") or {}
    judged = [*verdict.get("steps", ()), *verdict.get("rules", ())]
    failures = [(one["place"], one["failure"]) for one in judged if one.get("failure")]
    return {
        "name": run.scenario.get("scenario", ""),
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
    """Return the row of one rule of a smoke flight. worst: its worst value with the unit, as text."""
    worst, text = rule.get("worst"), str(rule["place"]["text"])
    shown = "" if worst is None else f"{number(worst)} {rule.get('unit', '')}".rstrip()
    if worst is not None and text == "inside geofence":
        shown = f"{number(abs(worst))} m {'outside' if worst > 0.0 else 'inside'}"
    elif worst is not None and rule.get("unit") == "%":
        shown = f"{worst:.4g} %"
    if text == "no process fails" and run.scenario.get("passed"):
        allowed = [str(what).partition(":")[0] for what in run.outcome.get("failed") or ()]
        text += f", except those that the scenario allows ({', '.join(allowed)})" if allowed else ""
    outcome = str(rule.get("outcome", ""))
    return {
        "text": text,
        "result": "FAILED" if outcome == "failed" else outcome,
        "worst": shown,
        "at_s": None if worst is None else rule.get("at_s"),
        "who": rule.get("who", ""),
    }
