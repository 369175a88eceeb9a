"""Tests of the plan of a replay: it can reach no vehicle and no other computer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from arena.errors import InputError
from arena.obstacles import Obstacle
from arena.plan.model import Plan
from arena.plan.open_ports import open_lines, open_sockets
from arena.plan.replay import ReplayedVehicle, ReplaySettings, make_replay_plan, recorded_yaml
from arena.replay.loopback import check_loopback

LAB = {
    "name": "lab",
    "mocap": {
        "source": "natnet",
        "server": "192.168.1.10",
        "local": "192.168.1.2",
        "rate_hz": 120,
        "group": "239.1.2.3",
    },
    "world": {"size": [9.0, 5.0, 4.0]},
    "tools": {"viewer": {"argv": ["viewer"]}},
    "vehicles": {
        "uav1": {
            "autopilot": "hardware",
            "profile": "iris",
            "url": "udpout:192.168.1.12:14550",
            "gcs": ["192.168.1.20"],
        },
        "uav2": {
            "autopilot": "hardware",
            "profile": "iris",
            "serial": "/dev/ttyUSB0",
            "program": {"path": "/x/fly.py"},
        },
    },
}
VEHICLES = [
    ReplayedVehicle(name="uav1", id=1, body="uav1", simulated=False, autopilot="hardware", profile="iris"),
    ReplayedVehicle(name="uav2", id=2, body="drone_2", simulated=True, autopilot="builtin", profile="iris"),
]


def plan(**options: Any) -> Plan:
    settings = {
        "name": "lab",
        "sources": ["/runs/lab/flight.mcap"],
        "vehicles": VEHICLES,
        "size_m": (7.0, 4.0, 3.0),
    }
    return make_replay_plan(ReplaySettings(**{**settings, "recorded": LAB, **options}))


def test_viewers_of_a_replay_draw_the_recorded_fence_and_obstacles() -> None:
    pole = Obstacle(name="pole", shape="sphere", size_m=(1.0, 1.0, 1.0), centre_n=(1.0, 0.0, -1.0)).slice()
    drawn = {"fence": {"north": [-1, 1], "east": [-1, 1], "up": 2}, "obstacles": [pole]}
    made = plan(drawn=drawn, recorded={})
    for name in ("view.json", "recorder.json"):
        assert {key: made.slices[name][key] for key in drawn} == drawn


def test_replay_of_hardware_opens_no_connection_to_a_vehicle() -> None:
    made = plan()
    assert {p.kind for p in made.processes} == {"replay"}
    text = json.dumps(made.slices) + made.yaml
    for trace in ("192.168.", "/dev/tty", "udpout", "fly.py", "viewer", "239.1.2.3"):
        assert trace not in text
    assert all(v.simulated for v in made.vehicles)


def test_replay_opens_loopback_addresses_only() -> None:
    made = plan()
    check_loopback(made.slices)
    assert all(opened.local for opened in open_sockets(made))
    assert open_lines(made) == []


def test_ground_station_on_another_computer_gets_telemetry_only_if_named() -> None:
    def stations(made: Plan) -> list[str]:
        return [station["address"][0] for station in made.slices["router.json"]["gcs"]]

    assert stations(plan()) == ["127.0.77.1"]
    assert stations(plan(stations=("192.168.1.20",))) == ["127.0.77.1", "192.168.1.20"]
    assert stations(plan(local_station=False)) == []


def test_ground_station_on_this_computer_may_send_from_its_usual_address() -> None:
    (station,) = plan().slices["router.json"]["gcs"]
    assert station == {"name": "gcs", "address": ["127.0.77.1", 14550], "also_from": ["127.0.0.1", 14550]}


def test_no_heartbeat_and_no_faults_are_sent_to_replayed_vehicles() -> None:
    router = plan().slices["router.json"]
    assert router["heartbeat"] is False
    assert router["faults"] is None


def test_address_outside_loopback_is_refused() -> None:
    with pytest.raises(InputError, match="loopback"):
        make_replay_plan(
            ReplaySettings(name="lab", sources=["x"], vehicles=VEHICLES, size_m=(7.0, 4.0, 3.0)),
            "192.168.1.2",
        )


def test_replay_has_an_address_of_its_own() -> None:
    made = plan()
    assert made.address == "127.0.77.1"
    assert made.slices["mocap.json"]["group"] != "239.255.42.99"


def test_plan_says_that_it_is_a_replay() -> None:
    made = plan()
    assert made.replay == "/runs/lab/flight.mcap"
    assert {v.autopilot for v in made.vehicles} == {"replay"}
    assert made.yaml.startswith("# replay of /runs/lab/flight.mcap\n")
    assert Plan.from_json(made.to_json()) == made


def test_room_and_rates_are_those_of_the_recorded_arena() -> None:
    made = plan()
    assert made.slices["view.json"]["size_m"] == [9.0, 5.0, 4.0]
    assert made.slices["mocap.json"]["rate_hz"] == 120


def test_viewers_get_captured_poses_of_real_vehicles() -> None:
    view = plan().slices["view.json"]
    assert [(v["name"], v["replayed"], v["index"]) for v in view["vehicles"]] == [
        ("uav1", True, None),
        ("uav2", True, 1),
    ]
    (capture,) = view["captures"]
    assert (capture["server"], capture["bodies"]) == ("127.0.77.1", ["uav1"])


@pytest.mark.parametrize("speed", [1.0, 4.0, "max"])
def test_programs_and_viewers_receive_the_motion_capture_at_every_speed(speed: float | str) -> None:
    made = plan(speed=speed).slices
    captures = [made["program.uav1.json"]["capture"], *made["view.json"]["captures"]]
    assert [(one["kind"], one["server"], one["bodies"]) for one in captures] == [
        ("natnet", "127.0.77.1", ["uav1"])
    ] * 2


def test_arena_without_a_recorded_yaml_is_made_from_the_record() -> None:
    made = plan(recorded={})
    assert made.slices["view.json"]["size_m"] == [7.0, 4.0, 3.0]
    assert [v.name for v in made.vehicles] == ["uav1", "uav2"]


def test_missing_profile_file_is_replaced_by_the_default(tmp_path: Path) -> None:
    recorded = {**LAB, "vehicles": {"uav1": {"profile": "gone.yaml"}}}
    made = plan(recorded=recorded, folder=str(tmp_path))
    assert made.vehicles[0].profile == "iris"


def test_recorded_yaml_that_cannot_be_read_is_empty(tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text("- a\n- b\n")
    assert recorded_yaml(tmp_path / "arena.yaml") == {}
    assert recorded_yaml(tmp_path / "none.yaml") == {}
    assert (
        recorded_yaml(Path(__file__).parents[1] / "old_runs" / "two_quads" / "arena.yaml")["name"]
        == "two_quads"
    )


def test_replay_does_not_use_the_addresses_of_flights() -> None:
    settings = ReplaySettings(name="lab", sources=["/a"], vehicles=VEHICLES, size_m=(7.0, 4.0, 3.0))
    for address in ("127.0.0.1", "127.0.0.9"):
        with pytest.raises(InputError, match="addresses of flights"):
            make_replay_plan(settings, address)
    assert make_replay_plan(settings, "127.0.78.1").address == "127.0.78.1"
