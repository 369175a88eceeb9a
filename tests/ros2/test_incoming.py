"""Setpoints and commands from ROS 2: conversion of frames, and the rules that keep a wrong or old one from a vehicle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import (
    ned_from_world,
    q_nb_from_q_wf,
    q_wf_from_q_nb,
    quat_from_euler,
    world_from_ned,
    yaw_from_quat,
)
from arena.ros2.bridge import VehicleBridge
from arena.ros2.dds import Sample
from arena.ros2.incoming import MAX_AGE_S, Incoming
from arena.ros2.messages import message
from arena.wire.telemetry_values import HeartbeatState

NAN = math.nan


def core() -> Incoming:
    return Incoming("uav2", 2)


def sample(name: str, age_s: float = 0.01, **fields: Any) -> Sample:
    return Sample(message=message(name, **fields), age_s=age_s)


def pose(frame: str = "map", age_s: float = 0.01, p=(1.0, 2.0, 3.0), q=(0.0, 0.0, 0.0, 1.0)) -> Sample:
    x, y, z, w = q
    return sample(
        "geometry_msgs/PoseStamped",
        age_s,
        header={"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame},
        pose={
            "position": dict(zip("xyz", p, strict=True)),
            "orientation": {"x": x, "y": y, "z": z, "w": w},
        },
    )


def velocity(frame: str = "map", v=(1.0, 2.0, 0.5), rate: float = 0.3) -> Sample:
    twist = {"linear": dict(zip("xyz", v, strict=True)), "angular": {"x": 0.0, "y": 0.0, "z": rate}}
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
    return sample("geometry_msgs/TwistStamped", header=header, twist=twist)


def trajectory(age_s: float = 0.01, **fields: Any) -> Sample:
    empty = {key: [NAN] * 3 for key in ("position", "velocity", "acceleration", "jerk")}
    return sample("px4_msgs/TrajectorySetpoint", age_s, **{**empty, "yaw": NAN, "yawspeed": NAN, **fields})


def mode(*keys: str, age_s: float = 0.01) -> Sample:
    return sample("px4_msgs/OffboardControlMode", age_s, **dict.fromkeys(keys, True))


def heartbeat(mode: str, *, armed: bool = True) -> HeartbeatState:
    return HeartbeatState(received_at=0.0, mode=mode, armed=armed)


def command(number: int, *params: float, target: int = 2) -> Sample:
    given = dict(zip((f"param{i}" for i in range(1, 8)), [*params, *[0.0] * 7], strict=False))
    return sample("px4_msgs/VehicleCommand", command=number, target_system=target, **given)


# -- frames


@pytest.mark.parametrize("rpy", [(0.17, -0.35, 0.61), (0.0, 0.0, 0.0), (0.0, 0.0, -2.5)])
def test_pose_in_enu_becomes_a_position_in_ned_and_a_yaw_from_north(rpy):
    q_nb = quat_from_euler(np.array(rpy))
    w, x, y, z = q_wf_from_q_nb(q_nb)
    (made,) = core().on_pose(pose(p=(1.0, 2.0, 3.0), q=(x, y, z, w)), 0.0)
    assert (made.x, made.y, made.z) == (2.0, 1.0, -3.0) and made.target_system == 2
    assert made.yaw == pytest.approx(float(yaw_from_quat(q_nb))) and made.type_mask & 0x7 == 0


def test_heading_east_in_ros_is_a_yaw_of_90_degrees():
    (made,) = core().on_pose(pose(q=(0.0, 0.0, 0.0, 1.0)), 0.0)
    assert made.yaw == pytest.approx(math.pi / 2)


def test_velocity_in_enu_becomes_a_velocity_in_ned_and_turns_to_the_same_side():
    (made,) = core().on_velocity(velocity(), 0.0)
    assert (made.vx, made.vy, made.vz) == (2.0, 1.0, -0.5) and made.yaw_rate == pytest.approx(-0.3)
    assert made.type_mask & 0x7 == 0x7 and made.type_mask & 0x38 == 0


def test_conversions_are_inverse():
    v = np.array([1.0, -2.0, 0.5])
    q = quat_from_euler(np.array([0.17, -0.35, 0.61]))
    assert np.allclose(ned_from_world(world_from_ned(v)), v)
    assert np.allclose(q_nb_from_q_wf(q_wf_from_q_nb(q)), q) or np.allclose(
        q_nb_from_q_wf(q_wf_from_q_nb(q)), -q
    )


def test_trajectory_setpoint_stays_in_ned():
    c = core()
    c.on_control_mode(mode("position"), 1.0)
    (made,) = c.on_trajectory(trajectory(position=[1.0, 2.0, -3.0], velocity=[0.1, 0.2, 0.3], yaw=0.5), 1.1)
    assert (made.x, made.y, made.z, made.vx, made.vy, made.vz) == (1.0, 2.0, -3.0, 0.1, 0.2, 0.3)
    assert made.yaw == 0.5 and made.type_mask == 0x1C0 | 0x800


# -- what is not sent


@pytest.mark.parametrize("frame", ["odom", "", "uav2/base_link", "map_ned"])
def test_setpoint_in_another_frame_is_dropped(frame):
    c = core()
    assert c.on_pose(pose(frame), 0.0) == [] == c.on_velocity(velocity(frame), 0.0)
    assert c.dropped == {"in a frame other than map": 2}


@pytest.mark.parametrize("age_s", [MAX_AGE_S + 0.01, 10.0, -MAX_AGE_S - 0.01])
def test_old_message_is_dropped(age_s):
    c = core()
    assert c.on_pose(pose(age_s=age_s), 0.0) == []
    c.on_control_mode(mode("position", age_s=age_s), 0.0)
    assert c.on_trajectory(trajectory(position=[0.0, 0.0, -1.0]), 0.0) == []
    assert c.on_command(sample("std_msgs/String", age_s, data="arm"), 0.0) == []
    assert sum(c.dropped.values()) == 4


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (NAN, 0.0, 0.0, 1.0)])
def test_pose_without_an_orientation_is_dropped(q):
    assert core().on_pose(pose(q=q), 0.0) == []


@pytest.mark.parametrize("value", [NAN, math.inf])
def test_setpoint_that_is_not_finite_is_dropped(value):
    c = core()
    assert (
        c.on_pose(pose(p=(0.0, value, 1.0)), 0.0) == [] == c.on_velocity(velocity(v=(0.0, value, 0.0)), 0.0)
    )
    c.on_control_mode(mode("position"), 0.0)
    assert c.on_trajectory(trajectory(position=[0.0, value, -1.0]), 0.0) == []


def test_trajectory_needs_a_fresh_control_mode():
    c, setpoint = core(), trajectory(position=[0.0, 0.0, -1.0])
    assert c.on_trajectory(setpoint, 1.0) == []
    c.on_control_mode(mode("position"), 1.0)
    assert len(c.on_trajectory(setpoint, 1.4)) == 1
    assert c.on_trajectory(setpoint, 1.6) == []


def test_control_mode_alone_sends_nothing():
    c = core()
    assert c.on_control_mode(mode("position"), 0.0) is None and not c.dropped


@pytest.mark.parametrize("key", ["attitude", "body_rate", "thrust_and_torque", "direct_actuator"])
def test_trajectory_is_dropped_in_control_modes_that_do_not_use_it(key):
    c = core()
    c.on_control_mode(mode(key), 0.0)
    assert c.on_trajectory(trajectory(position=[0.0, 0.0, -1.0]), 0.0) == []


def test_position_is_ignored_in_velocity_mode():
    c = core()
    c.on_control_mode(mode("velocity"), 0.0)
    (made,) = c.on_trajectory(trajectory(position=[5.0, 5.0, -5.0], velocity=[0.1, 0.0, 0.0]), 0.0)
    assert made.type_mask & 0x7 == 0x7 and (made.x, made.y, made.z) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("target", [1, 3, 255])
def test_command_for_another_vehicle_is_dropped(target):
    c = core()
    assert c.on_px4_command(command(400, 1.0, target=target), 0.0) == [] and sum(c.dropped.values()) == 1


def place(number: int, lat: float, lon: float) -> Any:
    """Return the message of a command with a place: param5 and param6."""
    (made,) = core().on_px4_command(command(number, -1.0, 1.0, 0.0, NAN, lat, lon, 491.5), 0.0)
    return made


@pytest.mark.parametrize("number", [17, 21, 22, 34, 179, 192, 195])
def test_place_of_a_command_is_rounded_to_less_than_2_cm(number):
    lat, lon = 47.39774214, 8.54559433
    made = place(number, lat, lon)
    assert isinstance(made, mavlink.MAVLink_command_int_message)
    assert (made.target_system, made.target_component, made.frame) == (2, 1, mavlink.MAV_FRAME_GLOBAL)
    sent = decoded(made)
    assert sent.command == number and (sent.param1, sent.param2, sent.z) == (-1.0, 1.0, 491.5)
    assert math.isnan(sent.param4)
    assert abs(sent.x * 1e-7 - lat) * 111_320.0 < 0.02 and abs(sent.y * 1e-7 - lon) * 111_320.0 < 0.02


@pytest.mark.parametrize(
    ("number", "lat", "lon"),
    [
        (22, NAN, NAN),
        (192, 47.0, NAN),
        (192, math.inf, 8.0),
        (192, 91.0, 8.0),
        (192, 47.0, -180.1),
        (400, 47.0, 8.0),
        (187, 0.5, 0.5),
    ],
)
def test_command_without_a_place_stays_a_command_long(number, lat, lon):
    made = place(number, lat, lon)
    assert isinstance(made, mavlink.MAVLink_command_long_message)
    assert (made.param5, made.param6) == pytest.approx((lat, lon), nan_ok=True)


def test_landing_at_a_place_is_no_takeover():
    c = core()
    c.on_pose(pose(), 0.9)
    c.on_heartbeat(heartbeat("OFFBOARD"), 0.9)
    assert c.on_px4_command(command(21, 0.0, 0.0, 0.0, NAN, 47.0, 8.0, NAN), 1.0)
    c.on_heartbeat(heartbeat("AUTO.LAND"), 1.5)
    assert not c.lost


def decoded(made: mavlink.MAVLink_message) -> Any:
    """Return the message as a receiver decodes it, after the rounding of its fields."""
    (found,) = mavlink.MAVLink(None).parse_buffer(made.pack(mavlink.MAVLink(None, srcSystem=1)))
    return found


@pytest.mark.parametrize("target", [0, 2])
def test_command_reaches_only_its_vehicle(target):
    (made,) = core().on_px4_command(command(400, 1.0, 21196.0, target=target), 0.0)
    assert isinstance(made, mavlink.MAVLink_command_long_message)
    assert (made.target_system, made.command, made.param1, made.param2) == (2, 400, 1.0, 21196.0)


@pytest.mark.parametrize(
    ("text", "number", "params"),
    [
        ("arm", 400, (1.0, 0.0)),
        ("disarm", 400, (0.0, 0.0)),
        ("offboard", 176, (1.0, 6.0)),
        ("Land ", 176, (1.0, 4.0)),
    ],
)
def test_texts_become_commands(text, number, params):
    (made,) = core().on_command(sample("std_msgs/String", data=text), 0.0)
    assert (made.command, made.param1, made.param2) == (number, *params)


def test_unknown_text_is_reported():
    c = core()
    assert c.on_command(sample("std_msgs/String", data="fly"), 0.0) == []
    assert "expected one of arm, disarm, offboard, land, hold" in c.events[0]


# -- takeover


def flying() -> Incoming:
    c = core()
    assert c.on_pose(pose(), 0.0)
    c.on_heartbeat(heartbeat("OFFBOARD"), 0.5)
    return c


@pytest.mark.parametrize(
    "taken", [heartbeat("POSCTL"), heartbeat("AUTO.LAND"), heartbeat("OFFBOARD", armed=False)]
)
def test_setpoints_are_dropped_after_a_takeover_even_if_offboard_returns(taken):
    c = flying()
    c.on_heartbeat(taken, 1.0)
    assert "ROS 2 has lost control of the vehicle" in c.events[0]
    for mode in ("POSCTL", "OFFBOARD"):
        c.on_heartbeat(heartbeat(mode), 2.0)
        assert c.on_pose(pose(), 2.0) == [] == c.on_velocity(velocity(), 2.0)


def test_request_for_offboard_ends_the_takeover():
    c = flying()
    c.on_heartbeat(heartbeat("POSCTL"), 1.0)
    assert c.on_command(sample("std_msgs/String", data="arm"), 1.5) and c.on_pose(pose(), 1.5) == []
    assert c.on_px4_command(command(176, 1.0, 6.0), 2.0) and len(c.on_pose(pose(), 2.0)) == 1


def test_landing_on_command_of_ros_is_no_takeover():
    c = flying()
    c.on_command(sample("std_msgs/String", data="land"), 1.0)
    c.on_heartbeat(heartbeat("AUTO.LAND"), 1.5)
    assert not c.lost and not c.events


@pytest.mark.parametrize("text", ["arm", "offboard"])
def test_takeover_right_after_a_command_that_does_not_leave_offboard_is_found(text):
    c = flying()
    c.on_command(sample("std_msgs/String", data=text), 1.0)
    c.on_heartbeat(heartbeat("POSCTL"), 1.5)
    assert c.lost


def test_vehicle_that_another_program_flies_is_not_reported():
    c = core()
    c.on_heartbeat(heartbeat("OFFBOARD"), 0.0)
    c.on_heartbeat(heartbeat("AUTO.LAND"), 1.0)
    assert not c.lost and not c.events


class Topics:
    """Stands for the DDS participant: readers return the samples that a test has put there."""

    def __init__(self) -> None:
        self.samples: dict[str, list[Sample]] = {}

    def writer(self, topic: str, kind: str, *, px4: bool = False):
        return lambda message: None

    def reader(self, topic: str, kind: str, *, depth: int):
        return lambda: self.samples.pop(topic, [])[-depth:]


@pytest.mark.parametrize(
    ("topic", "given"),
    [
        ("setpoint/pose", pose(p=(1e300, 0.0, 1.0))),
        ("setpoint/velocity", velocity(v=(1e39, 0.0, 0.0))),
        ("fmu/in/vehicle_command", sample("px4_msgs/VehicleCommand", command=100000, target_system=2)),
        ("fmu/in/vehicle_command", sample("px4_msgs/VehicleCommand", command=400, param5=1e300)),
    ],
)
def test_value_that_mavlink_cannot_contain_is_dropped(topic, given):
    """The bridge of all vehicles must not end because of one message."""
    topics = Topics()
    row = {"name": "uav2", "id": 2, "body": "uav2", "tools": ["127.0.0.1", 9], "px4_msgs": True}
    bridge = VehicleBridge(row, topics, setpoints=True, rate_hz=30.0)  # type: ignore[arg-type]
    topics.samples[f"/uav2/{topic}"] = [given]
    bridge.poll(1.0, 1.0)
    bridge.close()
    assert sum(bridge.incoming.dropped.values()) == 1


def test_every_command_is_sent_but_only_the_newest_setpoint():
    topics = Topics()
    row = {"name": "uav2", "id": 2, "body": "uav2", "tools": ["127.0.0.1", 9], "px4_msgs": True}
    bridge = VehicleBridge(row, topics, setpoints=True, rate_hz=30.0)  # type: ignore[arg-type]
    sent = []
    bridge._send = sent.append  # type: ignore[method-assign]
    topics.samples["/uav2/command"] = [sample("std_msgs/String", data=word) for word in ("offboard", "arm")]
    topics.samples["/uav2/setpoint/pose"] = [pose(p=(0.0, 0.0, 1.0)), pose(p=(0.0, 0.0, 2.0))]
    bridge.poll(1.0, 1.0)
    bridge.close()
    commands = [m.command for m in sent if m.get_type() == "COMMAND_LONG"]
    assert commands == [176, 400]  # DO_SET_MODE, COMPONENT_ARM_DISARM
    assert [m.z for m in sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"] == [-2.0]
