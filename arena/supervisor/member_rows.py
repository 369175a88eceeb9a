"""Rows of the process table for the members of the fused arena and of groups, which have no process of their own. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.plan.model import ProcessSpec

_NO_USE: Mapping[str, Any] = {
    "pid": None,
    "cpu_s": 0.0,
    "cpu_mean": 0.0,
    "cpu_now": 0.0,
    "rss_mb": 0.0,
    "rss_peak_mb": 0.0,
    "over_budget": [],
}
"""Figures that only the process itself has."""


def member_rows(
    spec: ProcessSpec, row: Mapping[str, Any], stats: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return one row of the process table for each member of a process. A member is a part or program without a process of its
    own.

    row: row of the process.  stats: name of a process or member -> its measurements.
    """
    return {
        member.name: {
            **row,
            **_NO_USE,
            "kind": member.kind,
            "vehicle": member.vehicle,
            "member_of": spec.name,
            **_ended(stats[member.name]),
            "stats": stats[member.name],
        }
        for member in spec.members
    }


def _ended(own: Mapping[str, Any]) -> dict[str, Any]:
    """Return state, reason and exit of a program of a group if the program has ended; else {}."""
    code, said = own.get("exit_code"), own.get("exit")
    if not isinstance(code, int) or not isinstance(said, str):
        return {}
    return {"state": "EXITED", "reason": said, "exit_code": code, "exit": said}
