"""The page of one run, report.html: texts and tables from the content of the run folder, and the figures."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.report import (
    errors,
    figures,
    overview_figures,
    run_times,
    system_figures,
    velocity_battery_figures,
)
from arena.report.analysis import analyse
from arena.report.figures import Drawn, Figure
from arena.report.happening import Happening
from arena.report.happenings import (
    disarming_of,
    happenings,
    scenario_marks,
    together,
    without_names,
)
from arena.report.html_page import render
from arena.report.landings import flown_times, touchdown_row
from arena.report.link_record import longest_gap, mean_rate
from arena.report.run_data import RunData
from arena.report.scenario_rows import scenario_rows
from arena.report.verdict import fate_of, verdict

_MOST_LINES = 14  # vertical lines at events in the figures over time
_MOST_SHOWN = 2500  # rows of the table of all events
_MOST_NAMES = 6
_TOGETHER_S = 1.0  # equal events of several vehicles, no farther apart, are one row of the short list
_RANK = {"crash": 0, "failsafe": 1, "fault": 2, "pilot": 3, "copilot": 4, "process": 5}


def run_page(run: RunData) -> str:
    """Return report.html of a run."""
    found = happenings(run)
    vehicles = figures.drawn(run.flights, {name: run.origin_s for name in run.flights})
    judged = verdict(run, found)
    steps = scenario_marks(run)
    made = _figures(run, vehicles, found, steps)
    content = {
        "title": _title(run),
        "judged": judged,
        "facts": _facts(run),
        "vehicles": [_vehicle_row(one, run, found) for one in vehicles],
        "found": found[:_MOST_SHOWN],
        "left_out": max(0, len(found) - _MOST_SHOWN),
        "story": _story(found, run.names),
        "tracking": _error_rows(vehicles, "tracking"),
        "estimator": _error_rows(vehicles, "estimator"),
        "setpoints": _setpoint_rows(vehicles),
        "links": [_link_row(one, run) for one in vehicles],
        "processes": _process_rows(run),
        "world": run_times.world_words(run),
        "steps": steps,
        "scenario": scenario_rows(run),
        "line_kinds": _line_kinds(found),
        "real": [name for name in run.names if run.is_real(name)],
        "clock": "seconds since the start of the run" if run.clock == "unix" else "simulation time",
        "missing": run.missing,
        "made": made,
    }
    return render("run.html", content, made, _options(run, vehicles, found))


def _title(run: RunData) -> str:
    """Return the title of the page: names of the arena and of the scenario."""
    name = str(run.outcome.get("name") or run.plan.get("name") or run.folder.name)
    scenario = str(run.scenario.get("scenario") or "")
    return f"{name}: {scenario}" if scenario else name


def _figures(
    run: RunData, vehicles: Sequence[Drawn], found: Sequence[Happening], steps: Sequence[Any]
) -> dict[str, Figure]:
    made: dict[str, Figure] = {}
    if vehicles:
        made |= {
            "timeline": overview_figures.timeline(vehicles, found, steps),
            "map": overview_figures.map_3d(vehicles, run.size_m, run.drawn),
            "height": overview_figures.height_and_error(vehicles),
            "position": figures.position(vehicles),
            "tracking": errors.tracking_figure(vehicles),
            "estimator": errors.estimator_figure(vehicles),
            "attitude": figures.attitude(vehicles),
            "velocity": velocity_battery_figures.velocity(vehicles),
            "battery": velocity_battery_figures.battery(
                vehicles, {one.name: run.params(one.name) for one in vehicles}, _time_range(vehicles, found)
            ),
        }
        if run.links:
            made["links"] = system_figures.links_figure(vehicles, run.links)
    if (loads := system_figures.loads_figure(run.loads)) is not None:
        made["loads"] = loads
    if (processes := system_figures.processes_figure(run.outcome.get("processes", {}))) is not None:
        made["processes"] = processes
    return {name: figure for name, figure in made.items() if figure["data"]}


def _time_range(vehicles: Sequence[Drawn], found: Sequence[Happening]) -> tuple[float, float]:
    """Return begin and end of the time axes [s]: the whole logs, and all events after their begin."""
    stamps = [float(one.t[k]) for one in vehicles for k in (0, -1)]
    if not stamps:
        return 0.0, 1.0
    first, end = min(stamps), max(stamps)
    late = [h.at_s for h in found if math.isfinite(h.at_s) and h.at_s > end]
    return first, max(late) + 0.02 * (max(late) - first) if late else end


def _options(run: RunData, vehicles: Sequence[Drawn], found: Sequence[Happening]) -> dict[str, Any]:
    """Return the settings for page.js: time range, vehicles, the vehicle that is shown first, lines at events."""
    first, last = _time_range(vehicles, found)
    lines = _lines(found)
    marks = {(round(h.at_s, 1), h.kind): h for h in lines}
    return {
        "time": [first, last],
        "vehicles": [{"name": one.name, "colour": one.colour} for one in vehicles],
        "preferred": _preferred(vehicles, found),
        "marks": [
            {"t": h.at_s, "colour": overview_figures.MARKS[h.kind][2]}
            for h in list(marks.values())[:_MOST_LINES]
        ],
    }


def _lines(found: Sequence[Happening]) -> list[Happening]:
    """Return the events with a vertical line in the figures over time; the most important kinds are first."""
    lines = (h for h in found if h.kind in _RANK and h.level != "note" and math.isfinite(h.at_s))
    return sorted(lines, key=lambda h: _RANK[h.kind])


def _line_kinds(found: Sequence[Happening]) -> list[str]:
    """Return the names of the kinds of events that have vertical lines."""
    return list(dict.fromkeys(overview_figures.MARKS[h.kind][0] for h in _lines(found)))


def _preferred(vehicles: Sequence[Drawn], found: Sequence[Happening]) -> str:
    """Return the vehicle that is shown first: that with a crash, a failsafe or a fault, else that with the largest tracking error."""
    for kind in _RANK:
        for h in found:
            if (
                h.kind == kind
                and h.level != "note"
                and h.vehicles
                and h.vehicles[0] in {one.name for one in vehicles}
            ):
                return h.vehicles[0]
    worst = {
        one.name: float(np.nanmax(errors.norm(errors.tracking_error(one.flight)), initial=0.0))
        for one in vehicles
    }
    return max(worst, key=lambda name: worst[name]) if worst else ""


def _facts(run: RunData) -> list[tuple[str, str]]:
    """Return (label, text) of the line below the verdict."""
    outcome, found = run.outcome, []
    if run.replay_of:
        found.append(("replay of", run.replay_of))
    if outcome.get("start"):
        found.append(("start", str(outcome["start"]).replace("T", " ")[:19]))
    found += run_times.facts(run)
    pilots = sorted({str(v.get("autopilot", "")) for v in run.plan.get("vehicles", ())} - {""})
    found.append(
        (
            "vehicles",
            f"{len(run.names)}" + (f" ({', '.join(_AUTOPILOT.get(p, p) for p in pilots)})" if pilots else ""),
        )
    )
    if run.size_m:
        found.append(("room", " x ".join(f"{float(x):g}" for x in run.size_m) + " m (north x east x height)"))
    if fence := _fence_words(run):
        found.append(("geofence", fence))
    if outcome.get("exit_code") is not None:
        allowed = " (allowed by the scenario)" if outcome["exit_code"] and run.scenario.get("passed") else ""
        found.append(("exit code", f"{outcome['exit_code']}{allowed}"))
    found.append(("run folder", run.folder.resolve().name))
    return found


def _fence_words(run: RunData) -> str:
    """Return the limits of the geofence as text; "" without a geofence."""
    given = run.plan.get("slices", {}).get("recorder.json") or {}
    box = given.get("fence")
    if not box:
        return ""
    (south, north), (west, east) = box["north"], box["east"]
    return f"north {south:g} to {north:g} m, east {west:g} to {east:g} m, up to {box['up']:g} m"


_AUTOPILOT = {
    "builtin": "built-in autopilot",
    "px4": "PX4 SITL",
    "hardware": "real flight controller",
    "hitl": "flight controller in the loop",
    "replay": "replayed",
}


def _story(found: Sequence[Happening], order: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of the short list of events: what needs attention, take-offs, landings, and steps of a scenario.

    Equal events of several vehicles at nearly the same time are one row.  order: names of the vehicles.
    """
    shown = [h for h in found if h.level in ("bad", "warn") or h.kind in ("flight", "fault", "step")]
    shown = sorted(
        (*shown, *(h for h in found if h.kind == "mode" and h.level == "good")),
        key=lambda h: h.at_s if math.isfinite(h.at_s) else -math.inf,
    )
    rows = []
    for group in together(shown, _TOGETHER_S):
        names = [name for name in order if any(name in h.vehicles for h in group)]
        first = group[0]
        text = first.text if len(group) == 1 else _for_each(without_names(first))
        rows.append(
            {
                "first_s": first.at_s,
                "last_s": group[-1].at_s,
                "level": first.level,
                "who": ", ".join(names) if len(names) <= _MOST_NAMES else f"{len(names)} vehicles",
                "text": text,
            }
        )
    return rows


def _for_each(text: str) -> str:
    """Return the text of an event with `*` in place of the name of the vehicle, so that equal events of several vehicles are found."""
    return re.sub(r"(\w+)\.\*", r"\1 of each", text).replace("*", "each")


def _vehicle_row(one: Drawn, run: RunData, found: Sequence[Happening]) -> dict[str, Any]:
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
        "battery": analysis["battery_end"],
        "source": {"truth": "simulator", "capture": "motion capture", "estimate": "autopilot's estimate"}[
            flight.position_source
        ],
    }


def _worst_setpoint(analysis: Mapping[str, Any], start_s: float) -> Mapping[str, Any] | None:
    """Return the held setpoint with the largest error; `at_s`: time of the measured row. start_s: time of the first row [s]."""
    known = [e for e in analysis["setpoints"]["each"] if e["error_m"] is not None]
    worst = max(known, key=lambda e: e["error_m"], default=None)
    return None if worst is None else {**worst, "at_s": worst["at_s"] + start_s}


def _error_rows(vehicles: Sequence[Drawn], chart: str) -> list[dict[str, Any]]:
    """Return one row per vehicle: the measures of each error that the figure `chart` shows; none without values."""
    rows = []
    for one in vehicles:
        cells = [
            (row, errors.measures(one.t, row.values(one.flight))) for row in errors.ROWS if row.chart == chart
        ]
        if any(found is not None for _, found in cells):
            rows.append({"name": one.name, "colour": one.colour, "cells": cells})
    return rows


def _setpoint_rows(vehicles: Sequence[Drawn]) -> list[dict[str, Any]]:
    """Return one row per time span in which a position setpoint was constant."""
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


def _link_row(one: Drawn, run: RunData) -> dict[str, Any]:
    """Return rates, longest gaps and age of the poses of one vehicle."""
    link, flown = run.links.get(one.name), flown_times(one.flight)
    start, end = (float(one.t[flown[0][0]]), float(one.t[flown[-1][1]])) if flown else (-math.inf, math.inf)
    forward = run.stats(f"forward.{one.name}")
    recorded = run.stats("recorder").get("vehicles", {}).get(one.name) or run.stats(f"logger.{one.name}")
    row: dict[str, Any] = {
        "name": one.name,
        "colour": one.colour,
        "forward_hz": forward.get("rate_hz"),
        "log_hz": analyse(one.flight)["log_hz"],
    }
    row |= {"dropped": _dropped(forward), "up_hz": None, "down_gap": None, "pose_gap": None, "age": None}
    if link is None:
        return {**row, "down_hz": recorded.get("datagrams_hz"), "pose_hz": recorded.get("mocap_hz")}
    ages = 1e3 * link.pose_age_s
    return {
        **row,
        "down_hz": mean_rate(link.down_s),
        "up_hz": mean_rate(link.up_s),
        "pose_hz": mean_rate(link.pose_s),
        "down_gap": longest_gap(link.down_s, start, end),
        "pose_gap": longest_gap(link.pose_s, start, end),
        "age": errors.measures(link.pose_s, ages),
    }


def _dropped(stats: Mapping[str, Any]) -> str:
    """Return the numbers of frames and messages that a pose forwarder has dropped, by reason."""
    found = {
        key.removeprefix("dropped "): value
        for key, value in stats.items()
        if key.startswith("dropped ") and value
    }
    return ", ".join(f"{value} {_DROPPED.get(key, key)}" for key, value in found.items())


_DROPPED = {
    "untracked": "poses not tracked",
    "held for the origin": "poses while the autopilot had no origin",
    "superseded": "poses older than another pose",
    "repeated frame": "repeated frames",
    "stale": "poses too old",
    "no pose": "without a valid pose",
    "foreign message": "received from other senders than the autopilot",
}


def _process_rows(run: RunData) -> list[dict[str, Any]]:
    rows = []
    for name, row in run.outcome.get("processes", {}).items():
        rows.append(
            {
                "name": name,
                "member_of": row.get("member_of", ""),
                "cpu": None if row.get("cpu_mean") is None else 100.0 * row["cpu_mean"],
                "cpu_s": row.get("cpu_s"),
                "memory": row.get("rss_peak_mb"),
                "starts": row.get("starts"),
                "end": row.get("exit") or row.get("reason") or row.get("state") or "",
                "over": ", ".join(map(str, row.get("over_budget") or ())),
            }
        )
    return rows
