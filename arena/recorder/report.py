"""The report of a run: `python -m arena.recorder.report RUN` writes plots, summary.json and summary.txt.

If a run was killed, some files are missing or incomplete. The report lists the missing files and uses the others.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from arena.recorder.analysis import analyse
from arena.recorder.flight_log import Flight, read_flight
from arena.recorder.summary import as_text

_OUTCOME = (
    "name",
    "start",
    "end",
    "duration_s",
    "cause",
    "reason",
    "exit_code",
    "failed",
    "landing",
    "real_time",
)
_PROCESS = (
    "state",
    "reason",
    "exit_code",
    "exit",
    "starts",
    "alive_s",
    "cpu_s",
    "cpu_mean",
    "rss_peak_mb",
    "over_budget",
    "stats",
)
_WORLD = ("lateness_p99_ms", "lateness_worst_ms", "rtf", "rtf_min", "rtf_max", "skipped", "sim_time_s")


def main(argv: list[str] | None = None) -> int:
    arguments = sys.argv[1:] if argv is None else argv
    if len(arguments) != 1 or not Path(arguments[0]).is_dir():
        print("report: expected one argument: the path of a run folder", file=sys.stderr)
        return 2
    print(report(Path(arguments[0])))
    return 0


def report(run: Path) -> str:
    """Write plots/, summary.json and summary.txt into the run folder. Return the text of summary.txt."""
    missing: list[str] = []
    plan, outcome = _json(run / "plan.json", missing), _json(run / "outcome.json", missing)
    names = [v["name"] for v in plan.get("vehicles", ())] or sorted(
        p.stem for p in (run / "csv").glob("*.csv")
    )
    flights = {}
    for name in names:
        flight = read_flight(run / "csv" / f"{name}.csv")
        if flight is None:
            missing.append(f"csv/{name}.csv: no complete row")
        else:
            flights[name] = flight
    pictures = _plots(run, list(flights.values()), plan, missing)
    summary = {**summarise(names, flights, outcome, missing, pictures), "px4": _px4(run, plan, outcome)}
    text = as_text(summary)
    (run / "summary.json").write_text(json.dumps(summary, indent=1))
    (run / "summary.txt").write_text(text + "\n")
    return text


def summarise(
    names: list[str],
    flights: Mapping[str, Flight],
    outcome: Mapping[str, Any],
    missing: list[str],
    pictures: list[str],
) -> dict[str, Any]:
    """Return the summary of a run as one JSON-ready object.

    names: names of the vehicles.  flights: vehicle -> log.  outcome: content of outcome.json, {} if missing.
    missing: texts about missing files.  pictures: paths of the plots.
    """
    processes = outcome.get("processes", {})
    stats = {name: row.get("stats", {}) for name, row in processes.items()}
    judged = stats.get("world", {}).get("vehicles", {})
    began = _unix_s(outcome.get("start"))
    vehicles = {}
    for name in names:
        found: dict[str, Any] = analyse(flights[name]) if name in flights else {}
        airborne = stats.get(f"logger.{name}", {}).get("airborne_unix_s")
        found["airborne_after_s"] = round(airborne - began, 2) if airborne and began else None
        found["verdict"] = judged.get(name)
        found["crashed"] = (
            judged[name].get("crashed", "") if judged.get(name) else None
        )  # only the simulated world reports crashes
        found["rates"] = _rates(name, stats)
        vehicles[name] = found
    return {
        **{key: outcome.get(key) for key in _OUTCOME},
        "world": {key: stats.get("world", {}).get(key) for key in _WORLD},
        "first_airborne_s": min(
            (v["airborne_after_s"] for v in vehicles.values() if v["airborne_after_s"]), default=None
        ),
        "vehicles": vehicles,
        "processes": {name: _process(row) for name, row in processes.items()},
        "missing": missing,
        "plots": pictures,
    }


def _rates(name: str, stats: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the rates of messages and poses [Hz] that the logger and the pose forwarder of one vehicle have
    reported.

    name: name of the vehicle.  stats: process -> its measurements.
    """
    found = {room: stats.get(f"{room}.{name}", {}) for room in ("logger", "forward")}
    return {
        f"{room}.{key}": value
        for room, own in found.items()
        for key, value in own.items()
        if key.endswith("_hz")
    }


def _process(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: row.get(key) for key in _PROCESS}


def _px4(run: Path, plan: Mapping[str, Any], outcome: Mapping[str, Any]) -> dict[str, Any]:
    """Return vehicle -> data of its PX4: version, how PX4 ended if it ended by itself, and paths of the ULog files."""
    found = {}
    for name, given in plan.get("slices", {}).items():
        if not name.startswith("px4."):
            continue
        stats = outcome.get("processes", {}).get(name.removesuffix(".json"), {}).get("stats") or {}
        logs = sorted(Path(run, "px4", given["vehicle"]).glob("log/**/*.ulg"))
        found[given["vehicle"]] = {
            "version": given.get("version", ""),
            "stand_in": given.get("stand_in", False),
            "ended": stats.get("ended", ""),
            "ulogs": [str(log.relative_to(run)) for log in logs],
        }
    return found


def _plots(run: Path, flights: list[Flight], plan: Mapping[str, Any], missing: list[str]) -> list[str]:
    if not flights:
        return []
    from arena.recorder.plots import (
        plot_all,
        plot_vehicle,
    )  # imported only here, because importing matplotlib is slow

    folder = run / "plots"
    folder.mkdir(exist_ok=True)
    made: list[Path] = []
    try:
        made = [plot_all(flights, _size_m(plan), folder)]
        for k, flight in enumerate(flights, start=1):
            print(f"writing the plots of {flight.name} ({k} of {len(flights)} vehicles)", flush=True)
            made += plot_vehicle(flight, folder)
    except (ValueError, OSError) as error:
        missing.append(f"plots: {error}")
    return [str(path.relative_to(run)) for path in made]


def _size_m(plan: Mapping[str, Any]) -> Any:
    """Return the size of the flight room (north, east, height) [m]; None if the plan does not contain it.

    The size is in the configuration of the process `world`. An arena without a simulated world has the size in the
    configurations of the processes `link.<vehicle>`.
    """
    slices = {name.removesuffix(".json"): given for name, given in plan.get("slices", {}).items()}
    links = [given.get("preflight") or {} for name, given in slices.items() if name.startswith("link.")]
    return next(
        (size for given in (slices.get("world") or {}, *links) if (size := given.get("size_m"))), None
    )


def _json(path: Path, missing: list[str]) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        missing.append(f"{path.name}: {error.strerror if isinstance(error, OSError) else error}")
        return {}
    return found if isinstance(found, dict) else {}


def _unix_s(text: Any) -> float:
    try:
        return datetime.fromisoformat(text).timestamp()
    except (TypeError, ValueError):
        return math.nan


if __name__ == "__main__":
    sys.exit(main())
