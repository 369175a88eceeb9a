"""Ends of the vehicles' flights, as shown on the page of a run. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from arena.flight_log.flight import Flight
from arena.report.happening import Happening, Level
from arena.report.happenings import disarming_of
from arena.report.landings import FELL_M, air_time_s, ends_in_air, flown_times, has_landed, largest_fall
from arena.report.run_data import INCOMPLETE, RunData

LOG_ENDS_EARLY = "a log that ends before its flight"
"""Text about a vehicle that has flown after the end of an incomplete record."""


@dataclass(frozen=True, kw_only=True)
class Fate:
    """End of one vehicle's flight: a text, the flight time, and a level (good, warn or bad).

    end: text such as `landed`, the same for all vehicles with the same end.
    flown_s: time from take-off to touchdown [s], 0 if the vehicle did not fly.
    """

    end: str
    flown_s: float
    level: Level


def fate_of(name: str, run: RunData, found: Sequence[Happening]) -> Fate:
    """Return how the flight of a vehicle ended.

    found: what happened (see `arena.report.happenings`).
    """
    flight, how = run.flights.get(name), crash_of(name, run, found)
    judged = (run.stats("world").get("vehicles") or {}).get(name) or {}
    spans = flown_times(flight) if flight is not None else []
    flown = air_time_s(flight) if flight is not None else 0.0
    if how:
        return Fate(end=f"crashed ({how})", flown_s=flown, level="bad")
    if flight is None:
        return Fate(end="left no log", flown_s=0.0, level="warn")
    if not spans:
        if unrecorded_s := unrecorded_flight_s(flight, judged, run.missing):
            return Fate(end=f"left {LOG_ENDS_EARLY}", flown_s=unrecorded_s, level="warn")
        return Fate(end="did not fly", flown_s=0.0, level="warn")
    end, level = _end_of_flight(flight, disarmed=disarming_of(name, run) is not None)
    return Fate(end=end, flown_s=flown, level=level)


def _end_of_flight(flight: Flight, *, disarmed: bool) -> tuple[str, Level]:
    """Return the text and the level of the end of a flight without a crash.

    disarmed: whether the vehicle was disarmed at the end.
    """
    if ends_in_air(flight):
        return "was still in the air when its log ended", "bad"
    if (fell := largest_fall(flight)) > FELL_M:
        return f"was disarmed in the air and fell {fell:.1f} m", "bad"
    if not has_landed(flight):  # its fall is short or unknown
        return "was disarmed before its landing was reported", "warn"
    return ("landed", "good") if disarmed else ("landed but stayed armed", "warn")


def unrecorded_flight_s(flight: Flight, judged: Mapping[str, Any], missing: Collection[str]) -> float:
    """Return the time in the air that the world has measured, for a flight that the log does not contain [s].

    Return 0 if the log contains a flight, or if the record is complete.

    judged: statistics of the world about the vehicle, {} if there are none.  missing: see `RunData.missing`.
    """
    incomplete = any(text.startswith(INCOMPLETE) for text in missing)
    return float(judged.get("airborne_s") or 0.0) if incomplete and not flown_times(flight) else 0.0


def crash_of(name: str, run: RunData, found: Sequence[Happening]) -> str:
    """Return the crash report of a vehicle, or "" if no crash was reported.

    The events have the report also if the run has no outcome.json, and in a replay.

    found: what happened (see `arena.report.happenings`).
    """
    crash = next((h for h in found if h.kind == "crash" and name in h.vehicles), None)
    judged = (run.stats("world").get("vehicles") or {}).get(name) or {}
    return crash.text.removeprefix("crashed: ") if crash else str(judged.get("crashed") or "")
