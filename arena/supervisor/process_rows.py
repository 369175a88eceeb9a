"""Rows of the process table, for processes and for their members: parts of the arena, or programs, that share one process. Pure.

A simulated arena can run as one process, `fused`: its members are the world, motion capture, router and recorder. The process of
a group has the programs of several vehicles as its members.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.plan.model import ProcessSpec
from arena.supervisor.meters import Meter
from arena.supervisor.process_state import ProcessStatus

_NO_USE: Mapping[str, Any] = {
    "pid": None,
    "cpu_s": 0.0,
    "cpu_mean": 0.0,
    "cpu_now": 0.0,
    "rss_mb": 0.0,
    "rss_peak_mb": 0.0,
    "over_budget": [],
}
"""Columns that are measured for a whole process only, with their values in the row of a member."""


def process_row(
    spec: ProcessSpec,
    status: ProcessStatus,
    meter: Meter,
    pid: int | None,
    stats: Mapping[str, Any],
    now: float,
) -> dict[str, Any]:
    """Return the table row of a process.

    pid: None if it does not run.  stats: its measurements.  now: monotonic [s].
    """
    return {
        "kind": spec.kind,
        "vehicle": spec.vehicle,
        "state": str(status.state),
        "reason": status.reason,
        "exit_code": status.exit.code if status.exit else None,
        "exit": status.exit.text if status.exit else None,
        "pid": pid,
        "starts": status.started,
        "restarts": status.restarts,
        "alive_s": round(meter.alive_s(now), 3),
        "cpu_s": round(meter.cpu_s, 3),
        "cpu_mean": round(meter.cpu_mean(now), 4),
        "cpu_now": round(meter.now_cpu, 4),
        "rss_mb": round(meter.now_mb, 1),
        "rss_peak_mb": round(meter.peak_mb, 1),
        "over_budget": meter.over_budget(spec, now),
        "stats": stats,
    }


def member_rows(
    spec: ProcessSpec, row: Mapping[str, Any], stats: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the table rows of the members of a process: parts of the arena, or programs of a group.

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
    """Return state, reason and exit code of a member that has ended, such as a program of a group.

    While the member runs, return {}.

    own: measurements of the member.
    """
    code, said = own.get("exit_code"), own.get("exit")
    if not isinstance(code, int) or not isinstance(said, str):
        return {}
    return {"state": "EXITED", "reason": said, "exit_code": code, "exit": said}
