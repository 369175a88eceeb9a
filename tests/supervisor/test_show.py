"""The table of a running arena, on paper."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from arena.supervisor.terminal import picture


def row(state: str, **changes: Any) -> dict[str, Any]:
    stats = {"log_hz": 30.0, "mocap_hz": 180.0, "datagrams_hz": 235.3}
    known = {
        "state": state,
        "cpu_now": 0.07,
        "rss_mb": 39.2,
        "restarts": 0,
        "reason": "exit 0 (the run ends)",
        "stats": stats,
    }
    return {**known, **changes}


@pytest.mark.parametrize("columns", [60, 80, 200])
def test_names_states_and_figures_are_whole_however_narrow_the_terminal(columns):
    status = {
        "name": "lab",
        "phase": "running",
        "up_s": 3.2,
        "vehicles": ["uav1"],
        "facts": {"uav1.mode": "OFFBOARD", "uav1.armed": True},
        "processes": {
            "world": row("STARTING"),
            "forward.uav10": row("READY", restarts=3),
            "logger.uav10": row("STOPPING"),
        },
    }
    out = io.StringIO()
    Console(file=out, width=columns).print(picture(status))
    lines = out.getvalue().splitlines()
    assert lines[0].strip() == "lab: running, 3 s"
    assert [x.split()[:4] for x in lines[2:5]] == [
        ["world", "STARTING", "7", "39"],
        ["forward.uav10", "READY", "7", "39"],
        ["logger.uav10", "STOPPING", "7", "39"],
    ]
    assert lines[3].split()[4] == "3" and all(len(x) <= columns for x in lines)
    assert lines[-1].split() == ["uav1", "OFFBOARD", "yes", "-"]
