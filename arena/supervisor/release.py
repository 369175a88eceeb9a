"""Rules of `arena release`, which lets programs fly a vehicle again, for example after `land-all`. Pure.

A link, router or world that refuses the commands of programs must still refuse them after a restart. `restore_requests`
provides for this.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from arena.plan.model import Plan, ProcessSpec

GUARDS = ("world", "link", "router")
"""Kinds of the processes that pass commands to a vehicle."""

_STANDING = (".standing", ".standing_at_link")


def guards(plan: Plan, vehicle: str = "") -> set[str]:
    """Return the processes that can block commands to a vehicle: world, router and link process.

    vehicle: name of the vehicle; "" for all vehicles.
    """
    kinds = (spec for spec in plan.processes if spec.kind in GUARDS)
    return {spec.name for spec in kinds if not vehicle or spec.vehicle in (None, vehicle)}


def check_release(
    plan: Plan,
    facts: Mapping[str, Any],
    stats: Mapping[str, Mapping[str, Any]],
    vehicles: Sequence[str],
    missed: Collection[str] = (),
) -> None:
    """Check that vehicles can be released. Raises ValueError for an unknown vehicle, or if programs may fly it.

    facts: values that the processes sent. A vehicle without a fact `control` has no process that reports it now.
    stats: process -> its measurements.
    missed: vehicles with a recorded landing that a process has missed (`MissedLandings`). They can be released too.
    """
    names = [v.name for v in plan.vehicles]
    if not vehicles:
        raise ValueError(f"got no vehicle, expected at least one of {', '.join(names)}")
    for vehicle in vehicles:
        if vehicle not in names:
            raise ValueError(f"got vehicle {vehicle!r}, expected one of {', '.join(names)}")
        known = f"{vehicle}.control" in facts and vehicle not in missed
        if known and not blocked(vehicle, facts) and not _blocked_in_world(plan, stats, vehicle):
            control = facts[f"{vehicle}.control"] or "nobody"
            raise ValueError(
                f"{vehicle}: no release is needed: programs are already allowed to command this vehicle (control: {control})"
            )


def restore_requests(plan: Plan, spec: ProcessSpec, facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return requests that make a restarted process refuse the same commands as before its restart.

    Only the world, the router and the links refuse commands. A request also reports to a link that its vehicle was armed:
    the link must not end before the vehicle is disarmed.

    facts: last values that the processes sent, also those that have ended. `<vehicle>.standing` lists what a process refuses.
    """
    if spec.kind not in GUARDS:
        return []
    names = [v.name for v in plan.vehicles if spec.vehicle in (None, v.name)]
    found = [(name, facts.get(f"{name}{place}")) for name in names for place in _STANDING]
    armed = [name for name in names if spec.kind == "link" and facts.get(f"{name}.armed") is True]
    return [
        *({"do": "restore", "vehicle": name, "standing": value} for name, value in found if value),
        *({"do": "was_armed", "vehicle": name} for name in armed),
    ]


def has_pilot(vehicle: str, facts: Mapping[str, Any], last_facts: Mapping[str, Any]) -> bool:
    """Return whether a pilot has control of a vehicle, as the router or the hardware link reports it.

    facts: values of the processes that run. last_facts: values also of processes that have ended. They count if no process that
        runs reports the standing of the vehicle.
    """
    names = [f"{vehicle}{place}" for place in _STANDING]
    reports = [facts[name] for name in names if name in facts] or [last_facts.get(name) for name in names]
    return any(isinstance(report, Mapping) and report.get("pilot") is True for report in reports)


def blocked(vehicle: str, facts: Mapping[str, Any]) -> str:
    """Return why programs may not fly a vehicle, or "" if they may.

    The router and the hardware link report the reason.
    """
    return str(facts.get(f"{vehicle}.blocked") or facts.get(f"{vehicle}.blocked_at_link") or "")


def _blocked_in_world(plan: Plan, stats: Mapping[str, Mapping[str, Any]], vehicle: str) -> bool:
    """Return whether the built-in autopilot of a vehicle refuses commands of programs, as the world reports it.

    `land-all` can command this autopilot directly. The router may then report no refusal, although the autopilot refuses programs.
    """
    worlds = [stats.get(spec.name, {}) for spec in plan.processes if spec.kind == "world"]
    return any(world.get("autopilot", {}).get(vehicle, {}).get("blocked") for world in worlds)
