"""ROS 2 bridge of an arena: opens sockets and DDS topics, and polls both for new messages.

Telemetry comes from the tools ports of the router. Setpoints and commands go the same way, so the router treats them as those of a
user program.
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import SimTime
from arena.errors import ArenaError, RunError
from arena.mocap.client import MocapClient, open_client
from arena.ros2.dds import Participant, Sample
from arena.ros2.incoming import Incoming
from arena.ros2.messages import Message
from arena.ros2.outgoing import TOPICS, Outgoing, clock_message
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import ROS2_BRIDGE
from arena.wire.router_ping import PING_PERIOD_S, ping_router
from arena.wire.telemetry import Telemetry

SETPOINTS = {
    "setpoint/pose": (
        "geometry_msgs/PoseStamped",
        "position and yaw in `map`; one message gives one setpoint",
    ),
    "setpoint/velocity": ("geometry_msgs/TwistStamped", "velocity and yaw rate in `map`"),
    "command": ("std_msgs/String", "`arm`, `disarm`, `offboard`, `land` or `hold`"),
    "fmu/in/offboard_control_mode": (
        "px4_msgs/OffboardControlMode",
        "fields of the trajectory setpoint that are used",
    ),
    "fmu/in/trajectory_setpoint": (
        "px4_msgs/TrajectorySetpoint",
        "position, velocity, acceleration, yaw [NED]; NaN: not used",
    ),
    "fmu/in/vehicle_command": ("px4_msgs/VehicleCommand", "command for this vehicle, such as to arm"),
}
"""Topics that the bridge reads with `setpoints: true`: name in the vehicle's namespace -> (message, meaning)."""
_DEPTH = {"command": 8, "fmu/in/vehicle_command": 8}
"""Topics of which every message counts -> most messages between two polls. Of the other topics only the newest message counts."""
_DATAGRAM_BYTES = 1 << 16
_MAX_DATAGRAMS = 500


class VehicleBridge:
    """ROS 2 bridge of one vehicle. It never blocks.

    row: entry of the vehicle in the slice. participant: DDS participant of the bridge.
    setpoints: whether ROS 2 may send setpoints and commands. rate_hz: most messages per second and topic [Hz].
    """

    def __init__(
        self, row: Mapping[str, Any], participant: Participant, *, setpoints: bool, rate_hz: float
    ) -> None:
        self.name, self.body = str(row["name"]), str(row["body"])
        self.published: Counter[str] = Counter()
        self.incoming = Incoming(self.name, int(row["id"]))
        self._telemetry = Telemetry(int(row["id"]))
        self._codec = Codec(ROS2_BRIDGE.system, ROS2_BRIDGE.component)
        tools = str(row["tools"][0]), int(row["tools"][1])
        self._socket = open_udp((tools[0], 0))
        self._socket.connect(tools)
        shown = [t for t in TOPICS if row["px4_msgs"] or not t.px4]
        self._writers = {
            t.name: participant.writer(f"/{self.name}/{t.name}", t.message, px4=t.px4) for t in shown
        }
        self.outgoing = Outgoing(self.name, int(row["id"]), self._publish, rate_hz)
        self._readers = self._open_readers(row, participant) if setpoints else {}
        self._pinged, self._heart = float("-inf"), float("-inf")

    def poll(self, ros_now: float, now: float) -> None:
        """Publish new telemetry, and send each new setpoint or command once to the vehicle.

        ros_now: ROS time [s].
        now: monotonic [s].
        """
        if now - self._pinged >= PING_PERIOD_S:
            self._pinged = now
            self._send(ping_router())
        for _ in range(_MAX_DATAGRAMS):
            try:
                data = self._socket.recv(_DATAGRAM_BYTES)
            except OSError:  # nothing received, or no router that listens
                break
            self._telemetry.on_datagram(data, now)
        heart = self._telemetry.heartbeat
        if heart is not None and heart.received_at != self._heart:
            self._heart = heart.received_at
            self.incoming.on_heartbeat(heart, now)
        for take, convert in self._readers.values():
            for sample in take():
                for made in convert(sample, now) or ():
                    self._send(made)
        self._acks(ros_now)
        self.outgoing.on_telemetry(self._telemetry, ros_now)

    def close(self) -> None:
        """Close the socket without sending a command.

        A vehicle in OFFBOARD then enters its offboard loss failsafe.
        """
        self._socket.close()

    def _acks(self, ros_now: float) -> None:
        while self._telemetry.acks:
            ack = self._telemetry.acks.popleft()
            if (
                ack.target == (ROS2_BRIDGE.system, ROS2_BRIDGE.component)
                and ack.result != mavlink.MAV_RESULT_IN_PROGRESS
            ):
                self.outgoing.on_ack(ack.command, ack.result, ack.target, ros_now)

    def _publish(self, topic: str, message: Message) -> None:
        if topic in self._writers:
            self._writers[topic](message)
            self.published[topic] += 1

    def _send(self, message: mavlink.MAVLink_message) -> None:
        try:
            data = self._codec.pack(message)
        except (struct.error, OverflowError):  # the fields of ROS 2 messages are wider than those of MAVLink
            self.incoming.dropped["a value that MAVLink cannot contain"] += 1
            return
        with contextlib.suppress(OSError):  # no router listens
            self._socket.send(data)

    def _open_readers(
        self, row: Mapping[str, Any], participant: Participant
    ) -> dict[str, tuple[Callable[[], list[Sample]], Any]]:
        core = self.incoming
        functions = (
            core.on_pose,
            core.on_velocity,
            core.on_command,
            core.on_control_mode,
            core.on_trajectory,
            core.on_px4_command,
        )
        return {
            topic: (participant.reader(f"/{self.name}/{topic}", kind, depth=_DEPTH.get(topic, 1)), function)
            for (topic, (kind, _)), function in zip(SETPOINTS.items(), functions, strict=True)
            if row["px4_msgs"] or not topic.startswith("fmu/")
        }


class Bridge:
    """ROS 2 bridge of all vehicles of an arena.

    settings: configuration of the process (slice).
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._participant = Participant(int(settings["domain"]), str(settings["address"]))
        self.vehicles = [
            VehicleBridge(
                row,
                self._participant,
                setpoints=bool(settings["setpoints"]),
                rate_hz=float(settings["rate_hz"]),
            )
            for row in settings["vehicles"]
        ]
        self._bodies = {v.body: v for v in self.vehicles}
        self._captures: list[MocapClient] = [open_client(dict(c)) for c in settings["captures"]]
        self._clock_path = settings["clock"]
        self._clock: SimTime | None = None
        self._publish_clock = (
            self._participant.writer("/clock", "rosgraph_msgs/Clock") if self._clock_path else None
        )
        self._clock_s = -1.0

    def poll(self, now: float) -> None:
        """Pass new ROS 2 messages to the vehicles, and new telemetry and poses to ROS 2.

        now: monotonic [s].
        """
        ros_now = self._ros_time()
        if self._publish_clock is not None and ros_now != self._clock_s:
            self._clock_s = ros_now
            self._publish_clock(clock_message(ros_now))
        for vehicle in self.vehicles:
            vehicle.poll(ros_now, now)
        for capture in self._captures:
            with contextlib.suppress(OSError, ArenaError):
                for frame in capture.poll(now):
                    for pose in frame.poses:
                        if pose.body in self._bodies:
                            self._bodies[pose.body].outgoing.on_pose(
                                pose.p_n, pose.q_nb, frame.time_s, ros_now
                            )

    def stats(self) -> dict[str, Any]:
        """Return the number of published and dropped messages of each vehicle."""
        return {
            "not_written": self._participant.dropped,
            "vehicles": {
                v.name: {"published": dict(v.published), "dropped": dict(v.incoming.dropped)}
                for v in self.vehicles
            },
        }

    def events(self) -> list[str]:
        """Return new events, such as a vehicle that ROS 2 no longer controls, for the supervisor's log."""
        found = [text for v in self.vehicles for text in v.incoming.events]
        for v in self.vehicles:
            v.incoming.events.clear()
        return found

    def close(self) -> None:
        """Close all sockets without sending a command."""
        for vehicle in self.vehicles:
            vehicle.close()
        for capture in self._captures:
            capture.close()

    def _ros_time(self) -> float:
        """Return the ROS time [s]: simulation time in a simulated arena, otherwise Unix time."""
        if not self._clock_path:
            return time.time()
        if self._clock is None:
            with contextlib.suppress(RunError):  # the world has not made the clock file yet
                self._clock = SimTime(self._clock_path)
        return 0.0 if self._clock is None else self._clock.now()
