"""Members of the fused arena in the supervisor: their packets, rows and names."""

from __future__ import annotations

import io

from rich.console import Console

from arena.plan import Plan, ProcessSpec
from arena.plan.model import Member
from arena.supervisor.messages import no_such_process
from arena.supervisor.packets import reporter
from arena.supervisor.process_rows import member_rows
from arena.supervisor.status_tables import processes_table

WORLD = ProcessSpec(name="world", kind="world", argv=("x",), members=(Member(name="router", kind="router"),))
ROW = {
    "kind": "world",
    "vehicle": None,
    "state": "READY",
    "pid": 7,
    "cpu_now": 0.5,
    "rss_mb": 90.0,
    "restarts": 0,
    "stats": {},
}


def test_packets_of_members_carry_their_name_and_kind():
    assert reporter(WORLD, {"of": "router", "stats": {}}) == ("router", "router")
    assert reporter(WORLD, {"stats": {}}) == ("world", "world")
    assert reporter(WORLD, {"of": "link.uav1"}) == ("world", "world"), (
        "a name that is no member is not trusted"
    )


def test_row_of_a_member_has_its_own_measurements_and_no_pid():
    (row,) = member_rows(WORLD, ROW, {"router": {"rate_hz": 3.0}}).values()
    assert (row["kind"], row["member_of"], row["pid"], row["state"]) == ("router", "world", None, "READY")
    assert row["stats"] == {"rate_hz": 3.0} and row["rss_mb"] == 0.0


def test_table_shows_in_which_process_a_member_runs():
    rows = {"world": ROW, **member_rows(WORLD, ROW, {"router": {}})}
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(processes_table({"processes": rows}))
    line = next(text for text in console.export_text().splitlines() if text.startswith("router"))
    assert "in world" in line and "90" not in line


def test_request_to_a_member_is_answered_with_its_process():
    plan = Plan(name="a", address="127.0.0.1", vehicles=(), processes=(WORLD,))
    assert no_such_process("router", plan).startswith("router is a part of the process world")
    assert no_such_process("x", plan) == "no process 'x' in this arena; there are world"
