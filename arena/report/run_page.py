"""HTML page of one run, report.html: texts, tables and figures."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from arena.report import (
    attitude_figure,
    errors,
    figures,
    overview_figures,
    run_facts,
    run_times,
    separation,
    system_figures,
    system_rows,
    vehicle_rows,
    velocity_battery_figures,
)
from arena.report.figures import Drawn, Figure
from arena.report.happening import Happening
from arena.report.happenings import (
    happenings,
    together,
    without_names,
)
from arena.report.html_page import render
from arena.report.run_data import RunData
from arena.report.scenario_rows import scenario_rows
from arena.report.scenario_steps import ScenarioStep, scenario_steps
from arena.report.verdict import verdict

_MOST_LINES = 14  # vertical lines at events in the figures over time
_MOST_SHOWN = 2500  # rows of the table of all events
_MOST_NAMES = 6
_TOGETHER_S = 1.0  # equal events of several vehicles, no farther apart, are one row of the short list
_RANK = {"crash": 0, "failsafe": 1, "fault": 2, "pilot": 3, "copilot": 4, "process": 5}


def run_page(run: RunData) -> str:
    """Return report.html, the HTML page of a run."""
    found = happenings(run)
    vehicles = figures.drawn(run.flights, {name: run.origin_s for name in run.flights})
    judged = verdict(run, found)
    steps = scenario_steps(run)
    apart = separation.distances(vehicles)
    nearest = separation.smallest(apart, vehicles)
    made = _figures(run, vehicles, found, steps, apart)
    content = {
        "title": _title(run),
        "about": str(run.scenario.get("about") or ""),
        "nearest": nearest,
        "has_fence": bool(run.size_m and run.drawn.get("fence")),
        "has_obstacles": bool(run.size_m and run.drawn.get("obstacles")),
        "judged": judged,
        "facts": run_facts.facts(run, nearest),
        "vehicles": [vehicle_rows.vehicle_row(one, run, found) for one in vehicles],
        "found": found[:_MOST_SHOWN],
        "left_out": max(0, len(found) - _MOST_SHOWN),
        "story": _story(found, run.names),
        "words": _words(run, found, steps),
        "tracking": vehicle_rows.error_rows(vehicles, "tracking"),
        "estimator": vehicle_rows.error_rows(vehicles, "estimator"),
        "setpoints": vehicle_rows.setpoint_rows(vehicles),
        "links": [system_rows.link_row(one, run) for one in vehicles],
        "processes": system_rows.process_rows(run),
        "world": run_times.world_words(run),
        "slowest": run_times.slowest_second(run),
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
    """Return the title of the page: the names of the arena and of the scenario."""
    name = str(run.outcome.get("name") or run.plan.get("name") or run.folder.name)
    scenario = str(run.scenario.get("scenario") or "")
    return f"{name}: {scenario}" if scenario else name


def _figures(
    run: RunData,
    vehicles: Sequence[Drawn],
    found: Sequence[Happening],
    steps: Sequence[ScenarioStep],
    apart: separation.Distances | None,
) -> dict[str, Figure]:
    made: dict[str, Figure] = {}
    if vehicles:
        made |= {
            "timeline": overview_figures.timeline(vehicles, found, steps),
            "map": overview_figures.map_3d(vehicles, run.size_m, run.drawn),
            "height": overview_figures.height_and_error(vehicles),
            "separation": separation.separation_figure(apart, vehicles) if apart else {"data": []},
            "position": figures.position(vehicles),
            "tracking": errors.tracking_figure(vehicles),
            "estimator": errors.estimator_figure(vehicles),
            "attitude": attitude_figure.attitude(vehicles),
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
    """Return start and end of all time axes [s]: from the first log row to the last log row or event."""
    stamps = [float(one.t[k]) for one in vehicles for k in (0, -1)]
    if not stamps:
        return 0.0, 1.0
    first, end = min(stamps), max(stamps)
    late = [h.at_s for h in found if math.isfinite(h.at_s) and h.at_s > end]
    return first, max(late) + 0.02 * (max(late) - first) if late else end


def _options(run: RunData, vehicles: Sequence[Drawn], found: Sequence[Happening]) -> dict[str, Any]:
    """Return the settings of the page's script page.js: time range, vehicles, and event lines.

    They include the vehicle that is shown first.
    """
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
    """Return the events that are drawn as vertical lines over time. The most important events come first."""
    lines = (h for h in found if h.kind in _RANK and h.level != "note" and math.isfinite(h.at_s))
    return sorted(lines, key=lambda h: _RANK[h.kind])


def _line_kinds(found: Sequence[Happening]) -> list[str]:
    """Return the legend labels of the events that are drawn as vertical lines."""
    return list(dict.fromkeys(overview_figures.MARKS[h.kind][0] for h in _lines(found)))


def _preferred(vehicles: Sequence[Drawn], found: Sequence[Happening]) -> str:
    """Return the vehicle that the page shows first.

    It is the vehicle with a crash, a failsafe or a fault, or else with the largest tracking error.
    """
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


def _story(found: Sequence[Happening], order: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of the short event list: problems, takeoffs, landings, and steps of a scenario.

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


def _words(run: RunData, found: Sequence[Happening], steps: Sequence[ScenarioStep]) -> list[tuple[str, str]]:
    """Return (term, meaning) of the terms on this page that a reader may not know."""
    words = []
    if any(re.search(r"\bDESCEND\b", h.text) for h in found):
        words.append(
            (
                "DESCEND (blind land)",
                "a landing without a valid position: level, without control of the horizontal position."
                " PX4 reports this mode over MAVLink as AUTO.LAND",
            )
        )
    if any(re.search(r"(?<!AUTO\.)\bLAND\b", step.text) for step in steps):
        words.append(("LAND", "in a step of the scenario: the mode AUTO.LAND"))
    if any(re.search(r"\bHOLD\b", step.text) for step in steps):
        words.append(("HOLD", "in a step of the scenario: the mode AUTO.LOITER"))
    return words


def _for_each(text: str) -> str:
    """Replace the placeholder `*` for vehicle names by words, in the text of an event that several vehicles share.

    `*: airborne` becomes `each: airborne`, and the process `program.*` becomes `each vehicle's program`.
    """
    return re.sub(r"(\w+)\.\*", r"each vehicle's \1", text).replace("*", "each")
