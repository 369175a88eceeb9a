"""Flight of a campaign: starts an arena, flies, measures, and returns the record of the result."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arena.campaign.design import Flight
from arena.campaign.measures import of_flight, of_vehicle, recorded_by_world
from arena.campaign.store import Record
from arena.errors import EXIT_OK, ArenaError, RunError
from arena.flight_log.flight import read_flight
from arena.schema import load_arena
from arena.smoke.flying.fly_scenario import FlightOptions, alone_if_px4
from arena.smoke.flying.fly_scenario import fly as fly_scenario
from arena.smoke.flying.session import LaunchOptions, Session
from arena.smoke.language.model import named_processes
from arena.smoke.language.scenario import load_scenarios
from arena.smoke.report import reasons

END_TIMEOUT_S = 180.0
"""Wall time in which an arena must end after `wall_limit_s`, landing included [s]."""


@dataclass(frozen=True, kw_only=True)
class _Flown:
    """End of the arena of a flight.

    run: path of the run folder; "" if there is none.  failed: reasons of a failure.
    lost: the flight has no result, because the computer failed, and not the vehicles.
    """

    run: str
    failed: Sequence[str]
    lost: bool = False


def fly(flight: Flight, folder: Path) -> Record:
    """Fly one flight of a campaign, wait until its arena has ended, and return the record of the result.

    folder: folder of the campaign. The run folder is created in `flights/ID` below it.
    """
    began = time.monotonic()
    own = folder / "flights" / flight.id
    own.mkdir(parents=True, exist_ok=True)
    try:
        flown = _fly_arena(flight, own) if flight.kind == "arena" else _fly_scenario(flight, own)
    except ArenaError as error:  # nothing was flown
        flown = _Flown(run="", failed=[str(error)], lost=True)
    vehicles = measured(Path(flown.run)) if flown.run and not flown.lost else {}
    return Record(
        id=flight.id,
        number=flight.number,
        seed=flight.seed,
        settings=dict(flight.settings),
        passed=not flown.failed,
        lost=flown.lost,
        reasons=tuple(flown.failed),
        run=os.path.relpath(flown.run, folder) if flown.run else "",
        wall_s=round(time.monotonic() - began, 2),
        measures=of_flight(vehicles),
        vehicles=vehicles,
    )


def _fly_arena(flight: Flight, folder: Path) -> _Flown:
    """Run the arena of one flight until its user programs have ended."""
    session = Session(
        LaunchOptions(
            arena=Path(flight.file),
            runs=folder,
            overrides=flight.overrides,
            seed=flight.seed,
            arguments=("--until-done", "--time-limit", f"{flight.wall_limit_s:g}"),
        )
    )
    try:
        with alone_if_px4(load_arena(flight.file, flight.overrides)):
            code = session.run_to_end(flight.wall_limit_s + END_TIMEOUT_S)
    except RunError as error:
        return _Flown(run=str(session.run or ""), failed=[str(error)], lost=session.run is None)
    outcome = session.outcome()
    failed = [str(text) for text in outcome.get("failed") or ()]
    if code != EXIT_OK and not failed:
        why = outcome.get("reason") or ("it was killed" if code < 0 else "no reason was recorded")
        failed = [f"`arena up` ended with exit code {code}: {why}"]
    late, incomplete = late_px4s(outcome), missing_files(session.run, outcome, logs=not failed)
    lost = bool(late or incomplete)
    return _Flown(run=str(session.run or ""), failed=[*late, *failed, *incomplete], lost=lost)


def _fly_scenario(flight: Flight, folder: Path) -> _Flown:
    """Fly the scenario of one flight of a campaign.

    Each reason of a failure names the line of the scenario file. It is a failure of the computer, not of the vehicles, if the record
    ends early, or if a PX4 is late that the scenario does not touch.
    """
    (scenario,) = load_scenarios(flight.file, flight.overrides)
    result = fly_scenario(scenario, FlightOptions(results=folder, seed=flight.seed, report=False))
    outcome = _outcome(Path(result.run)) if result.run else {}
    touched = named_processes(scenario.steps, scenario.always)
    late = [] if any(name.startswith("px4.") for name in touched) else late_px4s(outcome)
    incomplete = record_problems(outcome)
    return _Flown(
        run=result.run,
        failed=[*late, *reasons(result), *incomplete],
        lost=bool(late or incomplete) or not result.run,
    )


def missing_files(run: Path | None, outcome: Mapping[str, Any], *, logs: bool) -> list[str]:
    """Return which results of a run are missing or not complete, for example because the disk was full.

    outcome: content of outcome.json; empty if it is missing.  logs: the logs of all vehicles are required, too.
    """
    if run is None:
        return ["the run has no folder"]
    if not outcome:
        return ["outcome.json is missing, so the result of the flight is not known"]
    names = [v["name"] for v in json.loads((run / "plan.json").read_text())["vehicles"]]
    missing = [f"csv/{name}.csv" for name in names if logs and not (run / "csv" / f"{name}.csv").is_file()]
    return record_problems(outcome) + ([f"{', '.join(missing)} missing: no measures"] if missing else [])


def late_px4s(outcome: Mapping[str, Any]) -> list[str]:
    """Return the armed PX4s that did not reply in time, so that the vehicle fell although nobody injected a fault."""
    world = (outcome.get("processes") or {}).get("world") or {}
    stats = (world.get("stats") or {}).get("autopilot") or {}
    late = {name: one["late"] for name, one in stats.items() if one.get("late")}
    return [
        f"{name}: its PX4 was late {times} times: the computer was overloaded" for name, times in late.items()
    ]


def record_problems(outcome: Mapping[str, Any]) -> list[str]:
    """Return the reasons why the record of a flight is not complete, from the recorder's statistics. Return [] if it is complete."""
    rows = outcome.get("processes") or {}
    found = [(row.get("stats") or {}).get("record", "complete") for row in rows.values() if row]
    return [f"the record of the flight is not complete: {why}" for why in found if why != "complete"]


def measured(run: Path) -> dict[str, dict[str, float | None]]:
    """Return vehicle -> measures of its flight, such as the tracking error, from the files of a run folder.

    The measures are listed in `MEASURES`.
    """
    recorded = recorded_by_world(_outcome(run))
    names = sorted({path.stem for path in (run / "csv").glob("*.csv")} | set(recorded))
    return {
        name: of_vehicle(read_flight(run / "csv" / f"{name}.csv"), recorded.get(name, {})) for name in names
    }


def _outcome(run: Path) -> Mapping[str, Any]:
    try:
        found = json.loads((run / "outcome.json").read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
