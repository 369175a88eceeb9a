"""Rules for the end of a run: when it ends, which vehicles land, which processes stop, what failed. Pure.

The exit code is 1 if something failed, 130 after Ctrl-C, 0 otherwise. These are failures:
    a program ended with an exit code other than 0 before the end of the run began
    a program had not ended by itself (with `--until-done`)
    a process other than a tool of the YAML's `tools` ended with an error, or the supervisor stopped restarting it
    the landing was not confirmed
    a vehicle crashed
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum
from typing import Any

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from arena.plan.model import Plan, ProcessSpec
from arena.supervisor.process_state import ALIVE, ENDED, ProcessStatus, State

Statuses = Mapping[str, ProcessStatus]
Stats = Mapping[str, Mapping[str, Any]]

_NO_STATS: Stats = {}
_SETTLE_S, _LAST_STEPS_S = 0.5, 60.0
HITL = "hitl"
_NEVER_CONNECTED = "its PX4 has never connected to the world"
# State of a PX4 that sends no motor commands, as the world reports it -> text. The motors of such a vehicle do not turn.
_ABSENT = {
    "never connected": _NEVER_CONNECTED,
    "gone": "its PX4 has closed its connection",
    "booting": "its PX4 has not finished booting",
    "late": "its PX4 does not reply",
}


class Cause(StrEnum):
    """Kind of reason why a run ends, such as `time limit`, `Ctrl-C` or `arena down`."""

    DONE = "done"
    TIME_LIMIT = "time limit"
    INTERRUPT = "Ctrl-C"
    TERMINATED = "SIGTERM"
    HANGUP = "SIGHUP"
    DOWN = "arena down"
    LOST = "a process that others need has ended"


BY_USER = frozenset({Cause.INTERRUPT, Cause.TERMINATED, Cause.HANGUP, Cause.DOWN})


@dataclass(frozen=True, kw_only=True)
class End:
    """Decision to end a run, with the reason and the status of each process at that time.

    cause: the kind of reason.  why: the reason as text.
    statuses: process -> its status at the time of the decision.
    """

    cause: Cause
    why: str
    statuses: Statuses


def is_usable(spec: ProcessSpec, status: ProcessStatus) -> bool:
    """Return whether a process is ready, or is a task that ended with exit code 0.

    Processes that need this process may then start.
    """
    done = (
        spec.kind == "task"
        and status.state is State.EXITED
        and status.exit is not None
        and status.exit.code == 0
    )
    return status.state is State.READY or done


def needs_of(spec: ProcessSpec, specs: Mapping[str, ProcessSpec], *, restart: bool) -> list[str]:
    """Return the processes that must be ready before a process starts.

    Members of another process are left out.

    restart: the process was started before. A restart may happen in flight, so it does not need the recorder.
    """
    found = [name for name in spec.needs if name in specs]
    return [name for name in found if not (restart and specs[name].kind == "recorder")]


def is_dead(spec: ProcessSpec, status: ProcessStatus) -> bool:
    """Return whether a process has ended or failed and will not be restarted. A task that ended with exit code 0 does not count."""
    return status.state in ENDED and not is_usable(spec, status)


def lost(plan: Plan, statuses: Statuses) -> str:
    """Return a text such as `world: exit 1` if a process that the whole arena needs is lost, or "".

    Lost means that the process has ended and is not restarted.

    A process that serves one vehicle only is ignored, because its end affects only the programs of that vehicle. The recorder is
    ignored, because a flight goes on without a record. A tool is ignored, because it does not serve a flying vehicle.
    """
    needed = {need for spec in plan.processes for need in spec.needs}
    needed |= {spec.name for spec in plan.processes if spec.kind == "replay"}
    for spec in plan.processes:
        vital = spec.name in needed and spec.vehicle is None and spec.kind not in ("recorder", "tool")
        if vital and is_dead(spec, statuses[spec.name]):
            return f"{spec.name}: {statuses[spec.name].reason}"
    return ""


def grounded(plan: Plan, statuses: Statuses, stats: Stats = _NO_STATS) -> dict[str, str]:
    """Return the simulated vehicles that can no longer fly: vehicle -> reason.

    The run does not wait for the disarming of these vehicles.

    The autopilot of such a vehicle may never report `disarmed`: its PX4 has ended, or the vehicle is on the floor of the world and
    has crashed or gets no motor commands. A real autopilot, also in the loop (HITL), is never listed once it has connected, because
    only its own report counts.
    """
    worlds = [stats.get(s.name, {}) for s in plan.processes if s.kind == "world"]
    dead = {s.vehicle for s in plan.processes if s.kind == "px4" and is_dead(s, statuses[s.name])}
    found = {
        v.name: "its PX4 has ended" if v.name in dead else _down(v.name, worlds)
        for v in plan.vehicles
        if v.simulated
    }
    in_loop = {v.name for v in plan.vehicles if v.autopilot == HITL}
    return {
        name: why for name, why in found.items() if why and (name not in in_loop or why == _NEVER_CONNECTED)
    }


def _down(vehicle: str, worlds: Sequence[Mapping[str, Any]]) -> str:
    """Return why a simulated vehicle on the floor can no longer fly; "" if it can, or if it is in the air."""
    for world in worlds:
        verdict, pilot = (world.get(key, {}).get(vehicle, {}) for key in ("vehicles", "autopilot"))
        if verdict.get("airborne") is False:
            return (
                f"crashed: {verdict['crashed']}"
                if verdict.get("crashed")
                else _ABSENT.get(str(pilot.get("px4")), "")
            )
    return ""


def is_done(
    plan: Plan,
    statuses: Statuses,
    facts: Mapping[str, Any],
    stats: Stats = _NO_STATS,
    forgotten: Collection[str] = (),
) -> bool:
    """Return whether the run is done: all programs have ended, and every vehicle is disarmed or cannot fly.

    No process except a tool may be starting.

    A replay is done when it has reached the end of the record.
    forgotten: vehicles that an operator has declared dead (`arena forget`).
    """
    if plan.is_replay:
        return any(
            stats.get(s.name, {}).get("finished") is True for s in plan.processes if s.kind == "replay"
        )
    programs = all(statuses[s.name].state in ENDED for s in plan.processes if s.is_program)
    settled = all(statuses[s.name].state in ENDED | {State.READY} for s in plan.processes if s.kind != "tool")
    still = {*grounded(plan, statuses, stats), *forgotten}
    disarmed = all(facts.get(f"{v.name}.armed") is False for v in plan.vehicles if v.name not in still)
    return programs and settled and disarmed


def done_words(plan: Plan) -> str:
    """Return the reason why a run is done, as text for the user."""
    if plan.is_replay:
        return "the replay has reached the end of the record"
    return "every program has ended and every vehicle is disarmed"


def end_words(plan: Plan, cause: Cause, *, at_once: bool) -> str:
    """Return the text for the user when a run is ended by request, such as "Ctrl-C: landing, then stopping".

    at_once: without a landing of simulated vehicles.
    """
    if at_once:
        return f"{cause} --now: stopping"
    return f"{cause}: stopping" if plan.is_replay else f"{cause}: landing, then stopping"


def settle_s(plan: Plan, stats: Stats) -> float:
    """Return how long the supervisor waits before it ends a run that is done [s].

    A world that repeats flights first runs to the simulation time at which each of them ends, so it gets more time.
    """
    worlds = (stats.get(s.name, {}) for s in plan.processes if s.kind == "world")
    return _LAST_STEPS_S if any(world.get("last_steps") for world in worlds) else _SETTLE_S


def is_world_gone(plan: Plan, statuses: Statuses) -> bool:
    """Return whether the plan has a simulated world, but no world process runs."""
    worlds = [statuses[s.name] for s in plan.processes if s.kind == "world"]
    return bool(worlds) and not any(status.state in ALIVE for status in worlds)


def may_fly(
    plan: Plan,
    statuses: Statuses,
    facts: Mapping[str, Any],
    last_facts: Mapping[str, Any],
    stats: Stats = _NO_STATS,
    forgotten: Collection[str] = (),
) -> list[str]:
    """Return the vehicles that may be in the air.

    facts: facts from processes that still run.
    last_facts: the last value of every fact, also from processes that have ended.
    forgotten: vehicles that an operator has declared dead (`arena forget`); they are never listed.

    A vehicle that its link process reports as armed may fly, even if the router has not yet received that heartbeat.
    A vehicle whose `armed` is unknown may fly if the last value was true or if any program has run. A simulated vehicle
    does not fly without its world. A real vehicle that has sent no facts at all was never commanded by this run.
    In a replay nothing flies, whatever the recorded messages say.
    """
    if plan.is_replay:
        return []
    world_gone = is_world_gone(plan, statuses)
    programs_ran = any(statuses[s.name].started for s in plan.processes if s.is_program)
    flying, still, now_armed = [], grounded(plan, statuses, stats), armed(plan, statuses, facts, stats)
    for vehicle in (v for v in plan.vehicles if v.name not in still and v.name not in forgotten):
        fact = f"{vehicle.name}.armed"
        reported = vehicle.simulated or any(name.startswith(f"{vehicle.name}.") for name in last_facts)
        unknown = fact not in facts and reported and (bool(last_facts.get(fact)) or programs_ran)
        maybe = vehicle.name in now_armed or bool(facts.get(fact)) or unknown
        if maybe and not (vehicle.simulated and world_gone):
            flying.append(vehicle.name)
    return flying


def armed(plan: Plan, statuses: Statuses, facts: Mapping[str, Any], stats: Stats = _NO_STATS) -> set[str]:
    """Return the armed vehicles, as reported by the router and by the link processes of real vehicles.

    Reports of processes that have ended do not count. In a replay no vehicle is armed: the reports are recorded.
    """
    if plan.is_replay:
        return set()
    found = {v.name for v in plan.vehicles if facts.get(f"{v.name}.armed") is True}
    links = [s for s in plan.processes if s.kind == "link" and statuses[s.name].state in ALIVE]
    return found | {s.vehicle for s in links if s.vehicle and stats.get(s.name, {}).get("armed") is True}


def with_pilot(plan: Plan, facts: Mapping[str, Any], last_facts: Mapping[str, Any]) -> set[str]:
    """Return the real vehicles whose pilot has control.

    facts: facts from processes that still run.
    last_facts: last value of every fact. It counts for a vehicle if no running process reports who has control.
    """
    real = [v.name for v in plan.vehicles if not v.simulated]
    names = {name: f"{name}.control" for name in real}
    return {name for name, fact in names.items() if facts.get(fact, last_facts.get(fact)) == "pilot"}


SERVING = frozenset({"world", "mocap", "px4", "link", "forward", "router"})
"""Kinds of the processes that vehicles need to fly and to land."""
_RESTARTED_IN_LANDING = frozenset({"mocap", "link", "forward", "router"})


def kept_in_landing(plan: Plan, statuses: Statuses) -> frozenset[str]:
    """Return the processes that are restarted if they end during the landing.

    Vehicles need them to land.

    A process that has never started is not included.
    """
    return frozenset(
        s.name for s in plan.processes if s.kind in _RESTARTED_IN_LANDING and statuses[s.name].started
    )


def serving_real(plan: Plan, vehicles: Collection[str]) -> frozenset[str]:
    """Return the processes that real vehicles need to fly and to land, such as their links.

    vehicles: names of vehicles; simulated vehicles are ignored.
    """
    real = {v.name for v in plan.vehicles if not v.simulated} & set(vehicles)
    if not real:
        return frozenset()
    return frozenset(s.name for s in plan.processes if s.kind in SERVING and (s.vehicle or "") in {"", *real})


def flying_real(plan: Plan, vehicles: Collection[str]) -> frozenset[str]:
    """Return the processes of user programs that fly real vehicles.

    vehicles: names of vehicles; simulated vehicles are ignored.
    """
    real = {v.name for v in plan.vehicles if not v.simulated} & set(vehicles)
    return frozenset(s.name for s in plan.processes if real.intersection(s.flies)) if real else frozenset()


def may_stop(plan: Plan, statuses: Statuses) -> set[str]:
    """Return the processes that can be stopped now, because no running process needs them."""
    held = {need for spec in plan.processes if statuses[spec.name].state in ALIVE for need in spec.needs}
    return {spec.name for spec in plan.processes} - held


def failures(
    plan: Plan, end: End, statuses: Statuses, stats: Stats, landed: bool, until_done: bool
) -> list[str]:
    """Return one text per failure of the run, such as a crash or a program that ended with an error.

    landed: the landing was confirmed, or no vehicle flew. until_done: the run had to wait until its programs ended.
    """
    found = [] if landed else ["the landing was not confirmed"]
    waited = until_done and end.cause not in (Cause.LOST, Cause.INTERRUPT)
    if end.cause is Cause.LOST or (end.cause is Cause.TIME_LIMIT and until_done):
        found.append(end.why)
    for spec in plan.processes:
        then = end.statuses[spec.name]
        if then.state is State.FATAL and not then.started and found:
            continue  # it never started, because of a failure that is listed already
        words = _failure(spec, then, statuses[spec.name], waited)
        found.extend([f"{spec.name}: {words}"] if words and f"{spec.name}: {words}" not in found else [])
    return found + crashes(stats)


def _failure(spec: ProcessSpec, then: ProcessStatus, last: ProcessStatus, until_done: bool) -> str:
    if spec.kind == "tool":
        return ""
    if then.state in ENDED and (then.state is State.FATAL or (then.exit is not None and then.exit.code != 0)):
        return then.reason
    if spec.is_program and until_done and then.state not in ENDED:
        return f"had not ended by itself ({last.reason})"
    return ""


def crashes(stats: Stats) -> list[str]:
    """Return one text per crashed vehicle.

    stats: process -> its measurements. The world reports `vehicles: {uav1: {"crashed": reason}}`, "" if not crashed.
    """
    found = []
    for own in stats.values():
        vehicles = own.get("vehicles")
        for name, verdict in vehicles.items() if isinstance(vehicles, dict) else ():
            if isinstance(verdict, dict) and verdict.get("crashed"):
                found.append(f"{name} crashed: {verdict['crashed']}")
    return found


def outcome(
    *,
    name: str,
    run: str,
    began: datetime,
    lasted_s: float,
    end: End,
    exit_code: int,
    failed: Sequence[str],
    landing: str,
    real_time: Mapping[str, float | None] | None,
) -> dict[str, Any]:
    """Return the content of outcome.json. The report task merges it with the flight logs.

    began: wall time of the start.  lasted_s: duration of the run [s].  landing: state of the landing, as text.
    real_time: `factor`, measured simulated seconds per second, and `asked`, the requested value; None without a world.
    The loop adds `facts` (the last value of each fact) and `processes` (as in `arena ps --json`).
    """
    return {
        "name": name,
        "run": run,
        "start": began.isoformat(timespec="milliseconds"),
        "end": (began + timedelta(seconds=lasted_s)).isoformat(timespec="milliseconds"),
        "duration_s": round(lasted_s, 3),
        "cause": str(end.cause),
        "reason": end.why,
        "exit_code": exit_code,
        "failed": list(failed),
        "landing": landing,
        "real_time": dict(real_time) if real_time is not None else None,
    }


def exit_code(end: End, failed: Sequence[str], landed: bool) -> int:
    """Return the exit code of the run."""
    if not landed:
        return EXIT_FAILED
    if end.cause is Cause.INTERRUPT:
        return EXIT_INTERRUPTED
    return EXIT_FAILED if failed else EXIT_OK
