"""The tables of a running arena."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from arena.supervisor.status_tables import header, status_view


def row(state: str, **changes: Any) -> dict[str, Any]:
    stats = {"log_hz": 30.0, "mocap_hz": 180.0, "datagrams_hz": 235.3}
    known = {
        "kind": "tool",
        "vehicle": None,
        "state": state,
        "starts": 1,
        "cpu_now": 0.07,
        "rss_mb": 39.2,
        "restarts": 0,
        "reason": "exit 0 (the run ends)",
        "stats": stats,
    }
    return {**known, **changes}


def status(**changes: Any) -> dict[str, Any]:
    known = {
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
    return {**known, **changes}


def drawn(given: dict[str, Any], columns: int = 80) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=columns).print(status_view(given))
    return out.getvalue().splitlines()


@pytest.mark.parametrize("columns", [60, 80, 200])
def test_names_states_and_figures_fit_any_terminal(columns: int) -> None:
    lines = drawn(status(), columns)
    assert lines[0].strip() == "lab: running, 3 s"
    assert lines[2].split() == ["uav1", "OFFBOARD", "yes", "-", "-", "-", "-"]
    assert [x.split()[:4] for x in lines[-3:]] == [
        ["world", "STARTING", "7", "39"],
        ["forward.uav10", "READY", "7", "39"],
        ["logger.uav10", "STOPPING", "7", "39"],
    ]
    assert lines[-2].split()[4] == "3" and all(len(x) <= columns for x in lines)


def test_state_of_a_silent_vehicle_is_marked_as_old() -> None:
    facts = {"uav1.mode": "AUTO.LOITER", "uav1.armed": False, "uav1.landed": True, "uav1.connected": False}
    telemetry = {"uav1": {"height_m": 0.05, "battery": None}}
    processes = {"router": row("READY", kind="router", stats={"telemetry": telemetry})}
    line = drawn(status(facts=facts, processes=processes))[2]
    assert line.split() == [
        "uav1",
        "was",
        "AUTO.LOITER",
        "was",
        "no",
        "was",
        "yes",
        "was",
        "0.05",
        "m",
        "-",
        "-",
    ]
    now = drawn(status(facts={**facts, "uav1.connected": True}, processes=processes))[2]
    assert now.split() == ["uav1", "AUTO.LOITER", "no", "yes", "0.05", "m", "-", "-"]


def test_height_battery_and_pose_age_stand_in_the_vehicles_row() -> None:
    telemetry = {"uav1": {"height_m": 1.054, "battery": 97}}
    processes = {
        "router": row("READY", kind="router", stats={"telemetry": telemetry}),
        "forward.uav1": row("READY", kind="forward", vehicle="uav1", stats={"pose_age_ms": 12.3}),
    }
    assert drawn(status(processes=processes))[2].split() == [
        "uav1",
        "OFFBOARD",
        "yes",
        "-",
        "1.05",
        "m",
        "97",
        "%",
        "12",
        "ms",
    ]


@pytest.mark.parametrize(("rtf", "colour"), [(0.65, "yellow"), (0.97, "yellow"), (0.98, "green")])
def test_the_real_time_factor_is_yellow_below_the_limit(rtf: float, colour: str) -> None:
    text = header(status(processes={"world": row("READY", kind="world", stats={"rtf": rtf})}))
    assert text.plain == f"lab: running, 3 s, real-time factor {rtf:.2f}"
    assert text.spans[-1].style == colour


def test_the_start_shows_how_many_processes_are_ready() -> None:
    assert header(status(phase="starting")).plain == "lab: starting, 3 s, 2 of 3 ready"


def test_control_is_shown_when_another_than_the_program_commands_a_vehicle() -> None:
    facts = {"uav1.mode": "AUTO.LAND", "uav1.armed": True, "uav1.control": "land-all", "uav1.blocked": "x"}
    lines = drawn(status(facts=facts), 120)
    assert "control" in lines[1]
    assert lines[2].split()[:6] == ["uav1", "AUTO.LAND", "yes", "-", "land-all,", "blocked"]
    assert "control" not in drawn(status(facts={"uav1.control": "program"}), 120)[1]
