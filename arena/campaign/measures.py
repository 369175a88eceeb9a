"""Measures of one flight, such as the tracking error, from the logs of its vehicles and outcome.json. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from arena.flight_log.flight import Flight
from arena.report.analysis import analyse

Numbers = Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Measure of a flight, such as the largest tracking error: name, unit, meaning and function.

    of_flight: function that computes the value of the flight from the known values of its vehicles.
    """

    name: str
    unit: str
    meaning: str
    of_flight: Callable[[Sequence[float]], float] = max


MEASURES = (
    Measure(
        name="tracking_rms_m",
        unit="m",
        meaning="distance to the position reference in OFFBOARD in the air, rms",
    ),
    Measure(
        name="tracking_max_m",
        unit="m",
        meaning="distance to the position reference in OFFBOARD in the air, largest",
    ),
    Measure(
        name="setpoint_error_m",
        unit="m",
        meaning="distance to a held position setpoint at its end, when the vehicle has settled, largest",
    ),
    Measure(
        name="landing_error_m",
        unit="m",
        meaning="horizontal distance of the landing point from the last position setpoint, if this was held for 1.5 s",
    ),
    Measure(
        name="landing_drift_m",
        unit="m",
        meaning="horizontal distance between the places where the landing mode began and of the touchdown",
    ),
    Measure(name="estimate_rms_m", unit="m", meaning="error of the estimated position in the air, rms"),
    Measure(name="estimate_max_m", unit="m", meaning="error of the estimated position in the air, largest"),
    Measure(name="tilt_max_deg", unit="deg", meaning="largest tilt"),
    Measure(name="touchdown_m_s", unit="m/s", meaning="speed of the last touchdown"),
    Measure(name="airborne_s", unit="s", meaning="simulated time off the floor"),
    Measure(name="crashes", unit="1", meaning="number of vehicles that crashed", of_flight=sum),
)


def of_vehicle(flight: Flight | None, recorded: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the measures of one vehicle; None for a measure without data.

    flight: log of the vehicle.  recorded: values of this vehicle from `recorded_by_world`; {} if unknown.
    """
    found: dict[str, float | None] = dict.fromkeys((m.name for m in MEASURES), None)
    if flight is not None:
        made = analyse(flight)
        found |= {
            "tracking_rms_m": made["tracking"]["rms_m"],
            "tracking_max_m": made["tracking"]["max_m"],
            "setpoint_error_m": made["setpoints"]["worst_m"],
            "landing_error_m": made["landing"]["error_m"],
            "landing_drift_m": made["landing"]["drift_m"],
            "estimate_rms_m": made["estimator"]["pos_rms_m"],
            "estimate_max_m": made["estimator"]["pos_max_m"],
        }
    found |= {
        "tilt_max_deg": recorded.get("max_tilt_deg"),
        "touchdown_m_s": recorded.get("touchdown_m_s"),
        "airborne_s": recorded.get("airborne_s"),
        "crashes": float(bool(recorded["crashed"])) if "crashed" in recorded else None,
    }
    return found


def of_flight(vehicles: Mapping[str, Numbers]) -> dict[str, float | None]:
    """Combine the measures of all vehicles of a flight into one value per measure.

    The value is the sum for crashes, and the largest value for every other measure.

    vehicles: vehicle -> its measures.
    """
    found: dict[str, float | None] = {}
    for measure in MEASURES:
        known = [v for own in vehicles.values() if (v := own.get(measure.name)) is not None]
        found[measure.name] = measure.of_flight(known) if known else None
    return found


def recorded_by_world(outcome: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
    """Return vehicle -> values that the simulated world has recorded, such as crash and touchdown speed.

    outcome: content of outcome.json.
    """
    stats = outcome.get("processes", {}).get("world", {}).get("stats") or {}
    found = stats.get("vehicles")
    return found if isinstance(found, dict) else {}
