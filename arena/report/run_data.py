"""Reads all data that a report shows from one run folder: plan, outcome, events, and logs of the vehicles.

Missing and broken files are named in `RunData.missing`. They do not stop the report, because runs can be killed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from arena.errors import InputError
from arena.flight_log.flight import Flight, read_flight
from arena.flight_log.recording import Recording
from arena.flight_log.run_folder import CSV_FOLDER, flights_of_run, has_record
from arena.geometry import Array
from arena.report.link_reader import read_links
from arena.report.link_record import LinkRecord
from arena.report.vision_times import vision_times
from arena.wire.flight_record import FILE_NAME

Clock = Literal["simulation", "unix"]

EVENTS_FILE = "events.jsonl"
"""File of the run folder with the events of all processes."""
LOADS_FILE = "processes.csv"
"""File of the run folder in which the supervisor writes CPU load and memory of the processes."""
SCENARIO_FILE = "scenario.json"
"""File of the run folder in which a smoke flight writes its result."""
INCOMPLETE = f"{FILE_NAME} is incomplete: "
"""Start of each text in `RunData.missing` about an incomplete record of the flight."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """Line of the event file events.jsonl.

    at_s: time of the report's time axis [s], NaN if unknown (see `RunData.origin_s`).
    process: name of the process that sent the event, or whose state changed.  text: text of the event, "" if there is none.
    before, after: states of the process; "" if the line is not a change of state.  reason: reason of the change.
    audit: request to a vehicle (vehicle, role, request, refused), {} if there is none.
    unix_s: time of the computer at which the line was written [s], NaN if unknown.
    """

    at_s: float
    process: str
    text: str = ""
    before: str = ""
    after: str = ""
    reason: str = ""
    audit: Mapping[str, Any] = field(default_factory=dict)
    unix_s: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Load:
    """CPU load and memory of one process over time, from processes.csv.

    t: time on the report's time axis [s] (n,).  cpu: CPU use as a fraction of one core [-] (n,).  rss_mb: resident memory [MB] (n,).
    """

    t: Array
    cpu: Array
    rss_mb: Array


@dataclass(frozen=True, kw_only=True)
class RunData:
    """Content of one run folder: plan, outcome, events and logs.

    folder: the run folder.  names: names of all vehicles of the plan.  flights: vehicle -> log, vehicles with a log only.
    plan, outcome: content of plan.json and outcome.json, {} if missing.
    clock: clock of the logs.  origin_s: time of the logs that is 0 on the report's time axis [s]: 0 with the simulation clock,
        the start of the run as Unix time with the Unix clock.
    events: lines of events.jsonl.  links: vehicle -> messages and poses over time.
    scenario: result of the smoke flight, {} if the run was not a smoke flight.  missing: texts about missing and broken files.
    loads: process -> CPU load and memory over time.
    """

    folder: Path
    names: tuple[str, ...]
    flights: Mapping[str, Flight]
    plan: Mapping[str, Any]
    outcome: Mapping[str, Any]
    clock: Clock
    origin_s: float
    events: Sequence[Event]
    links: Mapping[str, LinkRecord]
    scenario: Mapping[str, Any]
    missing: list[str]
    loads: Mapping[str, Load] = field(default_factory=dict)

    def vehicle(self, name: str) -> Mapping[str, Any]:
        """Return a vehicle's entry in the plan, or {} if the vehicle is unknown."""
        return next((v for v in self.plan.get("vehicles", ()) if v.get("name") == name), {})

    def params(self, name: str) -> Mapping[str, Any]:
        """Return the autopilot parameters that the configuration sets for a vehicle.

        Returns {} if the plan does not contain them.
        """
        for given in self.plan.get("slices", {}).values():
            listed = given.get("vehicles") or ()
            own = [v for v in listed if isinstance(v, dict) and v.get("name") == name]
            own += [given] if given.get("vehicle") == name else []
            found = next((v["params"] for v in own if isinstance(v.get("params"), dict)), None)
            if found:
                return dict(found)
        return {}

    def is_real(self, name: str) -> bool:
        """Return whether a vehicle has a real flight controller."""
        return not self.vehicle(name).get("simulated", True)

    def stats(self, process: str) -> Mapping[str, Any]:
        """Return the last statistics that a process has sent to the supervisor, or {} if there are none."""
        return (self.outcome.get("processes", {}).get(process) or {}).get("stats") or {}

    @property
    def replay_of(self) -> str:
        """Path of the record that was replayed in this run; "" for a flight."""
        return str(self.plan.get("replay") or "")

    @property
    def size_m(self) -> Sequence[float] | None:
        """Size of the room: north, east, height [m]. None if the plan does not contain it."""
        size: Sequence[float] | None = room_size(self.plan)
        return size

    @property
    def drawn(self) -> Mapping[str, Any]:
        """Configuration of the viewers (`view.json`), with geofence and obstacles; {} if it is missing.

        These are the keys `fence` and `obstacles` in the slice of viewers.
        """
        return self.plan.get("slices", {}).get("view.json") or {}


def read_run(folder: Path) -> RunData:
    """Read the content of a run folder.

    `RunData.missing` names missing and broken files.
    """
    missing: list[str] = []
    plan, outcome = read_json(folder / "plan.json", missing), read_json(folder / "outcome.json", missing)
    names = [v["name"] for v in plan.get("vehicles", ())] or sorted(
        p.stem for p in (folder / "csv").glob("*.csv")
    )
    recording = _recording(folder, missing)
    flights = _computed(folder, recording, missing) or _read(folder, names, missing)
    missing += [f"no log of {name}: it has no complete row" for name in names if name not in flights]
    clock, origin_s = run_clock(plan, outcome, list(flights.values()))
    events = read_events(folder / EVENTS_FILE, clock, origin_s, missing)
    if plan.get("replay"):
        events = _events_of_replay(events, recording, clock, origin_s)
    scenario = read_json(folder / SCENARIO_FILE, missing) if (folder / SCENARIO_FILE).exists() else {}
    links = {} if recording is None else _links(recording, folder, clock, origin_s, missing)
    missing += _losses(outcome, recording)  # the links have read the whole record
    return RunData(
        folder=folder,
        names=tuple(names),
        flights=flights,
        plan=plan,
        outcome=outcome,
        clock=clock,
        origin_s=origin_s,
        events=events,
        links=links,
        scenario=scenario,
        missing=missing,
        loads=read_loads(folder / LOADS_FILE),
    )


def read_loads(path: Path) -> dict[str, Load]:
    """Return process -> CPU load and memory over time. Return {} if the run has no processes.csv."""
    rows: dict[str, list[tuple[float, float, float]]] = {}
    try:
        lines = path.read_text(errors="replace").splitlines()[1:]
    except OSError:
        return {}
    for line in lines:
        try:
            time_s, name, cpu, rss_mb = line.split(",")
            rows.setdefault(name, []).append((float(time_s), float(cpu), float(rss_mb)))
        except ValueError:  # the last line of a killed supervisor
            continue
    columns = {name: np.array(found).T for name, found in rows.items()}
    return {name: Load(t=t, cpu=cpu, rss_mb=rss_mb) for name, (t, cpu, rss_mb) in columns.items()}


def _recording(folder: Path, missing: list[str]) -> Recording | None:
    """Return the record flight.mcap of the run, or None if it is missing or unreadable."""
    if not has_record(folder):
        return None
    try:
        return Recording(folder / FILE_NAME)
    except (InputError, OSError) as error:
        missing.append(f"{FILE_NAME}: {error}")
        return None


def _losses(outcome: Mapping[str, Any], recording: Recording | None) -> Iterator[str]:
    """Yield a text about each loss of data in the record of a flight.

    recording: the record, read completely; None if it cannot be read.
    """
    stats = (outcome.get("processes", {}).get("recorder") or {}).get("stats") or {}
    if (cause := stats.get("record", "complete")) != "complete":
        yield f"{INCOMPLETE}the recorder stopped during the run: {cause}"
    if lost := stats.get("lost_datagrams"):
        yield f"{INCOMPLETE}the recorder was late and lost {lost} datagrams"
    if recording is not None and (damaged := recording.damaged_chunks):
        yield damage_text(damaged)


def damage_text(chunks: int) -> str:
    """Return the text about damaged parts (chunks) in the record of a flight."""
    return f"{INCOMPLETE}{chunks} damaged {'part was' if chunks == 1 else 'parts were'} skipped"


def _computed(folder: Path, recording: Recording | None, missing: list[str]) -> dict[str, Flight]:
    """Return vehicle -> log, computed from the record flight.mcap. Return {} if this is not possible."""
    try:
        return {} if recording is None else {flight.name: flight for flight in flights_of_run(folder)}
    except (InputError, OSError) as error:
        missing.append(f"{FILE_NAME}: {error}")
        return {}


def _read(folder: Path, names: Sequence[str], missing: list[str]) -> dict[str, Flight]:
    """Return vehicle -> log, read from `csv/<vehicle>.csv`. Vehicles without such a file are left out."""
    found = {name: read_flight(folder / CSV_FOLDER / f"{name}.csv") for name in names}
    return {name: flight for name, flight in found.items() if flight is not None}


def _events_of_replay(
    own: Sequence[Event], recording: Recording | None, clock: Clock, origin_s: float
) -> list[Event]:
    """Return the events of the recorded flight and the events of its replay, such as refused commands."""
    recorded = () if recording is None else recording.events()
    found = [_event(line.fields, clock, origin_s) for line in recorded]
    found += [e for e in own if e.process == "replay" and e.text and not e.text.startswith("recorded: ")]
    return sorted(found, key=lambda e: math.inf if math.isnan(e.at_s) else e.at_s)


def _links(
    recording: Recording, folder: Path, clock: Clock, origin_s: float, missing: list[str]
) -> dict[str, LinkRecord]:
    try:
        links = read_links(recording, origin_s)
        if clock != "simulation":
            return links
        return {name: replace(link, vision_s=vision_times(folder, name)) for name, link in links.items()}
    except (InputError, OSError) as error:
        missing.append(f"{FILE_NAME}: {error}")
        return {}


def room_size(plan: Mapping[str, Any]) -> Any:
    """Return the size of the room (north, east, height) [m], or None if the plan does not contain it.

    The size is in the configuration of the recorder; in older runs in that of the world, or of the processes `link.<vehicle>`.
    """
    slices = {name.removesuffix(".json"): given for name, given in plan.get("slices", {}).items()}
    links = [given.get("preflight") or {} for name, given in slices.items() if name.startswith("link.")]
    worlds = [given for name, given in slices.items() if name in ("recorder", "world")]
    return next((size for given in (*worlds, *links) if (size := given.get("size_m"))), None)


def run_clock(
    plan: Mapping[str, Any], outcome: Mapping[str, Any], flights: Sequence[Flight]
) -> tuple[Clock, float]:
    """Return the clock of a run's logs, and the time on this clock at which the report's time axis starts [s]."""
    real = any(not v.get("simulated", True) for v in plan.get("vehicles", ()))
    real = real or any(flight.t0 > 1e9 for flight in flights)  # without a plan: Unix times are large
    if not real:
        return "simulation", 0.0
    first = min((flight.t0 for flight in flights), default=math.nan)
    began = math.nan if plan.get("replay") else unix_s(outcome.get("start"))
    return "unix", began if math.isfinite(began) and not first - began > 3600.0 else first


def read_events(path: Path, clock: Clock, origin_s: float, missing: list[str]) -> list[Event]:
    """Return all valid lines of events.jsonl. Invalid lines are left out.

    clock, origin_s: see `RunData`.
    """
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError as error:
        missing.append(f"{path.name}: {error.strerror}")
        return []
    found = []
    for line in lines:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if isinstance(entry, dict):
            found.append(_event(entry, clock, origin_s))
    return found


def _event(entry: Mapping[str, Any], clock: Clock, origin_s: float) -> Event:
    given = entry.get("time_s") if clock == "simulation" else unix_s(entry.get("t"))
    audit = entry.get("audit")
    return Event(
        at_s=float(given) - origin_s if isinstance(given, int | float) else math.nan,
        process=str(entry.get("process", "")),
        text=str(entry.get("event", "")),
        before=str(entry.get("from", "")),
        after=str(entry.get("to", "")),
        reason=str(entry.get("reason", "")),
        audit=audit if isinstance(audit, dict) else {},
        unix_s=unix_s(entry.get("t")),
    )


def read_json(path: Path, missing: list[str]) -> dict[str, Any]:
    """Read the object in a JSON file. On failure, return {} and add the reason to `missing`."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        missing.append(f"{path.name}: {error.strerror if isinstance(error, OSError) else error}")
        return {}
    return found if isinstance(found, dict) else {}


def unix_s(text: Any) -> float:
    """Convert an ISO 8601 time to Unix time [s]. An invalid time gives NaN."""
    try:
        return datetime.fromisoformat(text).timestamp()
    except (TypeError, ValueError):
        return math.nan
