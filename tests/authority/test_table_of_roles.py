"""The table of docs/explanation/authority.md, compared with the state machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from arena.authority import Authority, Kind, Request, Role

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "authority.md"
NOW = 10.0


def mode(name: str) -> Request:
    return Request(Kind.MODE, name)


LAND, HOLD, OFFBOARD, POSCTL = (mode(m) for m in ("AUTO.LAND", "AUTO.LOITER", "OFFBOARD", "POSCTL"))
REQUESTS = {
    "arm": [Request(Kind.ARM)],
    "OFFBOARD": [OFFBOARD],
    "mission": [mode("AUTO.MISSION")],
    "take-off": [mode("AUTO.TAKEOFF")],
    "failure": [Request(Kind.FAILURE)],
    "shell and motor commands": [Request(Kind.SPIN)],
    "setpoint": [Request(Kind.SETPOINT)],
    "AUTO.LAND": [LAND],
    "disarm": [Request(Kind.DISARM)],
    "kill": [Request(Kind.KILL)],
    "other modes": [HOLD, mode("AUTO.RTL")],
    "manual mode": [POSCTL],
    "sticks": [Request(Kind.MANUAL_INPUT)],
    "hold": [HOLD],
    "land": [LAND],
    "terminate": [Request(Kind.KILL)],
}
ROLES = {"program": Role.PROGRAM, "ground station": Role.GROUND_STATION, "copilot": Role.COPILOT}


def in_offboard() -> Authority:
    a = Authority(simulated=False)
    a.refusal(Role.PROGRAM, OFFBOARD, 0.0)
    a.on_state(True, "OFFBOARD", 0.1)
    return a


def pilot() -> Authority:
    a = in_offboard()
    a.on_state(True, "POSCTL", 1.0)
    return a


def landed_by(role: Role) -> Authority:
    a = in_offboard()
    a.refusal(role, LAND, 1.0)
    a.on_state(True, "AUTO.LAND", 1.5)
    return a


def held() -> Authority:
    a = in_offboard()
    a.refusal(Role.COPILOT, HOLD, NOW - 0.5)
    a.on_state(True, "AUTO.LOITER", NOW - 0.4)
    return a


def taken() -> Authority:
    a = in_offboard()
    a.refusal(Role.GROUND_STATION, HOLD, 1.0)
    a.on_state(True, "AUTO.LOITER", 1.5)
    return a


STATES: list[Callable[[], Authority]] = [
    pilot,
    lambda: landed_by(Role.EMERGENCY),
    lambda: landed_by(Role.COPILOT),
    held,
    taken,
]


def rows() -> list[tuple[str, list[str]]]:
    section = PAGE.read_text().split("## Which request is allowed")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    assert len(lines) > 10, "the page has no table of requests"
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    return [(row[0], row[1:]) for row in cells]


@pytest.mark.parametrize(("request_", "allowed"), rows(), ids=lambda value: str(value)[:40])
def test_table_agrees_with_the_state_machine(request_, allowed):
    assert len(allowed) == len(STATES)
    if request_ == "land-all, kill-all":
        role, requests = Role.EMERGENCY, [LAND, Request(Kind.KILL)]
    else:
        who, _, what = request_.partition(": ")
        role, requests = ROLES[who], [r for name in what.split(", ") for r in REQUESTS[name]]
    for make, cell in zip(STATES, allowed, strict=True):
        for request in requests:
            assert (make().refusal(role, request, NOW) == "") is cell.startswith("yes"), (cell, request)
