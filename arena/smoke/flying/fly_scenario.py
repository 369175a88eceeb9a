"""One scenario flown and judged: the referee's decisions, carried out in a session."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from arena.errors import ArenaError, InputError, RunError
from arena.schema import Arena
from arena.smoke.flying.session import Session, Start
from arena.smoke.language.scenario import Scenario
from arena.smoke.referee.referee import Referee
from arena.smoke.referee.verdict import Result
from arena.smoke.report import draw

_WALL_S, _WALL_PER_S = (
    60.0,
    10.0,
)  # wall time that a flight may take, and more for each second of its time limit
_REPORT_S = 120.0


@dataclass(frozen=True, kw_only=True)
class How:
    """results: where run folders go, one folder a scenario. speed: as `arena up --speed`. seed: None: as the YAMLs say."""

    results: Path
    speed: str = "max"
    seed: int | None = None


def fly(scenario: Scenario, how: How) -> Result:
    """Nothing of the arena runs when this returns or raises; its run folder stays."""
    began, referee = time.monotonic(), Referee(scenario)
    folder = how.results / slug(scenario.name)
    folder.mkdir(parents=True, exist_ok=True)
    session = Session(start_of(scenario, folder, how))
    trouble = ""
    try:
        with alone_if_px4(scenario.arena), session:
            trouble = _referee(referee, session, began + _WALL_S + _WALL_PER_S * scenario.time_limit_s)
    except RunError as error:
        trouble = str(error)
    referee.finish(session.outcome(), trouble)
    result = Result(
        scenario=scenario.name,
        file=scenario.place.file,
        seed=scenario.arena.world.seed if how.seed is None else how.seed,
        verdict=referee.verdict(),
        run=str(session.run or ""),
        facts=_facts(scenario.arena),
    )
    if not result.verdict.passed and session.run is not None:
        _make_report(session.run)
        result = replace(result, pictures=tuple(draw(result, referee.rows, session.run)))
    return replace(result, wall_s=time.monotonic() - began)


def _referee(referee: Referee, session: Session, deadline: float) -> str:
    """Until it is over; what went wrong beside the flight, in words. deadline: wall time [s]."""
    while not referee.over:
        now = session.seat.look()
        if now is None:
            return session.seat.trouble
        for deed in referee.look(now):
            try:
                session.seat.do(deed)
            except ArenaError as error:
                referee.refused(deed, str(error))
        if time.monotonic() > deadline:
            return f"flown for too long in wall time, and had come to {now.time_s:.1f} s of simulation time"
    return ""


def refuse_real(arena: Arena) -> None:
    """Raises InputError: a real vehicle is not for spoiling."""
    if real := [v.name for v in arena.vehicles if not v.simulated]:
        raise InputError(
            f"{arena.file}: {', '.join(real)}: got a real vehicle; smoke flights fly simulated ones only"
        )


def start_of(scenario: Scenario, folder: Path, how: How) -> Start:
    """An arena that is written inside the scenario is written down first, in `folder`."""
    if scenario.arena_file:
        return Start(
            arena=Path(scenario.arena_file),
            runs=folder,
            overrides=scenario.overrides,
            speed=how.speed,
            seed=how.seed,
        )
    from arena.plan.resolved_yaml import arena_yaml

    file = folder / "arena.yaml"
    file.write_text(arena_yaml(scenario.arena))
    return Start(arena=file, runs=folder, speed=how.speed, seed=how.seed)


def slug(name: str) -> str:
    """A folder's name: `offboard loss lands [four]` -> offboard-loss-lands-four."""
    return re.sub(r"[^\w.]+", "-", name).strip("-.") or "scenario"


@contextlib.contextmanager
def alone_if_px4(arena: Arena) -> Iterator[None]:
    """A real PX4 binds its links on every address of the computer: one such arena flies at a time."""
    if not any(v.autopilot == "px4" for v in arena.vehicles):
        yield
        return
    path = Path(tempfile.gettempdir()) / f"arena-smoke-px4-{os.getuid()}.lock"
    with path.open("w") as file:
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


def _make_report(run: Path) -> None:
    """The summary and plots that `arena up` was told to leave out: only of flights that somebody will look into."""
    argv = [sys.executable, "-m", "arena.recorder.report", str(run)]
    with (
        (run / "logs" / "report.log").open("wb") as out,
        contextlib.suppress(OSError, subprocess.TimeoutExpired),
    ):
        subprocess.run(argv, stdout=out, stderr=subprocess.STDOUT, timeout=_REPORT_S, check=False)
