"""Flies one scenario: starts the arena, carries out the actions, and returns the referee's result.

The referee (`arena.smoke.referee`) receives observations of the flight. It returns the actions to carry out, and
finally the verdict.
"""

from __future__ import annotations

import contextlib
import fcntl
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from arena.errors import ArenaError, InputError, RunError
from arena.run_dirs import open_lock_file
from arena.schema import Arena
from arena.smoke.flying.session import LaunchOptions, Session
from arena.smoke.language.model import named_processes
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.referee import Referee
from arena.smoke.referee.verdict import Result
from arena.smoke.report import result_json

# limit of the wall time of a flight: WALL_LIMIT_S + WALL_LIMIT_PER_S * time limit of the scenario
WALL_LIMIT_S, WALL_LIMIT_PER_S = 60.0, 10.0
REPORT_TIMEOUT_S = 120.0
SCENARIO_FILE = "scenario.json"
"""File of the run folder with the result of a smoke flight. The report reads it."""


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """Options of a smoke flight: folder of the results, speed of the simulation, seed.

    results: folder in which each scenario gets a folder for its run folders.
    speed: simulated seconds per second, or "max", as `arena up --speed`.
    seed: seed of world and motion capture; None: as the YAML files say.
    report: whether a failed flight gets a summary and report.html.
    """

    results: Path
    speed: str = "max"
    seed: int | None = None
    report: bool = True


def fly(scenario: Scenario, options: FlightOptions) -> Result:
    """Fly one scenario and return its result.

    When this function returns or raises, all processes of the arena have ended. The run folder is kept.
    """
    referee = Referee(scenario)
    folder = options.results / slug(scenario.name)
    folder.mkdir(parents=True, exist_ok=True)
    launch = launch_options(scenario, folder, options)
    session = Session(launch)
    problem, began = "", time.monotonic()
    try:
        with alone_if_px4(scenario.arena):  # the wait for other flights does not count
            began = time.monotonic()
            limit_s = WALL_LIMIT_S + WALL_LIMIT_PER_S * scenario.time_limit_s
            with session:
                problem = _fly_until_over(referee, session, began + limit_s)
    except RunError as error:
        problem = str(error)
    finally:
        if not scenario.arena_file:  # the run folder has its own arena.yaml
            launch.arena.unlink(missing_ok=True)
    referee.finish(session.outcome() if session.has_outcome else None, problem)
    result = Result(
        scenario=scenario.name,
        file=scenario.place.file,
        about=scenario.about,
        seed=scenario.arena.world.seed if options.seed is None else options.seed,
        verdict=referee.verdict(),
        run=str(session.run or ""),
        facts=_facts(scenario.arena),
    )
    if session.run is not None:
        _write_result(result, session.run)
        if options.report and not result.verdict.passed:
            result = replace(result, report=_make_report(session.run))
    return replace(result, wall_s=time.monotonic() - began)


def _fly_until_over(referee: Referee, session: Session, deadline: float) -> str:
    """Observe the flight and carry out the referee's actions until the flight or the arena ends.

    deadline: latest end, monotonic wall time [s].
    Return the reason if the flight could not be completed; else "".
    """
    while not referee.over:
        now = session.observer.observe()
        if now is None:
            return session.observer.problem
        for action in referee.observe(now):
            try:
                session.observer.do(action)
            except ArenaError as error:
                referee.action_failed(action, str(error))
        if time.monotonic() > deadline:
            return f"the flight took too long in wall time: it was stopped at {now.time_s:.1f} s of simulation time"
    return ""


def refuse_real(arena: Arena) -> None:
    """Raise InputError if the arena has a real vehicle or flight controller, because scenarios inject faults."""
    if real := [v.name for v in arena.vehicles if not v.simulated or v.wire is not None]:
        raise InputError(
            f"{arena.file}: got vehicles with real flight controllers ({', '.join(real)}), expected simulated ones: scenarios inject "
            "faults"
        )


def launch_options(scenario: Scenario, folder: Path, options: FlightOptions) -> LaunchOptions:
    """Return the options with which the arena of a scenario is started.

    An arena that is written inside the scenario file is first written to a new file in `folder`. Its name is unique, because
    several scenarios can have the same folder. The caller deletes the file after the flight.
    A scenario that names a process which could be a part of the fused arena needs many processes.
    """
    from arena.plan.fused import could_be_member
    from arena.plan.resolved_yaml import arena_yaml

    separate = any(map(could_be_member, named_processes(scenario.steps, scenario.always)))
    overrides = ["sim.processes=many"] if separate else []
    if scenario.arena_file:
        file, overrides = Path(scenario.arena_file), [*scenario.overrides, *overrides]
    else:
        text = arena_yaml(scenario.arena)
        with tempfile.NamedTemporaryFile(
            "w", dir=folder, prefix="arena-", suffix=".yaml", delete=False
        ) as made:
            made.write(text)
        file = Path(made.name)
    return LaunchOptions(arena=file, runs=folder, overrides=overrides, speed=options.speed, seed=options.seed)


def slug(name: str) -> str:
    """Return a folder name for a scenario, such as `offboard-loss-lands-four`.

    This is the folder name for `offboard loss lands [four]`.
    """
    return re.sub(r"[^\w.]+", "-", name).strip("-.") or "scenario"


@contextlib.contextmanager
def alone_if_px4(arena: Arena) -> Iterator[None]:
    """Lock a file during the `with` block, so that only one arena with PX4 flies at a time.

    The reason: PX4 binds its ports on every address of the computer. Arenas without PX4 do not wait for the lock.
    """
    if not any(v.autopilot == "px4" for v in arena.vehicles):
        yield
        return
    with open_lock_file("smoke-px4") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _facts(arena: Arena) -> dict[str, str]:
    autopilots = dict.fromkeys(v.autopilot for v in arena.vehicles)
    return {
        "arena": arena.name,
        "vehicles": str(len(arena.vehicles)),
        "autopilot": ", ".join(autopilots),
        **({"px4": arena.px4.words} if arena.px4 else {}),
    }


def _write_result(result: Result, run: Path) -> None:
    """Write the result of the scenario to scenario.json in the run folder, for the report of the run."""
    with contextlib.suppress(OSError):
        (run / SCENARIO_FILE).write_text(result_json(result))


def _make_report(run: Path) -> str:
    """Write the summary and report.html of a failed flight.

    `arena up` has run with --no-report.

    Return the path of report.html, "" if it could not be made.
    """
    argv = [sys.executable, "-m", "arena.report", str(run)]
    with (
        (run / "logs" / "report.log").open("wb") as out,
        contextlib.suppress(OSError, subprocess.TimeoutExpired),
    ):
        subprocess.run(argv, stdout=out, stderr=subprocess.STDOUT, timeout=REPORT_TIMEOUT_S, check=False)
    page = run / "report.html"
    return str(page) if page.is_file() else ""
