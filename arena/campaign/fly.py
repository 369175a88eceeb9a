"""Flight of a campaign: starts an arena, flies, measures, and returns the record of the result."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from arena.campaign.design import Flight
from arena.campaign.measures import of_flight, of_vehicle, recorded_by_world
from arena.campaign.store import Record
from arena.errors import EXIT_OK, ArenaError
from arena.flight_log.flight import read_flight
from arena.schema import load_arena
from arena.smoke.flying.fly_scenario import FlightOptions, alone_if_px4
from arena.smoke.flying.fly_scenario import fly as fly_scenario
from arena.smoke.flying.session import LaunchOptions, Session
from arena.smoke.language.scenario import load_scenarios
from arena.smoke.report import reasons

END_TIMEOUT_S = 180.0
"""Wall time in which an arena must end after `wall_limit_s`, landing included [s]."""


def fly(flight: Flight, folder: Path) -> Record:
    """Fly one flight of a campaign, wait until its arena has ended, and return the record of the result.

    folder: folder of the campaign. The run folder is created in `flights/ID` below it.
    """
    began = time.monotonic()
    own = folder / "flights" / flight.id
    own.mkdir(parents=True, exist_ok=True)
    record = Record(
        id=flight.id, number=flight.number, seed=flight.seed, settings=dict(flight.settings), passed=False
    )
    try:
        run, failed = _fly_arena(flight, own) if flight.kind == "arena" else _fly_scenario(flight, own)
    except ArenaError as error:
        run, failed = "", [str(error)]
    vehicles = measured(Path(run)) if run else {}
    return replace(
        record,
        passed=not failed,
        reasons=tuple(failed),
        run=os.path.relpath(run, folder) if run else "",
        wall_s=round(time.monotonic() - began, 2),
        measures=of_flight(vehicles),
        vehicles=vehicles,
    )


def _fly_arena(flight: Flight, folder: Path) -> tuple[str, list[str]]:
    """Run the arena of one flight until its user programs have ended.

    Return the path of the run folder, and the reasons of a failure.
    """
    session = Session(
        LaunchOptions(
            arena=Path(flight.file),
            runs=folder,
            overrides=flight.overrides,
            seed=flight.seed,
            arguments=("--until-done", "--time-limit", f"{flight.wall_limit_s:g}"),
        )
    )
    with alone_if_px4(load_arena(flight.file, flight.overrides)):
        code = session.run_to_end(flight.wall_limit_s + END_TIMEOUT_S)
    outcome = session.outcome()
    failed = [str(text) for text in outcome.get("failed") or ()]
    if code != EXIT_OK and not failed:
        failed = [
            f"`arena up` ended with exit code {code}: {outcome.get('reason') or 'no reason was recorded'}"
        ]
    return str(session.run or ""), failed


def _fly_scenario(flight: Flight, folder: Path) -> tuple[str, list[str]]:
    """Fly the scenario of one flight of a campaign.

    Return the path of the run folder, and the reasons of a failure, each with file and line.
    """
    (scenario,) = load_scenarios(flight.file, flight.overrides)
    result = fly_scenario(scenario, FlightOptions(results=folder, seed=flight.seed, report=False))
    return result.run, reasons(result)


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
