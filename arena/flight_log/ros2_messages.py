"""ROS 2 messages made from the rows of a log, in ROS's frames: ENU world (`map`) and FLU body.

A message with an unknown value is not made. Modes and flags are published when they change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.constants import MAX_ROTORS
from arena.flight_log.columns import NED, RPY, WXYZ
from arena.flight_log.flight import FLAGS, Flight
from arena.geometry import (
    Array,
    frd_from_flu,
    q_wf_from_q_nb,
    quat_conj,
    quat_from_euler,
    quat_rotate,
    world_from_ned,
)

WORLD_FRAME = "map"
_NO_COVARIANCE_9, _NO_COVARIANCE_36 = np.zeros(9), np.zeros(36)
_OUTPUTS = tuple(f"act.output.{k + 1}" for k in range(MAX_ROTORS))
Types = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class RosTopic:
    """A ROS 2 topic, with the rows of the log from which its messages are made.

    name: topic.  type: ROS type.  rows: rows of the log that have a message (m,).  make: row -> message.
    """

    name: str
    type: str
    rows: NDArray[np.intp]
    make: Callable[[int], Any]


def topics_of(flight: Flight, types: Types) -> Iterator[RosTopic]:
    """Yield all ROS 2 topics of a vehicle that have messages.

    types: {type name: ROS message class} of one ROS distribution.
    """
    made = _Messages(flight, types)
    for topic in (
        *(made.odometry(name, group) for name, group in (("odometry", "ekf"), ("truth", "truth"))),
        made.capture(),
        made.setpoint(),
        made.velocity_setpoint(),
        made.attitude_setpoint(),
        made.imu(),
        made.magnetic_field(),
        made.pressure(),
        made.battery(),
        made.actuators(),
        made.mode(),
        *(made.flag(name) for name in FLAGS),
    ):
        if topic.rows.size:
            yield topic


def stamp_ns(flight: Flight, row: int) -> int:
    """Return the time of a row of the log [ns]."""
    return round(1e9 * float(flight.numbers["time.seconds"][row]))


class _Messages:
    """Creates the ROS 2 topics of one flight."""

    def __init__(self, flight: Flight, types: Types) -> None:
        self._flight, self._types = flight, types
        self._body = f"{flight.name}/base_link"

    def _topic(self, name: str, kind: str, known: Array, make: Callable[[int], Any]) -> RosTopic:
        """Return a ROS 2 topic with a message for each row whose values are all known.

        known: values of the log that must be finite in a row (n, k). make: function from row to message.
        """
        rows = np.flatnonzero(np.isfinite(known).all(axis=1))
        return RosTopic(name=f"/{self._flight.name}/{name}", type=kind, rows=rows, make=make)

    def _new(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)

    def _header(self, row: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(stamp_ns(self._flight, row), 1_000_000_000)
        stamp = self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _vector(self, values: Array) -> Any:
        x, y, z = values.tolist()
        return self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _quaternion(self, q: Array) -> Any:
        w, x, y, z = q.tolist()
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, position: Array, q: Array) -> Any:
        x, y, z = position.tolist()
        return self._new(
            "geometry_msgs/msg/Pose",
            position=self._new("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._quaternion(q),
        )

    def odometry(self, name: str, group: str) -> RosTopic:
        """Return the odometry topic: pose in the world frame, velocity and rates in body axes.

        group: `ekf` for the estimate, `truth` for the true state.
        """
        position = self._flight.group(f"{group}.pos")
        attitude = self._flight.group(f"{group}.att_q", WXYZ)
        velocity, rates = self._flight.group(f"{group}.vel"), self._flight.group(f"{group}.ang_vel", RPY)
        known = np.concatenate([position, attitude, velocity, rates], axis=1)
        linear = frd_from_flu(quat_rotate(quat_conj(attitude), velocity))
        angular, place, q = frd_from_flu(rates), world_from_ned(position), q_wf_from_q_nb(attitude)

        def make(row: int) -> Any:
            twist = self._new(
                "geometry_msgs/msg/Twist",
                linear=self._vector(linear[row]),
                angular=self._vector(angular[row]),
            )
            return self._new(
                "nav_msgs/msg/Odometry",
                header=self._header(row, WORLD_FRAME),
                child_frame_id=self._body,
                pose=self._new(
                    "geometry_msgs/msg/PoseWithCovariance",
                    pose=self._pose(place[row], q[row]),
                    covariance=_NO_COVARIANCE_36,
                ),
                twist=self._new(
                    "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=_NO_COVARIANCE_36
                ),
            )

        return self._topic(name, "nav_msgs/msg/Odometry", known, make)

    def _poses(self, name: str, position: Array, attitude: Array) -> RosTopic:
        place, q = world_from_ned(position), q_wf_from_q_nb(attitude)

        def make(row: int) -> Any:
            return self._new(
                "geometry_msgs/msg/PoseStamped",
                header=self._header(row, WORLD_FRAME),
                pose=self._pose(place[row], q[row]),
            )

        known = np.concatenate([position, attitude], axis=1)
        return self._topic(name, "geometry_msgs/msg/PoseStamped", known, make)

    def capture(self) -> RosTopic:
        """Return the topic with the poses of motion capture."""
        flight = self._flight
        return self._poses("mocap/pose", flight.group("mocap.pos"), flight.group("mocap.att_q", WXYZ))

    def setpoint(self) -> RosTopic:
        """Return the topic with the position and yaw setpoints. Yaw is 0 if the setpoint has no yaw."""
        yaw = np.nan_to_num(self._flight.group("pos_ref", ("yaw",)))
        zeros = np.zeros((yaw.size, 2))
        attitude = quat_from_euler(np.concatenate([zeros, yaw], axis=1))
        return self._poses("setpoint/pose", self._flight.group("pos_ref"), attitude)

    def velocity_setpoint(self) -> RosTopic:
        """Return the topic with the velocity setpoints [m/s] [ENU]."""
        velocity = self._flight.group("vel_ref")
        in_world, zero = world_from_ned(velocity), np.zeros(3)

        def make(row: int) -> Any:
            twist = self._new(
                "geometry_msgs/msg/Twist", linear=self._vector(in_world[row]), angular=self._vector(zero)
            )
            return self._new(
                "geometry_msgs/msg/TwistStamped", header=self._header(row, WORLD_FRAME), twist=twist
            )

        return self._topic("setpoint/velocity", "geometry_msgs/msg/TwistStamped", velocity, make)

    def attitude_setpoint(self) -> RosTopic:
        """Return the topic with the attitude setpoints."""
        attitude = self._flight.group("att_q_ref", WXYZ)
        q = q_wf_from_q_nb(attitude)

        def make(row: int) -> Any:
            return self._new(
                "geometry_msgs/msg/QuaternionStamped",
                header=self._header(row, WORLD_FRAME),
                quaternion=self._quaternion(q[row]),
            )

        return self._topic("setpoint/attitude", "geometry_msgs/msg/QuaternionStamped", attitude, make)

    def imu(self) -> RosTopic:
        """Return the IMU topic: inertial measurements in body axes, with the estimated attitude."""
        flight = self._flight
        force, rates = flight.group("imu.acc_body"), flight.group("imu.ang_vel", RPY)
        attitude = flight.group("ekf.att_q", WXYZ)
        acceleration, turn, q = frd_from_flu(force), frd_from_flu(rates), q_wf_from_q_nb(attitude)

        def make(row: int) -> Any:
            return self._new(
                "sensor_msgs/msg/Imu",
                header=self._header(row, self._body),
                orientation=self._quaternion(q[row]),
                orientation_covariance=_NO_COVARIANCE_9,
                angular_velocity=self._vector(turn[row]),
                angular_velocity_covariance=_NO_COVARIANCE_9,
                linear_acceleration=self._vector(acceleration[row]),
                linear_acceleration_covariance=_NO_COVARIANCE_9,
            )

        known = np.concatenate([force, rates, attitude], axis=1)
        return self._topic("imu", "sensor_msgs/msg/Imu", known, make)

    def magnetic_field(self) -> RosTopic:
        """Return the topic of the magnetic field in body axes [T]."""
        field = self._flight.group("imu.mag", NED)
        in_body = frd_from_flu(field)

        def make(row: int) -> Any:
            return self._new(
                "sensor_msgs/msg/MagneticField",
                header=self._header(row, self._body),
                magnetic_field=self._vector(in_body[row]),
                magnetic_field_covariance=_NO_COVARIANCE_9,
            )

        return self._topic("mag", "sensor_msgs/msg/MagneticField", field, make)

    def pressure(self) -> RosTopic:
        """Return the topic of the pressure of the barometer [Pa]."""
        pressure = self._column("baro.pressure")

        def make(row: int) -> Any:
            return self._new(
                "sensor_msgs/msg/FluidPressure",
                header=self._header(row, self._body),
                fluid_pressure=float(pressure[row, 0]),
                variance=0.0,
            )

        return self._topic("pressure", "sensor_msgs/msg/FluidPressure", pressure, make)

    def battery(self) -> RosTopic:
        """Return the battery topic: voltage [V], current [A], charge (0..1); NaN if unknown."""
        charge, nan = self._column("info.battery"), float("nan")
        voltage, current = self._column("bat.voltage")[:, 0], self._column("bat.current")[:, 0]
        unknown = {"temperature": nan, "charge": nan, "capacity": nan, "design_capacity": nan}
        status = {f"power_supply_{name}": 0 for name in ("status", "health", "technology")}
        cells = np.zeros(0, np.float32)

        def make(row: int) -> Any:
            return self._new(
                "sensor_msgs/msg/BatteryState",
                header=self._header(row, self._body),
                voltage=float(voltage[row]),
                current=-float(current[row]),  # ROS: negative while discharging
                percentage=float(charge[row, 0]) / 100.0,
                present=True,
                cell_voltage=cells,
                cell_temperature=cells,
                location="",
                serial_number="",
                **unknown,
                **status,
            )

        return self._topic("battery", "sensor_msgs/msg/BatteryState", charge, make)

    def actuators(self) -> RosTopic:
        """Return the topic with the outputs to all rotors (0..1)."""
        missing = np.full(self._flight.t.size, np.nan)
        output = np.stack([self._flight.numbers.get(name, missing) for name in _OUTPUTS], axis=1)
        layout = self._new("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)

        def make(row: int) -> Any:
            return self._new("std_msgs/msg/Float64MultiArray", layout=layout, data=output[row])

        return self._topic("actuators", "std_msgs/msg/Float64MultiArray", output, make)

    def mode(self) -> RosTopic:
        """Return the topic of the flight mode, with one message per change of mode."""
        names = np.array(self._flight.mode)
        changed = _changes(names) & (names != "")
        topic = self._topic("mode", "std_msgs/msg/String", np.zeros((names.size, 1)), self._mode_at)
        return RosTopic(name=topic.name, type=topic.type, rows=np.flatnonzero(changed), make=topic.make)

    def _mode_at(self, row: int) -> Any:
        return self._new("std_msgs/msg/String", data=self._flight.mode[row])

    def flag(self, name: str) -> RosTopic:
        """Return the topic of a flag such as `info.is_armed`, with one Bool message per change of the flag.

        name: column of the log, such as `info.is_armed`.
        """
        values = self._column(name)[:, 0]
        rows = np.flatnonzero(_changes(np.nan_to_num(values, nan=-1.0)) & np.isfinite(values))

        def make(row: int) -> Any:
            return self._new("std_msgs/msg/Bool", data=bool(values[row] == 1.0))

        topic = f"/{self._flight.name}/{name.removeprefix('info.is_')}"
        return RosTopic(name=topic, type="std_msgs/msg/Bool", rows=rows, make=make)

    def _column(self, name: str) -> Array:
        """Return a column of the log (n, 1); NaN if the log does not have this column."""
        found = self._flight.numbers.get(name)
        return np.full((self._flight.t.size, 1), np.nan) if found is None else found[:, None]


def _changes(values: Sequence[Any] | NDArray[Any]) -> NDArray[np.bool_]:
    """Return a mask (n,): true in the first row, and in each row whose value differs from the row before."""
    array = np.asarray(values)
    return np.concatenate([np.ones(min(array.size, 1), bool), array[1:] != array[:-1]])
