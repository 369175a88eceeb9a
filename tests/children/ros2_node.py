"""A ROS 2 node without ROS, with message types of its own: flies two vehicles by ROS 2 topics and prints what it has received as JSON.

uav1 is flown by geometry_msgs and texts, and landed by a text. uav2 is flown by px4_msgs, as in PX4's offboard examples; at its
target the node stops sending, so the offboard failsafe must land it. Usage: ros2_node.py DOMAIN
"""

import json
import sys
import time
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, uint8, uint16, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

LIMIT_S = 150.0
GEOMETRY, PX4 = "geometry_msgs::msg::dds_::", "px4_msgs::msg::dds_::"


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename=f"{GEOMETRY}Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename=f"{GEOMETRY}Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename=f"{GEOMETRY}Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename=f"{GEOMETRY}PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dataclass
class VehicleOdometry(IdlStruct, typename=f"{PX4}VehicleOdometry_"):
    timestamp: uint64
    timestamp_sample: uint64
    pose_frame: uint8
    position: array[float32, 3]
    q: array[float32, 4]
    velocity_frame: uint8
    velocity: array[float32, 3]
    angular_velocity: array[float32, 3]
    position_variance: array[float32, 3]
    orientation_variance: array[float32, 3]
    velocity_variance: array[float32, 3]
    reset_counter: uint8
    quality: int8


@dataclass
class OffboardControlMode(IdlStruct, typename=f"{PX4}OffboardControlMode_"):
    timestamp: uint64
    position: bool
    velocity: bool
    acceleration: bool
    attitude: bool
    body_rate: bool
    thrust_and_torque: bool
    direct_actuator: bool


@dataclass
class TrajectorySetpoint(IdlStruct, typename=f"{PX4}TrajectorySetpoint_"):
    timestamp: uint64
    position: array[float32, 3]
    velocity: array[float32, 3]
    acceleration: array[float32, 3]
    jerk: array[float32, 3]
    yaw: float32
    yawspeed: float32


@dataclass
class VehicleCommand(IdlStruct, typename=f"{PX4}VehicleCommand_"):
    timestamp: uint64
    param1: float32
    param2: float32
    param3: float32
    param4: float32
    param5: float64
    param6: float64
    param7: float32
    command: uint32
    target_system: uint8
    target_component: uint8
    source_system: uint8
    source_component: uint16
    confirmation: uint8
    from_external: bool


class Node:
    """Node that keeps the newest message of each topic, and counts all."""

    def __init__(self, domain: int) -> None:
        self.participant = DomainParticipant(domain)
        self.newest: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.first_s: dict[str, float] = {}
        self.last_s: dict[str, float] = {}
        self._readers: dict[str, DataReader] = {}

    def writer(self, topic: str, kind: type) -> DataWriter:
        return DataWriter(self.participant, Topic(self.participant, f"rt{topic}", kind))

    def read(self, topic: str, kind: type, *, px4: bool = False) -> None:
        reliability = (
            Policy.Reliability.BestEffort if px4 else Policy.Reliability.Reliable(max_blocking_time=0)
        )
        durability = Policy.Durability.TransientLocal if px4 else Policy.Durability.Volatile
        qos = Qos(reliability, durability, Policy.History.KeepLast(500))
        self._readers[topic] = DataReader(
            self.participant, Topic(self.participant, f"rt{topic}", kind), qos=qos
        )

    def spin(self) -> None:
        for topic, reader in self._readers.items():
            for sample in reader.take(N=500):
                if sample.sample_info.valid_data:
                    self.newest[topic] = sample
                    self.counts[topic] = self.counts.get(topic, 0) + 1
                    self.first_s.setdefault(topic, time.monotonic())
                    self.last_s[topic] = time.monotonic()


class Pilot:
    """Flies one vehicle: 1 m up and 0.5 m to the east, then lands it if `ask` has a request for it.

    send: sends a setpoint to a place [ENU]. ask: text -> request.
    """

    def __init__(self, node: Node, name: str, send: Any, ask: dict[str, Any]) -> None:
        self.node, self.name, self.send, self.ask = node, name, send, ask
        self.start: list[float] = []
        self.reached: list[float] = []
        self.asked = 0.0
        self.down = False

    def step(self, now: float) -> None:
        place, mode, armed, landed = read_state(self.node, self.name)
        if place is None or not mode:
            return
        self.start = self.start or place
        target = [self.start[0] + 0.5, self.start[1], self.start[2] + 1.0]
        if not self.reached:
            self.send(target)
            if armed and sum((a - b) ** 2 for a, b in zip(place, target, strict=True)) < 0.15**2:
                self.reached = place
        self.down = bool(self.reached) and landed and not armed
        if now - self.asked > 1.0 and (request := self.request(mode, armed)):
            self.asked = now
            self.ask[request]()

    def request(self, mode: str, armed: bool) -> str:
        """Return the request that is due, or ""."""
        if self.reached:
            return "land" if armed and mode != "AUTO.LAND" and "land" in self.ask else ""
        return "offboard" if mode != "OFFBOARD" else "" if armed else "arm"


def geometry_pilot(node: Node, name: str) -> Pilot:
    pose = node.writer(f"/{name}/setpoint/pose", PoseStamped)
    text = node.writer(f"/{name}/command", String)
    facing_north = Quaternion(0.0, 0.0, 0.5**0.5, 0.5**0.5)

    def send(target: list[float]) -> None:
        pose.write(PoseStamped(Header(Time(0, 0), "map"), Pose(Point(*target), facing_north)))

    words = ("offboard", "arm", "land")
    return Pilot(node, name, send, {word: lambda word=word: text.write(String(word)) for word in words})


def px4_pilot(node: Node, name: str, system_id: int) -> Pilot:
    control = node.writer(f"/{name}/fmu/in/offboard_control_mode", OffboardControlMode)
    trajectory = node.writer(f"/{name}/fmu/in/trajectory_setpoint", TrajectorySetpoint)
    command = node.writer(f"/{name}/fmu/in/vehicle_command", VehicleCommand)
    nan = [float("nan")] * 3

    def send(target: list[float]) -> None:
        east, north, up = target
        control.write(OffboardControlMode(0, True, False, False, False, False, False, False))
        trajectory.write(TrajectorySetpoint(0, [north, east, -up], nan, nan, nan, 0.0, float("nan")))

    def ask(number: int, *params: float) -> None:
        all_params = [*params, *[0.0] * (7 - len(params))]
        command.write(VehicleCommand(0, *all_params, number, system_id, 1, system_id, 1, 0, True))

    requests = {"offboard": lambda: ask(176, 1.0, 6.0), "arm": lambda: ask(400, 1.0)}
    return Pilot(node, name, send, requests)


def main(domain: int) -> int:
    node = Node(domain)
    node.read("/clock", Clock)
    for name in ("uav1", "uav2"):
        node.read(f"/{name}/pose", PoseStamped)
        node.read(f"/{name}/mocap/pose", PoseStamped)
        node.read(f"/{name}/mode", String)
        node.read(f"/{name}/armed", Bool)
        node.read(f"/{name}/landed", Bool)
        node.read(f"/{name}/fmu/out/vehicle_odometry", VehicleOdometry, px4=True)
    pilots = [geometry_pilot(node, "uav1"), px4_pilot(node, "uav2", 2)]
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        node.spin()
        for pilot in pilots:
            pilot.step(time.monotonic())
        if all(pilot.down for pilot in pilots):
            print(json.dumps(report(node, pilots)), flush=True)
            return 0
        time.sleep(0.04)
    print(f"not landed: {[(p.name, p.start, p.reached) for p in pilots]} {node.counts}", file=sys.stderr)
    return 1


def read_state(node: Node, name: str) -> tuple[list[float] | None, str, bool, bool]:
    """Return position [ENU], mode, armed, landed."""
    pose, mode = node.newest.get(f"/{name}/pose"), node.newest.get(f"/{name}/mode")
    armed, landed = node.newest.get(f"/{name}/armed"), node.newest.get(f"/{name}/landed")
    place = None if pose is None else [pose.pose.position.x, pose.pose.position.y, pose.pose.position.z]
    return place, mode.data if mode else "", bool(armed and armed.data), bool(landed and landed.data)


def report(node: Node, pilots: list[Pilot]) -> dict[str, Any]:
    odometry = node.newest["/uav1/fmu/out/vehicle_odometry"]
    pose, captured = node.newest["/uav1/pose"], node.newest["/uav1/mocap/pose"]
    clock = node.newest["/clock"].clock
    return {
        "counts": node.counts,
        "rates": {
            topic: (node.counts[topic] - 1) / max(node.last_s[topic] - node.first_s[topic], 1e-9)
            for topic in node.counts
        },
        "reached": {p.name: p.reached for p in pilots},
        "start": {p.name: p.start for p in pilots},
        "frame": pose.header.frame_id,
        "stamp_s": pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec,
        "clock_s": clock.sec + 1e-9 * clock.nanosec,
        "pose": [pose.pose.position.x, pose.pose.position.y, pose.pose.position.z],
        "mocap": [captured.pose.position.x, captured.pose.position.y, captured.pose.position.z],
        "ned": list(odometry.position),
    }


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
