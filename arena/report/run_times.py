"""Texts of the report about a run's duration, simulated time and simulation speed. Pure."""

from __future__ import annotations

import math
from typing import Any

from arena.report.html_page import number
from arena.report.run_data import RunData

_LEAST_S = 1.0  # shortest time of the computer from which a speed is computed


def facts(run: RunData) -> list[tuple[str, str]]:
    """Return (label, text) pairs for the report: duration of the run, simulated time, simulation speed.

    A run without simulation has only its duration.
    """
    lasted, simulated = run.outcome.get("duration_s"), _simulated_s(run)
    if not isinstance(lasted, int | float):
        return []
    if simulated is None:
        return [("duration of the run", f"{lasted:.1f} s")]
    ready = _ready_s(run)
    start = f", of which {ready:.1f} s until all processes were ready" if ready is not None else ""
    found = [
        ("simulated time", f"{simulated:.1f} s"),
        ("time of the computer", f"{lasted:.1f} s{start}"),
    ]
    asked = _real_time(run).get("asked")
    flying = (
        _speed_in_flight(run) if asked is None else None
    )  # with a requested speed, the verdict states that of the whole run
    if flying is not None:
        found.append(("speed from the take-off on", f"{flying:.2f} times real time"))
    elif (factor := _real_time(run).get("factor")) is not None:
        found.append(("speed of the simulation", f"{factor:.2f} times real time"))
    return found


def world_words(run: RunData) -> str:
    """Return sentences for the report about the speed of the simulation.

    The lateness of steps is stated only if a speed was requested.
    """
    stats = run.stats("world")
    slowest = stats.get("rtf_min")
    if (
        _simulated_s(run) is not None
        and _real_time(run).get("factor") is not None
        and _real_time(run).get("asked") is None
    ):
        flying = _speed_in_flight(run)
        when = ", start included" if flying is None else " from the take-off on"
        speed = number(_real_time(run)["factor"] if flying is None else flying)
        details = (
            f", in its slowest second {number(slowest)} times (start included)" if slowest is not None else ""
        )
        return (
            f"The simulation ran {speed} times as fast as real time{when}{details}."
            " It does not wait for the clock, so slowness does not change the flight."
        )
    if stats.get("lateness_p99_ms") is None:
        return ""
    return (
        f"The steps of the simulated world were late by {number(stats['lateness_p99_ms'])} ms (p99), at most"
        f" {number(stats.get('lateness_worst_ms'))} ms. Real-time factor in each second:"
        f" {number(slowest)} to {number(stats.get('rtf_max'))}."
    )


def slowest_second(run: RunData) -> tuple[float, float] | None:
    """Return when the simulation was slowest [s], and its real-time factor in that second [-].

    The time is on the report's time axis. None if the time was not recorded, or if the axis shows wall time.
    """
    stats = run.stats("world")
    at_s, factor = stats.get("rtf_min_sim_s"), stats.get("rtf_min")
    if run.clock != "simulation" or not isinstance(at_s, int | float) or not isinstance(factor, int | float):
        return None
    return float(at_s) - run.origin_s, float(factor)


def _real_time(run: RunData) -> dict[str, Any]:
    return dict(run.outcome.get("real_time") or {})


def _simulated_s(run: RunData) -> float | None:
    found = run.stats("world").get("sim_time_s")
    return float(found) if isinstance(found, int | float) and run.clock == "simulation" else None


def _ready_s(run: RunData) -> float | None:
    """Return the wall time from the start of the run until the last process was ready [s], or None if unknown."""
    first: dict[str, float] = {}
    for event in run.events:
        if event.after == "READY" and math.isfinite(event.unix_s):
            first.setdefault(event.process, event.unix_s)
    begins = [event.unix_s for event in run.events if math.isfinite(event.unix_s)]
    return max(first.values()) - begins[0] if first else None


def _speed_in_flight(run: RunData) -> float | None:
    """Return the mean simulation speed in flight (simulated seconds per wall second), or None if unknown.

    The span goes from the first takeoff to the last event.
    """
    known = [e for e in run.events if math.isfinite(e.at_s) and math.isfinite(e.unix_s)]
    begin = next((e for e in known if e.text.endswith(": airborne")), None)
    if begin is None or run.clock != "simulation":
        return None
    end = next((e for e in reversed(known) if e.text.endswith(": disarmed") or e.process == "arena"), begin)
    lasted = end.unix_s - begin.unix_s
    return (end.at_s - begin.at_s) / lasted if lasted >= _LEAST_S else None
