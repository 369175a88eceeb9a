"""Tools with readiness, and the tools that arena knows by name: the bridge to ROS 2 and the agent of PX4's ROS 2 topics."""

from __future__ import annotations

import re
import sys

import pytest

from arena.errors import InputError
from arena.plan import make_plan
from arena.plan.machine import Machine, check_machine
from arena.schema import load_arena

from .machines import FreePorts

VEHICLES = """
vehicles:
  uav1: {autopilot: builtin, program: {path: fly.py%s}}
  uav2: {autopilot: px4, start: {position: [1, 0, 0]}}
px4: {home: stand-in}
"""


def arena_of(folder, tools: str, program: str = "", *sets: str):
    (folder / "fly.py").touch()
    (folder / "arena.yaml").write_text(VEHICLES % program + tools)
    return load_arena(folder / "arena.yaml", sets)


def plan_of(folder, tools: str, program: str = "", *sets: str):
    return make_plan(arena_of(folder, tools, program, *sets), sys.executable)


def process(plan, name: str):
    return next(p for p in plan.processes if p.name == name)


@pytest.mark.parametrize(
    ("ready", "fields"),
    [
        ("{log: 'is (up|ready)'}", ("log", 0, "is (up|ready)", 30.0)),
        ("{port: 8888, timeout_s: 5}", ("port", 8888, "", 5.0)),
        ("{file: '{run}/bag/metadata.yaml'}", ("file", 0, "{run}/bag/metadata.yaml", 30.0)),
        ("{delay_s: 1.5}", ("delay", 0, "1.5", 31.5)),
    ],
)
def test_readiness_of_a_tool(tmp_path, ready, fields):
    spec = process(plan_of(tmp_path, f"tools: {{bag: {{argv: ['true'], ready: {ready}}}}}"), "tool.bag")
    assert (spec.ready, spec.ready_port, spec.ready_value, spec.start_timeout_s) == fields


def test_file_is_relative_to_the_folder_of_the_tool(tmp_path):
    spec = process(plan_of(tmp_path, "tools: {bag: {argv: ['true'], cwd: x, ready: {file: up}}}"), "tool.bag")
    assert spec.ready_value == str(tmp_path / "x" / "up")


@pytest.mark.parametrize(
    ("ready", "said"),
    [
        ("{}", "got none, expected exactly one of log, port, file and delay_s"),
        ("{port: 1, log: x}", "got log and port"),
        ("{log: '('}", "expected a regular expression"),
        ("{file: '{nme}'}", "no placeholder"),
    ],
)
def test_wrong_readiness_is_refused(tmp_path, ready, said):
    with pytest.raises(InputError, match=said):
        arena_of(tmp_path, f"tools: {{bag: {{argv: ['true'], ready: {ready}}}}}")


def test_program_needs_a_tool(tmp_path):
    plan = plan_of(tmp_path, "tools: {bag: {argv: ['true']}}", ", needs: [tool.bag]")
    assert "tool.bag" in process(plan, "program.uav1").needs
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert "tool.bag" in process(make_plan(load_arena(again / "arena.yaml")), "program.uav1").needs


@pytest.mark.parametrize(
    ("need", "hint"), [("tool.bga", "Did you mean tool.bag"), ("world", "Known: tool.bag")]
)
def test_program_cannot_need_another_process(tmp_path, need, hint):
    with pytest.raises(InputError, match=hint):
        plan_of(tmp_path, "tools: {bag: {argv: ['true']}}", f", needs: [{need}]")


# -- the bridge to ROS 2


def test_bridge_runs_beside_the_arena_and_nothing_needs_it(tmp_path):
    plan = plan_of(tmp_path, "tools: {ros2: true}")
    spec = process(plan, "tool.ros2")
    assert spec.argv == (sys.executable, "-m", "arena.ros2", "{run}/slices/ros2.json")
    assert spec.ready == "reported" and not spec.outlives and "router" in spec.needs
    assert not any("tool.ros2" in p.needs for p in plan.processes)
    assert "ros2.json" not in plan_of(tmp_path, "").slices


def test_bridge_takes_no_setpoints_and_stays_on_loopback_by_default(tmp_path):
    made = plan_of(tmp_path, "tools: {ros2: true}").slices["ros2.json"]
    assert (made["setpoints"], made["address"], made["domain"]) == (False, "127.0.0.1", 0)


def test_settings_of_the_bridge(tmp_path):
    text = "tools: {ros2: {domain: 5, address: 10.0.0.7, rate_hz: 50, setpoints: true}}"
    plan = plan_of(tmp_path, text)
    made = plan.slices["ros2.json"]
    assert (made["setpoints"], made["address"], made["domain"], made["rate_hz"]) == (
        True,
        "10.0.0.7",
        5,
        50.0,
    )
    assert [(v["name"], v["id"], v["tools"][1]) for v in made["vehicles"]] == [
        ("uav1", 1, 24016),
        ("uav2", 2, 24026),
    ]
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert make_plan(load_arena(again / "arena.yaml")).slices["ros2.json"] == made


@pytest.mark.parametrize(
    ("keys", "said"),
    [("{domian: 5}", "domian"), ("{domain: 233}", "232"), ("{rate_hz: 0}", "rate_hz")],
)
def test_wrong_settings_of_the_bridge_are_refused(tmp_path, keys, said):
    with pytest.raises(InputError, match=said):
        arena_of(tmp_path, f"tools: {{ros2: {keys}}}")


def test_missing_package_is_reported_before_the_start(tmp_path):
    class Bare(FreePorts):
        def has_module(self, name):
            return name != "cyclonedds" and super().has_module(name)

    arena = arena_of(tmp_path, "tools: {ros2: true}")
    with pytest.raises(InputError, match=r"pip install 'flying-arena\[ros2\]'"):
        check_machine(arena, make_plan(arena), Bare())


# -- the agent


def test_agent_starts_at_once_and_serves_every_px4_in_a_namespace_of_its_own(tmp_path):
    plan = plan_of(tmp_path, "tools: {microxrce: {port: 9999, domain: 5}}")
    spec = process(plan, "tool.microxrce")
    assert spec.argv == ("MicroXRCEAgent", "udp4", "-p", "9999") and spec.needs == ()
    assert (spec.ready, spec.ready_port, spec.restart.mode) == ("port", 9999, "on_failure")
    assert dict(spec.env)["ROS_DOMAIN_ID"] == "5"
    env = plan.slices["px4.uav2.json"]["env"]
    assert env == {"PX4_UXRCE_DDS_NS": "uav2", "PX4_UXRCE_DDS_PORT": "9999", "ROS_DOMAIN_ID": "5"}
    assert plan_of(tmp_path, "").slices["px4.uav2.json"]["env"] == {}


def test_bridge_leaves_the_topics_of_px4_to_the_agent(tmp_path):
    made = plan_of(tmp_path, "tools: {microxrce: true, ros2: true}").slices["ros2.json"]["vehicles"]
    assert [v["px4_msgs"] for v in made] == [True, False]


def test_missing_agent_is_reported_with_how_to_get_it(tmp_path):
    class Bare(FreePorts):
        def has_command(self, name, folder):
            return False

    arena = arena_of(tmp_path, "tools: {microxrce: true}")
    with pytest.raises(InputError, match=r"'MicroXRCEAgent' was not found.*Micro-XRCE-DDS-Agent"):
        check_machine(arena, make_plan(arena), Bare())


# -- MAVROS, the bag recorder and QGroundControl


class Bare(FreePorts):
    """Computer with the given commands and ROS 2 packages only."""

    def __init__(self, *found: str) -> None:
        self.found = found

    def has_command(self, name, folder):
        return name in self.found

    def has_ros_package(self, name):
        return name in self.found


def test_mavros_is_connected_to_the_tools_port_of_its_vehicle(tmp_path):
    plan = plan_of(tmp_path, "defaults: {tools: {mavros: true}}", "", "address=127.0.0.1")
    spec = process(plan, "tool.uav2.mavros")
    assert spec.argv == (
        *("ros2", "launch", "mavros", "px4.launch", "fcu_url:=udp://127.0.0.1:0@127.0.0.1:24026/"),
        *("gcs_url:=", "tgt_system:=2", "namespace:=uav2/mavros"),
    )
    assert (spec.ready, spec.restart.mode, spec.needs) == ("log", "on_failure", ("router",))
    assert re.search(
        spec.ready_value, "[INFO] [uav1.mavros.mavros]: CON: Got HEARTBEAT, connected. FCU: PX4 Autopilot"
    )
    assert "ROS_DOMAIN_ID" not in dict(spec.env)


def test_settings_of_mavros(tmp_path):
    keys = "{namespace: 'lab/{name}', launch: /opt/lab/mavros.launch.py, domain: 3}"
    plan = plan_of(tmp_path, f"defaults: {{tools: {{mavros: {keys}}}}}")
    spec = process(plan, "tool.uav1.mavros")
    assert spec.argv[:3] == ("ros2", "launch", "/opt/lab/mavros.launch.py")
    assert spec.argv[-1] == "namespace:=lab/uav1" and dict(spec.env)["ROS_DOMAIN_ID"] == "3"
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert process(make_plan(load_arena(again / "arena.yaml")), "tool.uav1.mavros").argv == spec.argv


def test_one_vehicle_can_be_without_mavros(tmp_path):
    (tmp_path / "arena.yaml").write_text(
        "defaults: {autopilot: builtin, tools: {mavros: true}}\n"
        "vehicles: {uav1: {tools: {mavros: false}}, uav2: {start: {position: [1, 0, 0]}}}\n"
    )
    names = [p.name for p in make_plan(load_arena(tmp_path / "arena.yaml")).processes if p.kind == "tool"]
    assert names == ["tool.uav2.mavros"]


def test_bag_recorder_records_all_topics_from_the_start(tmp_path):
    spec = process(plan_of(tmp_path, "tools: {bag: true, ros2: {domain: 5}}"), "tool.bag")
    assert spec.argv == ("ros2", "bag", "record", "-o", "{run}/bag", "-a")
    assert (spec.needs, spec.restart.mode, spec.ready) == ((), "never", "log")
    assert all(re.search(spec.ready_value, line) for line in ("Recording...", "Listening for topics..."))
    assert dict(spec.env)["ROS_DOMAIN_ID"] == "5"


def test_settings_of_the_bag_recorder(tmp_path):
    text = "tools: {microxrce: {domain: 4}, bag: {topics: [/uav1/pose, /clock], storage: mcap, domain: 6}}"
    spec = process(plan_of(tmp_path, text), "tool.bag")
    assert spec.argv[4:] == ("{run}/bag", "-s", "mcap", "--regex", "^(/uav1/pose|/clock)$")
    assert dict(spec.env)["ROS_DOMAIN_ID"] == "6"


def test_qgroundcontrol_is_ready_at_its_port(tmp_path):
    spec = process(
        plan_of(tmp_path, "tools: {qgroundcontrol: {command: ./QGC.AppImage}}"), "tool.qgroundcontrol"
    )
    assert spec.argv == ("./QGC.AppImage",) and (spec.ready, spec.ready_port) == ("port", 14550)
    spec = process(plan_of(tmp_path, "tools: {qgroundcontrol: true}"), "tool.qgroundcontrol")
    assert spec.argv == ("QGroundControl.AppImage",) and spec.restart.mode == "never"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tools: {mavros: true}", "mavros belongs to a vehicle. Write it under `defaults: {tools: ...}`"),
        ("defaults: {tools: {bag: true}}", "bag serves the whole arena. Write it under `tools`"),
        ("tools: {bag: {topics: [pose]}}", "topics"),
        ("tools: {bag: {topics: []}}", "topics"),
        ("tools: {bag: {topics: 5}}", "topics"),
        ("tools: {bag: {storage: zip}}", "storage"),
        ("tools: {qgroundcontrol: {port: 1}}", "port"),
        ("defaults: {tools: {mavros: {namespace: '{nme}'}}}", "no placeholder"),
        ("defaults: {tools: {mavros: {launch: 5}}}", "launch"),
    ],
)
def test_wrong_settings_of_known_tools_are_refused(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        arena_of(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "found", "said"),
    [
        ("tools: {bag: true}", (), r"tools\.bag: the command 'ros2' was not found.*Install ROS 2"),
        ("tools: {bag: true}", ("ros2",), r"tools\.bag: the ROS 2 package ros2bag was not found"),
        (
            "defaults: {tools: {mavros: true}}",
            ("ros2",),
            r"vehicles\.uav1\.tools\.mavros and 1 more: the ROS 2 package mavros was not found.*apt install ros-\$ROS_DISTRO-mavros",
        ),
        ("tools: {qgroundcontrol: true}", (), r"'QGroundControl.AppImage' was not found.*command: PATH"),
    ],
)
def test_missing_known_tool_is_one_line_before_the_start(tmp_path, text, found, said):
    arena = arena_of(tmp_path, text)
    with pytest.raises(InputError, match=said) as error:
        check_machine(arena, make_plan(arena), Bare(*found))
    assert len(str(error.value).splitlines()) == 1
    check_machine(arena, make_plan(arena), Bare("ros2", "ros2bag", "mavros", "QGroundControl.AppImage"))


def test_ros_packages_are_found_in_the_ament_index(tmp_path, monkeypatch):
    index = tmp_path / "ros" / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "mavros").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'ros'}")
    assert Machine().has_ros_package("mavros") and not Machine().has_ros_package("ros2bag")
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    assert not Machine().has_ros_package("mavros")


@pytest.mark.parametrize(("needs", "expected"), [("tool.bag", ["uav1"]), ("tool.uav1.mavros", [])])
def test_simulation_time_runs_while_a_program_waits_for_mavros(tmp_path, needs, expected):
    """MAVROS is ready when a heartbeat has arrived, so the world must not wait for the program before its first step."""
    text = "defaults: {tools: {mavros: true}}\ntools: {bag: true}"
    plan = plan_of(tmp_path, text, f", needs: [{needs}]", "sim.speed=max")
    assert plan.slices["world.json"]["expected"] == expected
