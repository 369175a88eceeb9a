"""Table of the landings by `arena land-all` and `arena kill-all` that a router, world or hardware link has missed."""

from __future__ import annotations

from typing import Any, NamedTuple

from arena.authority import Role


class Missed(NamedTuple):
    """Landing or stop of the motors that a process has not received, because it was not ready.

    guard: name of the process. strength: 3 landing, 4 stop of the motors, as in `Authority.standing`.
    """

    guard: str
    vehicle: str
    strength: int

    @property
    def request(self) -> dict[str, Any]:
        """Request to the process to latch the landing."""
        standing = {"latch": [int(Role.EMERGENCY), self.strength]}
        return {"do": "restore", "vehicle": self.vehicle, "standing": standing}


class MissedLandings:
    """Landings that processes have missed and that nobody has released. A process gets them at each of its starts."""

    def __init__(self) -> None:
        self._at: dict[Missed, float] = {}

    def __contains__(self, missed: Missed) -> bool:
        return missed in self._at

    @property
    def vehicles(self) -> set[str]:
        """Names of the vehicles whose landing a process has missed."""
        return {missed.vehicle for missed in self._at}

    def add(self, missed: Missed, at: float) -> bool:
        """Add a landing that was commanded at the time `at`, monotonic [s]. Return whether it is new in the table."""
        new = missed not in self._at
        self._at[missed] = max(at, self._at.get(missed, at))
        return new

    def release(self, vehicle: str, began: float) -> None:
        """Remove the landings of a vehicle that were commanded before its release began, at the time `began`, monotonic [s]."""
        self._at = {m: at for m, at in self._at.items() if m.vehicle != vehicle or at > began}

    def requests(self, guard: str) -> list[dict[str, Any]]:
        """Return the requests to a process that has just started: it must latch the landings that it has missed."""
        return [missed.request for missed in self._at if missed.guard == guard]
