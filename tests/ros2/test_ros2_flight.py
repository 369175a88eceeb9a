"""Two vehicles that are flown from ROS 2 topics, by a node with message types of its own, and read by Fast DDS."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from end_to_end.flight import ROOT, Hangar

pytest.importorskip("cyclonedds")
DOMAIN = 20 + os.getpid() % 200
ARENA = f"""
name: ros2
defaults: {{autopilot: builtin}}
tools: {{ros2: {{domain: {DOMAIN}, setpoints: true}}}}
vehicles:
  uav1: {{start: {{position: [-1, 0.3, 0]}}}}
  uav2: {{start: {{position: [1, 0, 0]}}}}
"""
POSE, CLOCK = "geometry_msgs::msg::dds_::PoseStamped_", "rosgraph_msgs::msg::dds_::Clock_"
READ_S = "300"


def node_environment() -> dict[str, str]:
    """Return an environment in which a node takes part on the loopback interface, as ROS_LOCALHOST_ONLY does."""
    from arena.ros2.dds import CONFIGURATION_VARIABLE, configuration

    return {**os.environ, CONFIGURATION_VARIABLE: configuration("127.0.0.1")}


def fastdds_tool(folder: Path) -> Path | None:
    """Compile the program that reads topics with Fast DDS; None without its headers. FASTDDS_ROOT is another place than /."""
    root = Path(os.environ.get("FASTDDS_ROOT", "/"))
    include, lib = root / "usr/include", root / f"usr/lib/{os.uname().machine}-linux-gnu"
    if shutil.which("g++") is None or not (include / "fastdds/dds/domain/DomainParticipant.hpp").is_file():
        return None
    target = folder / "fastdds_tool"
    words = ["g++", "-O1", "-std=c++17", str(Path(__file__).with_name("fastdds_tool.cpp")), "-o", str(target)]
    words += ["-I", str(include), "-I", str(include / lib.name), "-L", str(lib), "-lfastrtps", "-lfastcdr"]
    words += [f"-Wl,-rpath,{lib}", f"-Wl,-rpath-link,{lib}", "-Wl,--allow-shlib-undefined"]
    made = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert made.returncode == 0, made.stderr
    return target


class Readers:
    """Processes that read topics with Fast DDS, and print one line of hexadecimal digits per sample."""

    def __init__(self, tool: Path) -> None:
        self._tool = tool
        self._running: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}

    def read(self, topic: str, kind: str, *quality: str) -> None:
        root = os.environ.get("FASTDDS_ROOT", "")
        libraries = {"LD_LIBRARY_PATH": f"{root}/usr/lib/{os.uname().machine}-linux-gnu"} if root else {}
        out = Path(tempfile.mkstemp(dir=self._tool.parent)[1])
        with out.open("wb") as file:
            process = subprocess.Popen(
                [str(self._tool), "read", str(DOMAIN), f"rt{topic}", kind, READ_S, *quality],
                stdout=file,
                env={**os.environ, **libraries},
            )
        self._running[topic] = process, out

    def samples(self, topic: str) -> list[bytes]:
        lines = self._running[topic][1].read_text().rpartition("\n")[0].splitlines()
        return [bytes.fromhex(line) for line in lines if line != "reading"]

    def close(self) -> None:
        for process, _ in self._running.values():
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict]:
    """Fly both vehicles from ROS 2, and return what was received and recorded."""
    folder = tmp_path_factory.mktemp("ros2")
    hangar = Hangar(folder, f"127.58.{os.getpid() % 250 + 1}.201")
    tool = fastdds_tool(folder)
    readers = Readers(tool) if tool else None
    try:
        if readers is not None:
            readers.read("/uav1/pose", POSE)
            readers.read("/clock", CLOCK)
            readers.read("/uav2/fmu/out/vehicle_status_v1", "px4_msgs::msg::dds_::VehicleStatus_", "px4")
        (folder / "arena.yaml").write_text(ARENA)
        flight = hangar.up(folder / "arena.yaml")
        node = subprocess.run(
            [sys.executable, str(ROOT / "tests/children/ros2_node.py"), str(DOMAIN)],
            env=node_environment(),
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert node.returncode == 0, node.stderr + flight.said()
        down = flight.cli("down", "--run", str(flight.folder))
        assert down.returncode == 0, down.stdout + down.stderr
        assert flight.wait(60) == 0, flight.said()
        yield {"node": json.loads(node.stdout), "flight": flight, "readers": readers}
    finally:
        if readers is not None:
            readers.close()
        hangar.close()


@pytest.mark.flight
def test_vehicles_fly_to_setpoints_from_ros_and_land(flown: dict) -> None:
    node, flight = flown["node"], flown["flight"]
    for name in ("uav1", "uav2"):
        moved = [b - a for a, b in zip(node["start"][name], node["reached"][name], strict=True)]
        assert moved == pytest.approx([0.5, 0.0, 1.0], abs=0.2)  # east, north, up
        seen = flight.verdict(name)
        assert 0.8 < seen["max_height_m"] < 1.6 and not seen["crashed"]
        assert seen["landed_p_n"][1] - node["start"][name][0] == pytest.approx(0.5, abs=0.3)
    assert flight.stats("tool.ros2")["vehicles"]["uav1"]["dropped"] == {}


@pytest.mark.flight
def test_offboard_failsafe_lands_a_vehicle_whose_node_stops_sending(flown: dict) -> None:
    said = flown["flight"].said()
    assert "uav2: ROS 2 has lost control of the vehicle: it left OFFBOARD and is now in AUTO.LAND" in said
    assert "uav1: ROS 2 has lost" not in said


@pytest.mark.flight
def test_node_receives_rates_and_contents(flown: dict) -> None:
    node = flown["node"]
    for name in ("uav1", "uav2"):
        for topic in ("pose", "mocap/pose", "fmu/out/vehicle_odometry"):
            assert 10.0 < node["rates"][f"/{name}/{topic}"] < 31.5, (topic, node["rates"])
        assert 0.5 < node["rates"][f"/{name}/mode"] < 3.0
    assert node["frame"] == "map" and abs(node["stamp_s"] - node["clock_s"]) < 1.0
    assert node["pose"] == pytest.approx(node["mocap"], abs=0.1)
    north, east, down = node["ned"]
    assert [east, north, -down] == pytest.approx(node["pose"], abs=0.05)


@pytest.mark.flight
@pytest.mark.fastdds
def test_fast_dds_reads_the_topics(flown: dict) -> None:
    readers = flown["readers"]
    if readers is None:
        pytest.skip("no headers of Fast DDS: install libfastrtps-dev, or set FASTDDS_ROOT")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PoseStamped"
    poses = [store.deserialize_cdr(data, kind) for data in readers.samples("/uav1/pose")]
    published = flown["flight"].stats("tool.ros2")["vehicles"]["uav1"]["published"]["pose"]
    assert 0.8 * published <= len(poses) <= published
    stamps = [p.header.stamp.sec + 1e-9 * p.header.stamp.nanosec for p in poses]
    gaps = [b - a for a, b in itertools.pairwise(stamps)]
    assert min(gaps) > 0.0 and 1.0 / 31.5 < sum(gaps) / len(gaps) < 0.1
    assert max(p.pose.position.z for p in poses) > 0.8 and poses[-1].pose.position.z < 0.3
    assert {p.header.frame_id for p in poses} == {"map"}
    clock = [
        store.deserialize_cdr(data, "rosgraph_msgs/msg/Clock").clock for data in readers.samples("/clock")
    ]
    times = [c.sec + 1e-9 * c.nanosec for c in clock]
    assert times == sorted(times) and times[-1] - times[0] > 5.0
    armed = {data[4 + 24] for data in readers.samples("/uav2/fmu/out/vehicle_status_v1")}
    assert armed == {1, 2}  # ARMING_STATE_DISARMED, ARMING_STATE_ARMED
