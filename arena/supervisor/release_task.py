"""Carries out `arena release`: sends the release to router, links and world, and waits for confirmations.

After `land-all`, for example, these processes refuse all commands that programs send to a vehicle. The release of the vehicle
ends this: programs may fly the vehicle again. Hardware link and world get the release first. The router gets it when they have
confirmed, so no command of a program passes before all processes accept it. A process that reads the release later than CONFIRM_S
after `arena release` ignores it.
"""

from __future__ import annotations

import itertools
import math
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
    """State of one vehicle's release (`arena release`): which processes have received and confirmed the request.

    packet: the request to the processes.
    began: time of `arena release`, monotonic [s].
    expires: time at which the release fails if a process has not confirmed it, monotonic [s].
    unsent: processes to which the request has not been sent yet.
    sent: process -> id of the request that was sent to this process.
    failed: processes that did not confirm; None while the release is in progress.
    ended: time at which the result was known, monotonic [s].
    """

    packet: dict[str, Any]
    began: float
    expires: float
    unsent: set[str]
    sent: dict[str, int] = field(default_factory=dict)
    failed: list[str] | None = None
    ended: float = math.inf


class ReleaseTask:
    """Sender of releases (`arena release`), which also keeps the result of each vehicle's last release.

    released: vehicle -> time of its last `arena release` that all processes have confirmed, monotonic [s].
    """

    def __init__(self, plan: Plan, processes: ProcessSet) -> None:
        self._plan, self._processes = plan, processes
        self._ids = itertools.count(1)
        self._releases: dict[str, _Release] = {}
        self.released: dict[str, float] = {}

    @property
    def results(self) -> dict[str, Any]:
        """Return vehicle -> processes that did not confirm its last release, or None while it is in progress."""
        return {name: release.failed for name, release in self._releases.items()}

    def in_progress(self, vehicle: str) -> bool:
        """Return whether the release of a vehicle has begun and its result is not known yet."""
        return vehicle in self._releases and self._releases[vehicle].failed is None

    def was_in_progress(self, vehicle: str, at: float) -> bool:
        """Return whether the last release of a vehicle was in progress at the time `at`, monotonic [s].

        A process may have received a landing of this time before the release, which then ended the latch of the landing.
        """
        release = self._releases.get(vehicle)
        return release is not None and release.began < at <= release.ended

    def begin(self, vehicles: Sequence[str], by: str, now: float) -> None:
        """Start to release vehicles: programs may then fly them again. Raises ValueError if this is not possible.

        Then no vehicle is released.

        by: who releases them. now: monotonic [s].
        """
        p = self._processes
        check_release(self._plan, p.facts, p.stats, vehicles, p.missed.vehicles)
        needed = set().union(*(guards(self._plan, vehicle) for vehicle in vehicles))
        if missing := sorted(needed - p.children.keys()):
            names = ", ".join(missing)
            raise ValueError(
                f"nothing is released, because these processes do not run: {names}. Repeat the command after their restart"
            )
        for vehicle in vehicles:
            packet = {"do": "release", "vehicle": vehicle, "by": by}
            release = _Release(
                packet=packet, began=now, expires=now + CONFIRM_S, unsent=guards(self._plan, vehicle)
            )
            self._releases[vehicle] = release
            self._ask(release, {name for name in release.unsent if p.specs[name].kind != "router"})
        self.step(now)

    def step(self, now: float) -> None:
        """Send each release to the router after the links and the world have confirmed it.

        End the releases that all processes
        have confirmed, and those that were not confirmed within CONFIRM_S. now: monotonic [s].
        """
        for vehicle, release in self._releases.items():
            if release.failed is not None:
                continue
            if not self._unconfirmed(release) and release.unsent:
                self._ask(release, set(release.unsent))
            if now >= release.expires or not (self._unconfirmed(release) or release.unsent):
                release.failed, release.ended = sorted({*self._unconfirmed(release), *release.unsent}), now
                if not release.failed:
                    self.released[vehicle] = release.began
                    self._processes.missed.release(vehicle, release.began)

    def _unconfirmed(self, release: _Release) -> list[str]:
        """Return the names of the processes that have received the request but not confirmed it yet."""
        confirmed = self._processes.confirmed
        return [name for name, number in release.sent.items() if confirmed.get(name, 0) < number]

    def _ask(self, release: _Release, names: set[str]) -> None:
        release.unsent -= names
        number = next(self._ids)
        release.sent |= dict.fromkeys(names, number)
        self._processes.request({**release.packet, "id": number, "expires": release.expires}, to=names)


def not_confirmed(vehicle: str, failed: Sequence[str]) -> str:
    """Return the message for the user about a release that was not confirmed.

    failed: names of the processes.
    """
    return (
        f"{vehicle}: NOT released: {', '.join(failed)} did not confirm within {CONFIRM_S:g} s, so programs may still not fly. "
        f"If `arena ps` shows a paused process, continue it, then repeat `arena release {vehicle}`"
    )
