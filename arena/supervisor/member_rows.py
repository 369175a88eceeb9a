"""Members of the fused arena in the supervisor: their packets, and their rows in the process table. Pure."""

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


def reporter(spec: ProcessSpec, packet: Mapping[str, Any]) -> tuple[str, str]:
    """Return name and kind of the part that sent a packet: a member of the fused arena, or the process itself."""
    for member in spec.members if "of" in packet else ():
        if member.name == packet["of"]:
            return member.name, member.kind
    return spec.name, spec.kind


def member_rows(
    spec: ProcessSpec, row: Mapping[str, Any], stats: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the row of each member of a process: the state of the process, and the member's own measurements.

    row: row of the process.  stats: name of a process or member -> its measurements.
    """
    return {
        member.name: {
            **row,
            **_NO_USE,
            "kind": member.kind,
            "vehicle": member.vehicle,
            "member_of": spec.name,
            "stats": stats[member.name],
        }
        for member in spec.members
    }
