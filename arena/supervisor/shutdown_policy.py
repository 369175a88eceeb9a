"""When a run is over, whether its vehicles must land first, what may stop when, and what the run was worth. Pure.

The exit code: 1 when something failed; 130 after a Ctrl-C; 0 otherwise. Failed means: a program ended with another code than 0
before the end began; with `--until-done`, a program had not ended by itself; a process other than a tool was given up or ended
with an error; the landing was not confirmed; a vehicle crashed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from arena.plan.model import Plan, ProcessSpec
from arena.supervisor.process_state import ALIVE, ENDED, Life, State

Lives = Mapping[str, Life]
Stats = Mapping[str, Mapping[str, Any]]

_NO_STATS: Stats = {}
# What the world tells of a PX4 whose commands it does not have: the motors stand still.
_ABSENT = {
    "never connected": "its PX4 has never connected to the world",
    "gone": "its PX4 has gone",
    "booting": "its PX4 has not begun to fly",
    "late": "its PX4 does not answer",
}


class Cause(StrEnum):
    """Why a run ends."""

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
    """The decision to end. why: in words.  lives: every process when it was taken."""

    cause: Cause
    why: str
    lives: Lives


def is_served(spec: ProcessSpec, life: Life) -> bool:
    """Does this need hold for what depends on it? A task holds by having ended well."""
    done = (
        spec.kind == "task" and life.state is State.EXITED and life.exit is not None and life.exit.code == 0
    )
    return life.state is State.READY or done


def is_dead(spec: ProcessSpec, life: Life) -> bool:
    """It is not there, and nothing but a person will bring it back."""
    return life.state in ENDED and not is_served(spec, life)


def lost(plan: Plan, lives: Lives) -> str:
    """What has ended for good though the whole arena needs it, in words; "" when all is there.

    What belongs to one vehicle takes only that vehicle's programs along.
    """
    needed = {need for spec in plan.processes for need in spec.needs}
    for spec in plan.processes:
        if spec.name in needed and spec.vehicle is None and is_dead(spec, lives[spec.name]):
            return f"{spec.name}: {lives[spec.name].reason}"
    return ""


def grounded(plan: Plan, lives: Lives, stats: Stats = _NO_STATS) -> dict[str, str]:
    """Simulated vehicles that are down though they may never say so -> why. Of real ones only their own word counts.

    One whose PX4 has ended; one that the world sees on the floor, crashed, or with a PX4 that commands no motor.
    """
    worlds = [stats.get(s.name, {}) for s in plan.processes if s.kind == "world"]
    dead = {s.vehicle for s in plan.processes if s.kind == "px4" and is_dead(s, lives[s.name])}
    found = {
        v.name: "its PX4 has ended" if v.name in dead else _down(v.name, worlds)
        for v in plan.vehicles
        if v.simulated
    }
    return {name: why for name, why in found.items() if why}


def _down(vehicle: str, worlds: Sequence[Mapping[str, Any]]) -> str:
    """Why the world thinks so; "" when it does not."""
    for world in worlds:
        verdict, pilot = (world.get(key, {}).get(vehicle, {}) for key in ("vehicles", "autopilot"))
        if verdict.get("airborne") is False:
            return (
                f"crashed: {verdict['crashed']}"
                if verdict.get("crashed")
                else _ABSENT.get(str(pilot.get("px4")), "")
            )
    return ""


def is_done(plan: Plan, lives: Lives, facts: Mapping[str, Any], stats: Stats = _NO_STATS) -> bool:
    """Every program has ended for good, every vehicle is known to be disarmed or down, and nothing is still starting."""
    programs = all(lives[s.name].state in ENDED for s in plan.processes if s.kind == "program")
    settled = all(lives[s.name].state in ENDED | {State.READY} for s in plan.processes if s.kind != "tool")
    still = grounded(plan, lives, stats)
    disarmed = all(facts.get(f"{v.name}.armed") is False for v in plan.vehicles if v.name not in still)
    return programs and settled and disarmed


def is_world_gone(plan: Plan, lives: Lives) -> bool:
    """The plan has a simulated world, and it does not run."""
    worlds = [lives[s.name] for s in plan.processes if s.kind == "world"]
    return bool(worlds) and not any(life.state in ALIVE for life in worlds)


def may_fly(
    plan: Plan, lives: Lives, facts: Mapping[str, Any], told: Mapping[str, Any], stats: Stats = _NO_STATS
) -> list[str]:
    """Vehicles that may be in the air. facts: told by processes that still run; told: the last that was ever said.

    One of which nothing is known may fly once it was last heard armed, or once any program has run. A simulated vehicle
    is gone with its world. A real one that was never heard has not been commanded from here, and cannot be.
    """
    world_gone = is_world_gone(plan, lives)
    programs_ran = any(lives[s.name].started for s in plan.processes if s.kind == "program")
    flying, still = [], grounded(plan, lives, stats)
    for vehicle in (v for v in plan.vehicles if v.name not in still):
        fact = f"{vehicle.name}.armed"
        heard = vehicle.simulated or any(name.startswith(f"{vehicle.name}.") for name in told)
        unknown = fact not in facts and heard and (bool(told.get(fact)) or programs_ran)
        if (bool(facts.get(fact)) or unknown) and not (vehicle.simulated and world_gone):
            flying.append(vehicle.name)
    return flying


def may_stop(plan: Plan, lives: Lives) -> set[str]:
    """Processes whose turn to stop has come: nothing that needs them is alive."""
    held = {need for spec in plan.processes if lives[spec.name].state in ALIVE for need in spec.needs}
    return {spec.name for spec in plan.processes} - held


def failures(plan: Plan, end: End, lives: Lives, stats: Stats, landed: bool, until_done: bool) -> list[str]:
    """Everything that makes the run a failed one, in words."""
    found = [] if landed else ["the landing was not confirmed"]
    if end.cause is Cause.LOST or (end.cause is Cause.TIME_LIMIT and until_done):
        found.append(end.why)
    for spec in plan.processes:
        then = end.lives[spec.name]
        if then.state is State.FATAL and not then.started and found:
            continue  # it never ran because of a failure that is named already
        words = _failure(spec, then, lives[spec.name], until_done and end.cause is not Cause.LOST)
        found.extend([f"{spec.name}: {words}"] if words and f"{spec.name}: {words}" not in found else [])
    return found + crashes(stats)


def _failure(spec: ProcessSpec, then: Life, last: Life, until_done: bool) -> str:
    if spec.kind == "tool":
        return ""
    if then.state in ENDED and (then.state is State.FATAL or (then.exit is not None and then.exit.code != 0)):
        return then.reason
    if spec.kind == "program" and until_done and then.state not in ENDED:
        return f"had not ended by itself ({last.reason})"
    return ""


def crashes(stats: Stats) -> list[str]:
    """What the world told of vehicles that crashed: `vehicles: {uav1: {"crashed": reason or ""}}` in anybody's stats."""
    found = []
    for own in stats.values():
        vehicles = own.get("vehicles")
        for name, verdict in vehicles.items() if isinstance(vehicles, dict) else ():
            if isinstance(verdict, dict) and verdict.get("crashed"):
                found.append(f"{name} crashed: {verdict['crashed']}")
    return found


def exit_code(end: End, failed: Sequence[str], landed: bool) -> int:
    if not landed:
        return EXIT_FAILED
    if end.cause is Cause.INTERRUPT:
        return EXIT_INTERRUPTED
    return EXIT_FAILED if failed else EXIT_OK
