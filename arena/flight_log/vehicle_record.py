"""Recorded data of one vehicle: MAVLink messages, poses and true states."""

from __future__ import annotations

from array import array

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.flight_log.mavlink_messages import MessageSeries
from arena.flight_log.recording import RecordedVehicle
from arena.geometry import Array
from arena.wire.flight_record import TRUE_STATE_BYTES
from arena.wire.mavlink_frame import AUTOPILOT
from arena.wire.mavlink_ids import PROGRAM_COMPONENT

OF_AUTOPILOT = (
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_CONTROL_TARGET,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_WIND_COV,
)
"""Messages of an autopilot that a log is made of."""
OF_PROGRAM = (mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,)
"""Messages of a user program that a log is made of: the references that it publishes."""
_TRUE_STATE_NUMBERS = 13


class VehicleRecord:
    """Recorded data of one vehicle, in the order of recording. Times are on the run's clock [s]."""

    def __init__(self, vehicle: RecordedVehicle) -> None:
        self.vehicle = vehicle
        self.down = MessageSeries(vehicle.id, AUTOPILOT, OF_AUTOPILOT)
        self.program = MessageSeries(vehicle.id, PROGRAM_COMPONENT, OF_PROGRAM)
        self._poses, self._truth, self._truth_s = array("d"), bytearray(), array("d")
        self._end = -np.inf

    def add_down(self, time_s: float, data: bytes) -> None:
        """Add a recorded datagram that the vehicle sent. time_s: time of reception [s]."""
        self.down.add(time_s, data)
        self._end = time_s

    def add_up(self, time_s: float, data: bytes) -> None:
        """Add a recorded datagram that was sent to the vehicle, or that its user program published.

        Only the references (wanted states) that the user program has published are kept.
        """
        self.program.add(time_s, data)

    def add_pose(self, time_s: float, exposed_s: float, pose: tuple[float, ...]) -> None:
        """Add a captured pose (7,): attitude q_nb [-] wxyz and position p_n [m] [NED].

        time_s: time of reception [s]. exposed_s: time of exposure, by the clock of the motion capture [s].
        """
        self._poses.extend((time_s, exposed_s, *pose))
        self._end = time_s

    def add_truth(self, time_s: float, data: bytes) -> None:
        """Add a recorded message with a true state. time_s: time on the run's clock [s]."""
        if len(data) == TRUE_STATE_BYTES:
            self._truth_s.append(time_s)
            self._truth += data[4:]
            self._end = time_s

    @property
    def end_s(self) -> float:
        """Time of the last recorded datagram from the vehicle, pose or true state [s]."""
        return self._end

    @property
    def poses(self) -> Array:
        """Captured poses (m, 9): times of reception and of exposure [s], q_nb [-] wxyz, p_n [m] [NED]."""
        return np.array(self._poses, np.float64).reshape(-1, 9)

    @property
    def truth(self) -> tuple[Array, Array]:
        """True states: times [s] (m,), and p_n, v_n, q_nb, omega_b (m, 13)."""
        rows = np.frombuffer(bytes(self._truth), "<f8").reshape(-1, _TRUE_STATE_NUMBERS)
        return np.array(self._truth_s, np.float64), rows.astype(np.float64)
