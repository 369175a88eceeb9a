"""Runs whose supervisor is gone or stopped: land what may fly, then end what is left, by recorded identity and never by name."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from arena.errors import RunError
from arena.plan.model import Plan
from arena.supervisor import run_folder
from arena.supervisor.event_log import Say
from arena.supervisor.landing_task import TIMEOUT_S
from arena.supervisor.run_folder import RunFolder, RunState

_GRACE_S = 5.0


def sweep_all(say: Say, address: str) -> None:
    """Every stale run on this address; those on others stand in nobody's way and end by themselves.

    Raises RunError when one cannot be swept without risk to a real vehicle.
    """
    for state in run_folder.active_runs():
        if not state.live and state.address == address:
            sweep(state, say)


def sweep(state: RunState, say: Say, *, now: bool = False) -> None:
    """One stale run: land, end, remove its runtime folder. say: told what is found and done.  now: land real vehicles alone.

    A supervisor that is stopped would wake up to a run that is none: it is killed, once the landing is over.
    """
    plan = run_folder.plan_of(state)
    if left := state.survivors():
        if not state.stopped:
            say(f"the supervisor of {state.run} has died; still running: {', '.join(left)}")
        landed = _land(state, plan, left, say, now=now)
        if not landed and (any(not v.simulated for v in plan.vehicles) if plan is not None else not now):
            unread = "" if plan is not None else "its plan cannot be read, so it may serve real vehicles: "
            raise RunError(
                f"{state.run}: {unread}a real vehicle is not confirmed on the ground, so what serves it goes on running. "
                f"Land it by hand, or try `arena land-all`, then `arena down --run {state.run}` again"
            )
    _end_supervisor(state)
    if left:
        _end(state, plan, say)
    _forget(state)


def _land(state: RunState, plan: Plan | None, left: Iterable[str], say: Say, *, now: bool) -> bool:
    """Run the land task if anything may be in the air. True when it is confirmed, or nothing can be."""
    real = [v.name for v in plan.vehicles if not v.simulated] if plan is not None else []
    if not _may_fly(plan, set(left)) or (now and plan is not None and not real):
        return True
    folder = RunFolder(path=Path(state.run), rt=Path(state.rt))
    argv, cwd = [sys.executable, "-m", "arena.emergency.land_all", "--run", state.run], state.run
    env = dict(os.environ)
    if plan is not None and plan.land is not None:
        spec = folder.spec(plan.land)
        argv, cwd, env = list(spec.argv), spec.cwd, {**env, **dict(spec.env)}
    if now and real:
        argv += ["--only", ",".join(real)]
        say(f"{', '.join(real)} may be flying, and a real vehicle is always landed")
    say(f"landing first: {' '.join(argv)}")
    try:
        return (
            subprocess.run(
                argv, cwd=cwd, env=env, timeout=TIMEOUT_S, check=False, stdin=subprocess.DEVNULL
            ).returncode
            == 0
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        say(f"the landing did not work: {error}")
        return False


def _may_fly(plan: Plan | None, left: set[str]) -> bool:
    """A simulated vehicle flies as long as its world runs; of a real one nothing is known."""
    if plan is None:
        return True
    world = any(spec.kind == "world" and spec.name in left for spec in plan.processes)
    return any(world or not vehicle.simulated for vehicle in plan.vehicles)


def _end_supervisor(state: RunState) -> None:
    """Programs and tools go with it."""
    deadline = time.monotonic() + _GRACE_S
    while state.live and time.monotonic() < deadline:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(state.supervisor.pid, signal.SIGKILL)
        time.sleep(0.02)


def _end(state: RunState, plan: Plan | None, say: Say) -> None:
    """Programs and tools first, then the rest; those that do not end are killed."""
    specs = plan.processes if plan is not None else ()
    late = {spec.name for spec in specs if spec.outlives}
    grace_s = max((spec.stop_timeout_s for spec in specs), default=_GRACE_S)
    for names in (set(state.processes) - late, late):
        _signal(state, names, signal.SIGTERM)
        if left := _wait(state, names, grace_s):
            say(f"did not end: {', '.join(left)}; killing")
            _signal(state, names, signal.SIGKILL)
            _wait(state, names, _GRACE_S)


def _signal(state: RunState, names: set[str], number: int) -> None:
    """To every survivor whose identity holds at this moment."""
    for name, pids in state.survivors().items():
        for pid in pids if name in names else []:
            try:
                os.kill(pid, number)
            except (ProcessLookupError, PermissionError):
                continue


def _wait(state: RunState, names: set[str], limit_s: float) -> list[str]:
    """Wait so long for these to end; returns those that did not."""
    deadline = time.monotonic() + limit_s
    while (left := sorted(names & set(state.survivors()))) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def _forget(state: RunState) -> None:
    (Path(state.run) / "state.json").unlink(missing_ok=True)
    if Path(state.rt, "run").is_file():
        shutil.rmtree(state.rt, ignore_errors=True)
