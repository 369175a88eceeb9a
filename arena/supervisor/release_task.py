"""`arena release` and `arena arm-permit` in the supervisor: sends the requests, and waits until the processes confirm them.

A vehicle is released everywhere or nowhere: hardware link and world are released first. The router is released when they have
confirmed, so that it refuses the programs until then. A process that reads its request too late ignores it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from arena.plan.model import Plan
from arena.supervisor.process_set import ProcessSet
from arena.supervisor.release import check_release, guards

CONFIRM_S = 3.0
"""Time within which a process must confirm a request [s]."""


@dataclass(kw_only=True)
class _Release:
    """Release of one vehicle that is under way (programs may fly it afterwards). packet: the request. later: processes that get
    the request later. waiting: process -> id of its request.

    failed: processes that did not confirm; None while the release is under way.
    """

    packet: dict[str, Any]
    expires: float
    later: set[str]
    waiting: dict[str, int] = field(default_factory=dict)
    failed: list[str] | None = None


class ReleaseTask:
    """The releases that are under way (programs may fly a vehicle afterwards), and the results of earlier releases."""

    def __init__(self, plan: Plan, processes: ProcessSet) -> None:
        self._plan, self._processes = plan, processes
        self._ids = itertools.count(1)
        self._releases: dict[str, _Release] = {}

    @property
    def results(self) -> dict[str, Any]:
        """Vehicle -> names of the processes that did not confirm the last release of this vehicle; None while the release is
        under way.
        """
        return {name: release.failed for name, release in self._releases.items()}

    def begin(self, vehicles: Sequence[str], by: str, now: float) -> None:
        """Start to release vehicles. Raises ValueError, and releases none, if one of them cannot be released.

        by: who releases them. now: monotonic [s].
        """
        p = self._processes
        check_release(self._plan, p.facts, p.stats, vehicles)
        needed = set().union(*(guards(self._plan, vehicle) for vehicle in vehicles))
        if missing := sorted(needed - p.children.keys()):
            names = ", ".join(missing)
            raise ValueError(
                f"nothing is released, because these processes do not run: {names}. Repeat the command after their restart"
            )
        for vehicle in vehicles:
            packet = {"do": "release", "vehicle": vehicle, "by": by}
            release = _Release(packet=packet, expires=now + CONFIRM_S, later=guards(self._plan, vehicle))
            self._releases[vehicle] = release
            self._ask(release, {name for name in release.later if p.specs[name].kind != "router"})
        self.step(now)

    def step(self, now: float) -> None:
        """Send the release to the routers when all other processes have confirmed it. End each release that is confirmed or too
        late. now: monotonic [s].
        """
        for release in self._releases.values():
            if release.failed is not None:
                continue
            if not self._open(release) and release.later:
                self._ask(release, set(release.later))
            if now >= release.expires or not (self._open(release) or release.later):
                release.failed = sorted({*self._open(release), *release.later})

    def _open(self, release: _Release) -> list[str]:
        """Return the names of the processes that have received the release and have not confirmed it yet."""
        confirmed = self._processes.confirmed
        return [name for name, number in release.waiting.items() if confirmed.get(name, 0) < number]

    def _ask(self, release: _Release, names: set[str]) -> None:
        release.later -= names
        number = next(self._ids)
        release.waiting |= dict.fromkeys(names, number)
        self._processes.request({**release.packet, "id": number, "expires": release.expires}, to=names)


def not_confirmed(vehicle: str, failed: Sequence[str]) -> str:
    """Return the message for the user about a release that was not confirmed. failed: names of the processes."""
    return (
        f"{vehicle}: NOT released: {', '.join(failed)} did not confirm within {CONFIRM_S:g} s, so programs may still not fly. "
        f"If `arena ps` shows a paused process, continue it, then repeat `arena release {vehicle}`"
    )
