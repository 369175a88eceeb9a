"""Cleanup of stale runs (supervisor died or paused): lands their vehicles, then ends their processes.

A run is stale if its supervisor has died or is paused (SIGSTOP).

Processes are identified by the pid and start time in state.json, never by name.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from arena.errors import RunError
from arena.plan.model import Plan
from arena.supervisor import run_folder
from arena.supervisor.landing_task import TIMEOUT_S
from arena.supervisor.run_folder import RunFolder, RunState

_GRACE_S = 5.0

Say = Callable[[str], None]
"""Function that prints one line."""


def sweep_all(say: Say, address: str) -> None:
    """End every stale run (its supervisor has died) whose processes use a given IPv4 address.

    Stale runs on other addresses are left alone, because they do not use the ports of this arena.

    say: function that prints a line.
    Raises RunError if a run cannot be cleaned up without risk to a real vehicle.
    """
    for state in run_folder.active_runs():
        if not state.live and state.address == address:
            sweep(state, say)


def sweep(state: RunState, say: Say, *, now: bool = False) -> None:
    """End one stale run (its supervisor has died or is paused): land its vehicles, end its processes.

    say: function that prints each step.  now: land real vehicles only.
    A supervisor that is paused (SIGSTOP) is killed after the landing.

    Raises RunError if a real vehicle is not confirmed on the ground. The processes of the run then continue.
    """
    plan = run_folder.plan_of(state)
    if left := state.survivors():
        if not state.stopped:
            say(f"the supervisor of {state.run} has died; still running: {', '.join(left)}")
        must_land = any(not v.simulated for v in plan.vehicles) if plan is not None else not now
        if not _land(state, plan, left, say, now=now) and must_land:
            unread = "" if plan is not None else "its plan cannot be read, so it may serve real vehicles; "
            raise RunError(
                f"{state.run}: {unread}no confirmation that every real vehicle is on the ground, so the processes are not ended. "
                f"Land the vehicle by hand or with `arena land-all`, then run `arena down --run {state.run}` again"
            )
    _end_supervisor(state)
    if left:
        _end(state, plan, say, lambda: not must_land or _land(state, plan, left, say, now=now))
    _forget(state)


def _land(state: RunState, plan: Plan | None, left: Iterable[str], say: Say, *, now: bool) -> bool:
    """Run the land task if a vehicle may be in the air. Return True if the landing is confirmed or no vehicle can fly."""
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
        say(f"{', '.join(real)} may be flying: real vehicles are landed even with --now")
    say(f"landing the vehicles before the processes are ended: {' '.join(argv)}")
    try:
        return (
            subprocess.run(
                argv, cwd=cwd, env=env, timeout=TIMEOUT_S, check=False, stdin=subprocess.DEVNULL
            ).returncode
            == 0
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        say(f"the command that lands the vehicles failed: {error}")
        return False


def _may_fly(plan: Plan | None, left: set[str]) -> bool:
    """Return whether a vehicle may be in the air: a simulated vehicle while its world runs, a real vehicle always.

    plan: None if unknown.  left: names of the processes that still run.
    """
    if plan is None:
        return True
    world = any(spec.kind == "world" and spec.name in left for spec in plan.processes)
    return any(world or not vehicle.simulated for vehicle in plan.vehicles)


def _end_supervisor(state: RunState) -> None:
    """Kill the supervisor of a stale run, if it still exists (for example paused by SIGSTOP).

    The kernel then kills the user programs and the YAML's `tools`, by their parent-death signal.
    """
    deadline = time.monotonic() + _GRACE_S
    while state.live and time.monotonic() < deadline:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(state.supervisor.pid, signal.SIGKILL)
        time.sleep(0.02)


def _end(state: RunState, plan: Plan | None, say: Say, land: Callable[[], bool]) -> None:
    """End the user programs and tools of a stale run first, then its other processes.

    Processes that do not end in time are killed.

    A process that a real vehicle needs to fly does not end while the vehicle is armed. It is killed only after another confirmed
    landing.

    land: function that lands the vehicles again and returns whether the landing is confirmed.
    Raises RunError if that landing is not confirmed.
    """
    specs = plan.processes if plan is not None else ()
    late = {spec.name for spec in specs if spec.outlives}
    alive = state.survivors()
    grace_s = max((spec.stop_timeout_s for spec in specs if spec.name in alive), default=_GRACE_S)
    for names in (set(state.processes) - late, late):
        _signal(state, names, signal.SIGTERM)
        if left := _wait(state, names, grace_s):
            if names is late and not land():
                raise RunError(
                    f"{state.run}: {', '.join(left)}: did not end within {grace_s:g} s, and the landing is not confirmed. Land and "
                    f"disarm the vehicle, then run `arena down --run {state.run}` again"
                )
            say(f"{', '.join(left)}: did not end within {grace_s:g} s; killing these processes")
            _signal(state, names, signal.SIGKILL)
            _wait(state, names, _GRACE_S)


def _signal(state: RunState, names: set[str], number: int) -> None:
    """Send a signal to given processes, if they still run, and to their child processes."""
    for name, pids in state.survivors().items():
        for pid in pids if name in names else []:
            try:
                os.kill(pid, number)
            except (ProcessLookupError, PermissionError):
                continue


def _wait(state: RunState, names: set[str], limit_s: float) -> list[str]:
    """Wait at most `limit_s` [s] until given processes have ended.

    Return the names of the processes that still run.
    """
    deadline = time.monotonic() + limit_s
    while (left := sorted(names & set(state.survivors()))) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def _forget(state: RunState) -> None:
    (Path(state.run) / "state.json").unlink(missing_ok=True)
    if Path(state.rt, "run").is_file():
        shutil.rmtree(state.rt, ignore_errors=True)
