"""Converts a vehicle's telemetry and motion capture poses to ROS 2 messages. Pure.

Frames: `map` is the arena's world (ENU), `NAME/base_link` the vehicle's body (FLU), as REP 103 and REP 105 define them. Messages of
px4_msgs are in NED and FRD, as PX4 publishes them. `arena.geometry` converts. Fields without a source in MAVLink are NaN or 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry import frd_from_flu, q_wf_from_q_nb, quat_conj, quat_rotate, world_from_ned, yaw_from_quat
from arena.ros2.incoming import WORLD_FRAME
from arena.ros2.messages import Message, message
from arena.wire.telemetry import Telemetry

PX4_OUT = "fmu/out"
_POSE_FRAME_NED, _VELOCITY_FRAME_NED = 1, 1
_ARMED, _DISARMED = 2, 1
NAV_STATES = {
    "MANUAL": 0,
    "ALTCTL": 1,
    "POSCTL": 2,
    "AUTO.MISSION": 3,
    "AUTO.LOITER": 4,
    "AUTO.RTL": 5,
    "ACRO": 10,
    "TERMINATION": 13,
    "OFFBOARD": 14,
    "STABILIZED": 15,
    "AUTO.TAKEOFF": 17,
    "AUTO.LAND": 18,
    "AUTO.FOLLOW_TARGET": 19,
    "AUTO.PRECLAND": 20,
    "ORBIT": 21,
}
"""Name of the flight mode -> nav_state in PX4's VehicleStatus."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """ROS 2 topic of a vehicle.

    name: relative to the vehicle's namespace. message: ROS 2 message. px4: message of px4_msgs, with PX4's quality of service.
    """

    name: str
    message: str
    meaning: str
    px4: bool = False


TOPICS: tuple[Topic, ...] = (
    Topic(name="pose", message="geometry_msgs/PoseStamped", meaning="estimated pose in `map`"),
    Topic(
        name="twist",
        message="geometry_msgs/TwistStamped",
        meaning="estimated velocity and body rates in `NAME/base_link`",
    ),
    Topic(
        name="mocap/pose",
        message="geometry_msgs/PoseStamped",
        meaning="pose of the rigid body in `map`, only while it is tracked",
    ),
    Topic(name="battery", message="sensor_msgs/BatteryState", meaning="remaining charge, 0 to 1"),
    Topic(name="mode", message="std_msgs/String", meaning="flight mode, such as `OFFBOARD`"),
    Topic(name="armed", message="std_msgs/Bool", meaning="whether the vehicle is armed"),
    Topic(name="landed", message="std_msgs/Bool", meaning="whether the vehicle is on the ground"),
    Topic(
        name=f"{PX4_OUT}/vehicle_local_position",
        message="px4_msgs/VehicleLocalPosition",
        meaning="estimated position and velocity [NED]",
        px4=True,
    ),
    Topic(
        name=f"{PX4_OUT}/vehicle_attitude",
        message="px4_msgs/VehicleAttitude",
        meaning="estimated attitude, FRD to NED",
        px4=True,
    ),
    Topic(
        name=f"{PX4_OUT}/vehicle_odometry",
        message="px4_msgs/VehicleOdometry",
        meaning="estimated pose, velocity [NED] and body rates [FRD]",
        px4=True,
    ),
    Topic(
        name=f"{PX4_OUT}/vehicle_status_v1",
        message="px4_msgs/VehicleStatus",
        meaning="`arming_state`, `nav_state`, `system_id`, `pre_flight_checks_pass`",
        px4=True,
    ),
    Topic(
        name=f"{PX4_OUT}/battery_status",
        message="px4_msgs/BatteryStatus",
        meaning="`remaining`, 0 to 1",
        px4=True,
    ),
    Topic(
        name=f"{PX4_OUT}/vehicle_command_ack",
        message="px4_msgs/VehicleCommandAck",
        meaning="replies to commands from ROS 2",
        px4=True,
    ),
)
Publish = Callable[[str, Message], None]


class Outgoing:
    """Publisher of one vehicle's telemetry on ROS 2 topics. It publishes new values only.

    name: name of the vehicle. system_id: MAV_SYS_ID. publish: called with (topic, message). rate_hz: most messages per second and topic.
    """

    def __init__(self, name: str, system_id: int, publish: Publish, rate_hz: float) -> None:
        self._name, self._id, self._publish = name, system_id, publish
        self._period_s = 1.0 / rate_hz
        self._seen: dict[str, float] = {}
        self._due: dict[str, float] = {}

    def on_telemetry(self, telemetry: Telemetry, now: float) -> None:
        """Publish the telemetry values that have changed since the last call.

        now: ROS time [s].
        """
        local, attitude = telemetry.local, telemetry.attitude
        if local is not None and attitude is not None and self._is_new("state", local.boot_s, now):
            for name, made in self._state(telemetry, now):
                self._publish(name, made)
        for key, value, make in (
            ("battery", telemetry.status, self._battery),
            ("mode", telemetry.heartbeat, self._mode),
            ("landed", telemetry.ground, self._landed),
        ):
            if value is not None and self._is_new(key, value.received_at, now):
                for name, made in make(telemetry, now):
                    self._publish(name, made)

    def on_pose(self, p_n: ArrayLike, q_nb: ArrayLike, time_s: float, now: float) -> None:
        """Publish a motion capture pose of the vehicle, if the body is tracked.

        p_n: [m] [NED] (3,).
        q_nb: [-] wxyz (4,).
        time_s: time of the frame [s].
        """
        if self._is_new("mocap", time_s, now):
            self._publish("mocap/pose", self._pose(p_n, q_nb, now))

    def on_ack(self, command: int, result: int, target: tuple[int, int], now: float) -> None:
        """Publish the vehicle's reply to a command, as VehicleCommandAck."""
        made = message(
            "px4_msgs/VehicleCommandAck",
            timestamp=_us(now),
            command=command,
            result=result,
            target_system=target[0],
            target_component=target[1],
        )
        self._publish(f"{PX4_OUT}/vehicle_command_ack", made)

    def _is_new(self, key: str, stamp: float, now: float) -> bool:
        """Return whether a value must be published now: it has changed, and the topic's rate limit allows it.

        The due times form a fixed grid, so that the rate is exact.
        """
        due = self._due.get(key, now)
        if self._seen.get(key) == stamp or now < due - 1e-6:
            return False
        self._seen[key] = stamp
        self._due[key] = due + self._period_s if now < due + self._period_s else now + self._period_s
        return True

    def _state(self, telemetry: Telemetry, now: float) -> Iterator[tuple[str, Message]]:
        local, attitude = telemetry.local, telemetry.attitude
        if local is None or attitude is None:
            return
        q_nb, rates = attitude.q_nb, attitude.ang_vel
        yield "pose", self._pose(local.pos, q_nb, now)
        twist = {
            "linear": _vector(frd_from_flu(quat_rotate(quat_conj(q_nb), local.vel))),
            "angular": _vector(frd_from_flu(rates)),
        }
        header = _header(f"{self._name}/base_link", now)
        yield "twist", message("geometry_msgs/TwistStamped", header=header, twist=twist)
        times = {"timestamp": _us(now), "timestamp_sample": _us(now)}
        (x, y, z), (vx, vy, vz) = local.pos.tolist(), local.vel.tolist()
        yield (
            f"{PX4_OUT}/vehicle_local_position",
            message(
                "px4_msgs/VehicleLocalPosition",
                **times,
                **{f"{key}_valid": True for key in ("xy", "z", "v_xy", "v_z")},
                x=x,
                y=y,
                z=z,
                vx=vx,
                vy=vy,
                vz=vz,
                z_deriv=vz,
                heading=float(yaw_from_quat(q_nb)),
                heading_good_for_control=True,
            ),
        )
        q = q_nb.tolist()
        zero = [0.0] * 4
        yield (
            f"{PX4_OUT}/vehicle_attitude",
            message("px4_msgs/VehicleAttitude", **times, q=q, delta_q_reset=zero),
        )
        yield (
            f"{PX4_OUT}/vehicle_odometry",
            message(
                "px4_msgs/VehicleOdometry",
                **times,
                pose_frame=_POSE_FRAME_NED,
                position=[x, y, z],
                q=q,
                velocity_frame=_VELOCITY_FRAME_NED,
                velocity=[vx, vy, vz],
                angular_velocity=rates.tolist(),
            ),
        )

    def _battery(self, telemetry: Telemetry, now: float) -> Iterator[tuple[str, Message]]:
        if telemetry.status is None or not np.isfinite(telemetry.status.battery):
            return
        charge = telemetry.status.battery / 100.0
        header = _header(f"{self._name}/base_link", now)
        yield "battery", message("sensor_msgs/BatteryState", header=header, percentage=charge, present=True)
        made = message("px4_msgs/BatteryStatus", timestamp=_us(now), connected=True, remaining=charge)
        yield f"{PX4_OUT}/battery_status", made

    def _mode(self, telemetry: Telemetry, now: float) -> Iterator[tuple[str, Message]]:
        heart, status = telemetry.heartbeat, telemetry.status
        if heart is None:
            return
        yield "mode", message("std_msgs/String", data=heart.mode)
        yield "armed", message("std_msgs/Bool", data=heart.armed)
        state = NAV_STATES.get(heart.mode, 0)
        made = message(
            "px4_msgs/VehicleStatus",
            timestamp=_us(now),
            arming_state=_ARMED if heart.armed else _DISARMED,
            nav_state=state,
            nav_state_user_intention=state,
            system_id=self._id,
            component_id=1,
            pre_flight_checks_pass=status is not None and status.prearm,
        )
        yield f"{PX4_OUT}/vehicle_status_v1", made

    def _landed(self, telemetry: Telemetry, now: float) -> Iterator[tuple[str, Message]]:
        if telemetry.ground is not None:
            yield "landed", message("std_msgs/Bool", data=telemetry.ground.landed)

    def _pose(self, p_n: ArrayLike, q_nb: ArrayLike, now: float) -> Message:
        w, x, y, z = q_wf_from_q_nb(q_nb).tolist()
        pose = {"position": _vector(world_from_ned(p_n)), "orientation": {"x": x, "y": y, "z": z, "w": w}}
        return message("geometry_msgs/PoseStamped", header=_header(WORLD_FRAME, now), pose=pose)


def clock_message(now: float) -> Message:
    """Return a message for the ROS 2 topic `/clock`.

    now: simulation time [s].
    """
    return message("rosgraph_msgs/Clock", clock=_stamp(now))


def _header(frame: str, now: float) -> dict[str, Any]:
    return {"stamp": _stamp(now), "frame_id": frame}


def _stamp(now: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(round(now * 1e9), 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def _vector(values: ArrayLike) -> dict[str, float]:
    x, y, z = np.asarray(values).tolist()
    return {"x": x, "y": y, "z": z}


def _us(now: float) -> int:
    return round(now * 1e6)
