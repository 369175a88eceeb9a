"""Identity and axes checks of real vehicles in the supervisor: what the link processes receive."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.plan import Plan, make_plan
from arena.schema import load_arena
from arena.supervisor.arm_permit import check_vehicle
from arena.supervisor.axes_check import body_requests, check_request

ARENA = """
mocap: {source: natnet, server: 10.0.0.5}
defaults: {profile: iris}
vehicles:
  uav1: {autopilot: builtin}
  uav2: {autopilot: hardware, url: "udpin:127.75.0.1:14540", mocap_body: tail}
  uav3: {autopilot: hardware, url: "udpin:127.75.0.1:14541", forward: false}
"""


def plan_of(folder: Path, more: str = "") -> Plan:
    (folder / "arena.yaml").write_text(ARENA + more)
    return make_plan(load_arena(folder / "arena.yaml"))


def test_the_definition_of_the_body_goes_to_the_link_of_a_real_vehicle(tmp_path):
    stats = {"forward.uav1": {"body_definition": "x"}, "forward.uav2": {"body_definition": "markers 1"}}
    request = {"do": "body", "vehicle": "uav2", "definition": "markers 1"}
    assert body_requests(plan_of(tmp_path), stats) == [("link.uav2", request)]


def test_a_definition_that_is_not_reported_yet_is_not_passed_on(tmp_path):
    assert body_requests(plan_of(tmp_path), {}) == []


def test_a_check_is_started_and_stopped_by_a_request():
    assert check_request("uav2", "eva", stop=False) == {"do": "axes_check", "vehicle": "uav2", "by": "eva"}
    assert check_request("uav2", "eva", stop=True)["do"] == "stop_axes_check"


@pytest.mark.parametrize(
    ("real", "message"),
    [({"uav2": True}, "expected a real vehicle: uav2"), ({}, "all vehicles of this arena are simulated")],
)
def test_a_simulated_vehicle_is_not_checked(real, message):
    with pytest.raises(ValueError, match=message):
        check_vehicle(real, "uav1")


@pytest.mark.parametrize(("more", "needed"), [("", True), ("preflight: {axes_check: none}\n", False)])
def test_real_vehicles_with_poses_need_the_check_by_default(tmp_path, more, needed):
    plan = plan_of(tmp_path, more)
    links = {name: plan.slices[f"link.{name}.json"] for name in ("uav2", "uav3")}
    assert [link["preflight"]["axes_check"] for link in links.values()] == [needed, False]
    assert links["uav2"]["body"] == "tail" and links["uav2"]["capture"]["bodies"] is None
    assert links["uav3"]["capture"] is None
    assert links["uav2"]["axes_file"] == str(tmp_path / "preflight" / "uav2.json")
    assert links["uav2"]["missing_reboots"]["folder"] == str(tmp_path)
    assert [v.axes_check for v in plan.vehicles] == ["", "required" if needed else "none", ""]
