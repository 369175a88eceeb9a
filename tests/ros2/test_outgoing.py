"""Messages that the bridge publishes: values, frames, rates, and their bytes as another library writes them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.geometry import q_wf_from_q_nb, quat_conj, quat_from_euler, quat_rotate
from arena.ros2.messages import dds_topic, dds_type, fields, message
from arena.ros2.outgoing import NAV_STATES, TOPICS, Outgoing
from arena.wire.px4_mode import AUTO, MAIN
from arena.wire.telemetry import Telemetry
from arena.wire.telemetry_values import Attitude, Ground, HeartbeatState, Local, Status

Q_NB = quat_from_euler(np.radians([10.0, -20.0, 35.0]))
VEL = np.array([0.5, -0.3, 0.2])


def telemetry(boot_s: float = 1.0) -> Telemetry:
    made = Telemetry(2)
    made.local = Local(received_at=0.0, boot_s=boot_s, pos=np.array([1.0, 2.0, -3.0]), vel=VEL)
    made.attitude = Attitude(received_at=0.0, boot_s=boot_s, q_nb=Q_NB, ang_vel=np.array([0.1, 0.2, 0.3]))
    made.heartbeat = HeartbeatState(received_at=0.0, mode="OFFBOARD", armed=True)
    made.status = Status(received_at=0.0, prearm=True, battery=75.0)
    made.ground = Ground(received_at=0.0, landed=False)
    return made


def published(now: float = 12.25) -> dict:
    found = {}
    out = Outgoing("uav2", 2, found.__setitem__, 30.0)
    out.on_telemetry(telemetry(), now)
    out.on_pose((1.0, 2.0, -3.0), tuple(Q_NB), 5.0, now)
    out.on_ack(400, 0, (252, 191), now)
    return found


def test_every_topic_is_published_with_the_fields_of_its_message():
    found = published()
    assert set(found) == {t.name for t in TOPICS}
    for topic in TOPICS:
        assert list(found[topic.name]) == list(fields()[topic.message])


def test_pose_is_in_enu_with_the_body_in_flu():
    pose = published()["pose"]
    assert pose["header"] == {"stamp": {"sec": 12, "nanosec": 250_000_000}, "frame_id": "map"}
    assert pose["pose"]["position"] == {"x": 2.0, "y": 1.0, "z": 3.0}
    assert [pose["pose"]["orientation"][k] for k in "wxyz"] == pytest.approx(q_wf_from_q_nb(Q_NB).tolist())
    assert published()["mocap/pose"]["pose"] == pose["pose"]


def test_orientation_of_a_level_vehicle_facing_north_is_90_degrees_about_up():
    found = {}
    Outgoing("uav2", 2, found.__setitem__, 30.0).on_pose((0, 0, 0), (1.0, 0.0, 0.0, 0.0), 1.0, 1.0)
    q = found["mocap/pose"]["pose"]["orientation"]
    assert abs(q["w"] * math.sqrt(0.5) + q["z"] * math.sqrt(0.5)) == pytest.approx(1.0)


def test_twist_is_in_the_body_axes_of_ros():
    twist = published()["twist"]
    forward, right, down = quat_rotate(quat_conj(Q_NB), VEL)
    assert twist["header"]["frame_id"] == "uav2/base_link"
    assert [twist["twist"]["linear"][k] for k in "xyz"] == pytest.approx([forward, -right, -down])
    assert [twist["twist"]["angular"][k] for k in "xyz"] == pytest.approx([0.1, -0.2, -0.3])


def test_px4_messages_are_in_ned_and_frd():
    found = published()
    local, odometry = found["fmu/out/vehicle_local_position"], found["fmu/out/vehicle_odometry"]
    assert [local[k] for k in ("x", "y", "z", "vx", "vy", "vz")] == [1.0, 2.0, -3.0, *VEL.tolist()]
    assert (
        local["heading"] == pytest.approx(math.radians(35.0))
        and math.isnan(local["ax"])
        and local["xy_valid"]
    )
    assert (
        odometry["position"] == [1.0, 2.0, -3.0]
        and odometry["pose_frame"] == 1
        and odometry["velocity_frame"] == 1
    )
    assert found["fmu/out/vehicle_attitude"]["q"] == pytest.approx(Q_NB.tolist())
    status = found["fmu/out/vehicle_status_v1"]
    assert (status["arming_state"], status["nav_state"], status["system_id"]) == (2, 14, 2)
    assert found["fmu/out/battery_status"]["remaining"] == 0.75 == found["battery"]["percentage"]


def test_same_value_is_not_published_twice_and_the_rate_is_limited():
    count = []
    out = Outgoing("uav2", 2, lambda topic, _: count.append(topic), 10.0)
    for step in range(101):  # 1 s at 100 Hz
        out.on_telemetry(telemetry(boot_s=1.0 + step / 100), step / 100)
    assert count.count("pose") == 11 and count.count("mode") == 1
    out.on_telemetry(telemetry(boot_s=2.0), 3.0)
    assert count.count("pose") == 11


def test_unknown_battery_is_not_published():
    found, made = {}, telemetry()
    made.status = Status(received_at=0.0, prearm=True, battery=math.nan)
    Outgoing("uav2", 2, found.__setitem__, 30.0).on_telemetry(made, 1.0)
    assert "battery" not in found and "fmu/out/battery_status" not in found


def test_every_mode_of_px4_has_a_state():
    words = {m for m in MAIN.values() if m not in ("AUTO", "RATTITUDE")} | {
        f"AUTO.{s}" for s in AUTO.values()
    }
    assert words - {"AUTO.READY", "AUTO.VTOL_TAKEOFF"} <= set(NAV_STATES)


def test_names_follow_the_rules_of_ros():
    assert (
        dds_type("geometry_msgs/Pose") == "geometry_msgs::msg::dds_::Pose_"
        and dds_topic("/uav1/pose") == "rt/uav1/pose"
    )


def test_unknown_field_is_refused():
    with pytest.raises(KeyError, match="wheels"):
        message("std_msgs/Bool", wheels=1)


# -- against rosbags, which contains the definitions of ROS 2


STORE = pytest.importorskip("rosbags.typesys")


@pytest.mark.parametrize("name", [n for n in fields() if not n.startswith("px4_msgs/")])
def test_fields_are_those_of_ros(name):
    store = STORE.get_typestore(STORE.Stores.ROS2_HUMBLE)
    package, _, kind = name.partition("/")
    _, theirs = store.fielddefs[f"{package}/msg/{kind}"]
    assert [field for field, _ in theirs] == list(fields()[name])


@pytest.mark.parametrize("topic", [t for t in TOPICS if not t.px4], ids=lambda t: t.name)
def test_bytes_are_those_of_another_library(topic):
    pytest.importorskip("cyclonedds")
    from arena.ros2.dds import _instance, type_of

    data = published()[topic.name]
    written = _instance(type_of(topic.message), topic.message, data).serialize(use_version_2=False)
    store = STORE.get_typestore(STORE.Stores.ROS2_HUMBLE)
    package, _, kind = topic.message.partition("/")
    read = store.deserialize_cdr(written, f"{package}/msg/{kind}")
    assert bytes(store.serialize_cdr(read, f"{package}/msg/{kind}")).rstrip(b"\0") == written.rstrip(b"\0")
    values, sent = flat(as_dict(read)), flat(data)
    assert {key: values[key] for key in sent} == pytest.approx(sent, nan_ok=True)


def as_dict(value):
    if hasattr(value, "__dataclass_fields__"):
        return {k: as_dict(getattr(value, k)) for k in value.__dataclass_fields__ if k != "__msgtype__"}
    return value.tolist() if isinstance(value, np.ndarray) else value


def flat(value, path: str = "") -> dict:
    if isinstance(value, dict):
        return {k: v for key, each in value.items() for k, v in flat(each, f"{path}.{key}").items()}
    return {path: value} if isinstance(value, (int, float)) else {}
