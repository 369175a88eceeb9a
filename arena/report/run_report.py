"""Writes the report of a run: report.html, summary.json and summary.txt.

Command: `python -m arena.report RUN`.

If a run was killed, some files are missing or incomplete. The report lists the missing files and uses the others.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.constants import REPORT_PROGRESS
from arena.errors import InputError
from arena.flight_log.csv_file import write_csv
from arena.flight_log.flight import Flight
from arena.flight_log.record_completion import complete_record, is_complete
from arena.flight_log.recording import Recording
from arena.flight_log.run_folder import (
    CSV_FOLDER,
    TLOG_FOLDER,
    has_record,
    link_px4_ulogs,
    ulogs_of,
    write_tlog_files,
)
from arena.report.analysis import analyse
from arena.report.fates import crash_of, unrecorded_flight_s
from arena.report.happenings import disarming_of, happenings
from arena.report.run_data import RunData, damage_text, read_run, unix_s
from arena.report.summary import as_text
from arena.wire.flight_record import FILE_NAME

PAGE = "report.html"
"""Name of the page in the run folder."""

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
    print(report(Path(arguments[0]), lambda step: print(f"{REPORT_PROGRESS}{step}", flush=True)))
    return 0


def report(folder: Path, progress: Callable[[str], None] = lambda _: None) -> str:
    """Write report.html, summary.json and summary.txt into the run folder. Return the text of summary.txt.

    progress: called at the begin of each step, with a text about the step for the user.
    """
    run, text = write_summary(folder, progress)
    progress(f"drawing report.html: {_vehicles(len(run.flights))}")
    write_page(run)  # last, because a page that cannot be made must not cost the summary
    return text


def write_summary(folder: Path, progress: Callable[[str], None] = lambda _: None) -> tuple[RunData, str]:
    """Write summary.json, summary.txt and the logs of the vehicles into the run folder.

    progress: see `report`.
    Returns (the data of the run, text of summary.txt).
    """
    progress("reading the record")
    broken = _complete(folder)
    run = read_run(folder)
    run.missing.extend(broken)
    _write_logs(run, progress)
    summary = {
        **summarise(
            names=run.names,
            flights=run.flights,
            outcome=run.outcome,
            missing=run.missing,
            disarmed=disarmed_vehicles(run),
            origin_s=run.origin_s,
            crashed=crashes(run),
        ),
        "px4": _px4(folder, run.plan, run.outcome),
    }
    return run, _write(folder, summary)


def _complete(folder: Path) -> list[str]:
    """Complete flight.mcap if its recorder was killed or restarted.

    Return texts about an error, and about damaged parts, which the completed file no longer contains.
    """
    path = folder / FILE_NAME
    try:
        if not has_record(folder) or is_complete(path):
            return []
        recording = Recording(path)
        for _ in recording.messages(()):
            pass
        complete_record(path)
        return [damage_text(recording.damaged_chunks)] if recording.damaged_chunks else []
    except (InputError, OSError) as error:
        return [f"{FILE_NAME}: it has no index, and cannot be completed: {error}"]


def _vehicles(count: int) -> str:
    return "1 vehicle" if count == 1 else f"{count} vehicles"


def _write_logs(run: RunData, progress: Callable[[str], None]) -> None:
    """Write `csv/<vehicle>.csv` and `tlog/<vehicle>.tlog` for each vehicle, computed from flight.mcap.

    Runs without flight.mcap get no files.
    """
    if not has_record(run.folder):
        return
    try:
        (run.folder / CSV_FOLDER).mkdir(exist_ok=True)
        for number, flight in enumerate(run.flights.values(), 1):
            progress(f"writing {CSV_FOLDER}/{flight.name}.csv ({number} of {len(run.flights)})")
            write_csv(run.folder / CSV_FOLDER / f"{flight.name}.csv", flight)
        progress(f"writing {TLOG_FOLDER}/*.tlog: {_vehicles(len(run.flights))}")
        write_tlog_files(run.folder)
    except (InputError, OSError) as error:
        run.missing.append(f"{CSV_FOLDER}, {TLOG_FOLDER}: {error}")


def _write(folder: Path, summary: Mapping[str, Any]) -> str:
    text = as_text(summary)
    (folder / "summary.json").write_text(json.dumps(summary, indent=1))
    (folder / "summary.txt").write_text(text + "\n")
    return text


def write_page(run: RunData, path: Path | None = None) -> Path:
    """Write report.html of a run and return its path.

    path: None for report.html in the run folder.
    """
    from arena.report.run_page import (
        run_page,
    )  # imported only here, because the summary does not need its libraries

    path = path or run.folder / PAGE
    path.write_text(run_page(run))
    return path


def disarmed_vehicles(run: RunData) -> list[str]:
    """Return the vehicles that were disarmed at the end of the run."""
    return [name for name in run.names if disarming_of(name, run) is not None]


def crashes(run: RunData) -> dict[str, str]:
    """Return vehicle -> crash report of each vehicle that crashed."""
    found = happenings(run)
    return {name: how for name in run.names if (how := crash_of(name, run, found))}


def summarise(
    *,
    names: Sequence[str],
    flights: Mapping[str, Flight],
    outcome: Mapping[str, Any],
    missing: list[str],
    disarmed: Collection[str] = (),
    origin_s: float | None = None,
    crashed: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return the summary of a run as a JSON-ready object.

    names: names of the vehicles.  flights: vehicle -> log.  outcome: content of outcome.json, {} if missing.
    missing: texts about missing files.  disarmed: vehicles whose disarming was reported after the last row of the log.
    origin_s: time of the logs that is 0 in the summary [s] (see `RunData`); None: the first row of each log.
    crashed: vehicle -> crash report from the events; None: only the crashes in outcome.json.
    """
    processes = outcome.get("processes", {})
    stats = {name: row.get("stats", {}) for name, row in processes.items()}
    judged = stats.get("world", {}).get("vehicles", {})
    began = unix_s(outcome.get("start"))
    vehicles = {}
    for name in names:
        found: dict[str, Any] = (
            analyse(
                flights[name],
                disarmed=True if name in disarmed else None,
                first_row_s=0.0 if origin_s is None else flights[name].t0 - origin_s,
            )
            if name in flights
            else {}
        )
        airborne = _recorded(name, stats).get("airborne_unix_s")
        found["airborne_after_s"] = round(airborne - began, 2) if airborne and began else None
        found["verdict"] = judged.get(name)
        # only the simulated world reports crashes, and without outcome.json only in the events
        found["crashed"] = (crashed or {}).get(name) or (judged.get(name) or {}).get("crashed")
        found["log_ends_early"] = name in flights and bool(
            unrecorded_flight_s(flights[name], judged.get(name) or {}, missing)
        )
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
    }


def _rates(name: str, stats: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return a vehicle's message and pose rates [Hz] from the statistics of the recorder and the pose forwarder.

    name: name of the vehicle.  stats: process -> its measurements.
    """
    found = {"recorder": _recorded(name, stats), "forward": stats.get(f"forward.{name}", {})}
    return {
        f"{room}.{key}": value
        for room, own in found.items()
        for key, value in own.items()
        if key.endswith("_hz")
    }


def _recorded(name: str, stats: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return what the recorder measured about one vehicle, such as its message rates [Hz].

    In older runs, the process `logger.<vehicle>` has reported these values.
    """
    found: Mapping[str, Any] = stats.get("recorder", {}).get("vehicles", {}).get(name, {})
    return found or stats.get(f"logger.{name}", {})


def _process(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: row.get(key) for key in _PROCESS}


def _px4(run: Path, plan: Mapping[str, Any], outcome: Mapping[str, Any]) -> dict[str, Any]:
    """Return vehicle -> data about its PX4: version, unexpected exit, and paths of the ULog files."""
    found = {}
    for name, given in plan.get("slices", {}).items():
        if not name.startswith("px4."):
            continue
        stats = outcome.get("processes", {}).get(name.removesuffix(".json"), {}).get("stats") or {}
        logs = _px4_ulogs(run, given["vehicle"])
        found[given["vehicle"]] = {
            "version": given.get("version", ""),
            "stand_in": given.get("stand_in", False),
            "ended": stats.get("ended", ""),
            "ulogs": [str(log.relative_to(run)) for log in logs],
        }
    return found


def _px4_ulogs(run: Path, vehicle: str) -> list[Path]:
    """Return the ULog files of a vehicle's PX4.

    They are linked into the folder `ulog` if this folder can be written.
    """
    try:
        return link_px4_ulogs(run, vehicle)
    except OSError:  # the disk is full
        return ulogs_of(run, vehicle)
