"""Vehicles that were reported as armed. Pure.

A supervisor that was paused reads the reports of a whole flight at once: the last one of them says that the vehicle is disarmed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.plan.model import ProcessSpec

LONGEST_GAP_S = 10.0
"""Longest pause of the supervisor of which all reports are read [s]. Later, a sender joins the reports that wait."""
_FACT = ".armed"


class ArmedReports:
    """Vehicles that a process has reported as armed since the last call of `take`."""

    def __init__(self) -> None:
        self._found: set[str] = set()
        self._taken_at: float | None = None

    def on_facts(self, facts: Mapping[str, Any]) -> None:
        """Store the vehicles that the facts of a process report as armed, for example `uav1.armed: true`."""
        self._found |= {
            key.removesuffix(_FACT) for key, value in facts.items() if value is True and key.endswith(_FACT)
        }

    def on_stats(self, spec: ProcessSpec, stats: Mapping[str, Any]) -> None:
        """Store the vehicle of a link process whose measurements report it as armed."""
        if spec.kind == "link" and spec.vehicle and stats.get("armed") is True:
            self._found.add(spec.vehicle)

    def take(self, vehicles: set[str], now: float) -> set[str]:
        """Return the vehicles that were reported as armed since the last call; all of `vehicles` if that was too long ago.

        now: monotonic [s].
        """
        before, self._taken_at = self._taken_at, now
        found, self._found = self._found, set()
        was_paused = before is not None and now - before > LONGEST_GAP_S
        return found | (vehicles if was_paused else set())
