"""Reader of the MAVLink messages that an autopilot receives many times a second: poses and setpoints. Pure.

An ordinary datagram is one MAVLink 2 frame, unsigned, with a pose for this vehicle, or with a setpoint that its program sends
and that is not refused. Python code reads all other datagrams. `arena.wire.mavlink_frame` describes the frames.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels import mavlink_framing

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from arena.kernels.arrays import Integers
    from arena.kernels.offboard_setpoints import OffboardSetpoints
    from arena.kernels.vision_input import VisionInput

ODOMETRY, SET_POSITION_TARGET = 331, 84
"""Ids of the messages that are read."""
_ODOMETRY, _SET_POSITION_TARGET = ODOMETRY, SET_POSITION_TARGET
_V2, _HEAD, _CRC, _AUTOPILOT = 0xFD, 10, 2, 1
_P, _Q, _VAR_N, _VAR_E, _VAR_D, _VAR_YAW, _FRAME_ID, _ESTIMATOR = 8, 20, 60, 84, 104, 140, 228, 231
_TARGET, _MASK, _SYSTEM, _COMPONENT, _FRAME = 4, 48, 50, 51, 52
# Payload offsets of ODOMETRY (position, attitude, diagonal of the pose covariance ...) and of SET_POSITION_TARGET_LOCAL_NED
# (the first of 11 numbers ...).
_LOCAL_NED, _LOCAL_FRD = 1, 20  # MAV_FRAME
_UNKNOWN, _VISION, _VIO = 0, 2, 3  # MAV_ESTIMATOR_TYPE; PX4 accepts MOCAP, but its EKF2 never fuses it


class OrdinaryMessages:
    """Reader of the ordinary messages to V vehicles.

    system_ids: MAVLink system ids of the vehicles (V,)
    vision, offboard: receive poses and setpoints
    """

    def __init__(
        self,
        system_ids: Integers,
        vision: VisionInput,
        offboard: OffboardSetpoints,
        seeds: Mapping[int, bytes],
        links: Collection[str],
        passes_setpoint: Sequence[Callable[[float], bool]],
    ) -> None:
        """Create a reader for all vehicles.

        seeds: message id -> seed byte CRC_EXTRA
        links: names of the links on which a sender with a vehicle's own system id is its program
        passes_setpoint: time since boot [s] -> whether a setpoint of a vehicle's program may be used now, for each vehicle; empty if
            it always may
        """
        self.system_ids, self.vision, self.offboard = system_ids, vision, offboard
        self._odometry_seed, self._setpoint_seed = seeds[ODOMETRY], seeds[SET_POSITION_TARGET]
        self._links, self._passes_setpoint = frozenset(links), list(passes_setpoint)
        self._payload = self._length = 0
        raw = memoryview(bytearray(4))
        self._bytes, self._float = raw, raw.cast("f")

    def receive(self, i: int, link: str, datagram: object, now: float) -> bool:
        """Read a datagram to vehicle i. Return False if it is not ordinary; nothing of it is stored then.

        link: name of the link on which it arrived
        now: time since boot [s]
        """
        if type(datagram) is not bytes or link not in self._links:
            return False
        data: bytes = datagram
        msgid, length = self._message_id(i, data), len(data) - _HEAD - _CRC
        if msgid == _ODOMETRY:
            self.read_pose(i, data, _HEAD, length)
            return True
        if msgid != _SET_POSITION_TARGET:
            return False
        if self._passes_setpoint and not self._passes_setpoint[i](now):
            return False
        return self.read_setpoint(i, data, _HEAD, length, now) is None

    def _message_id(self, i: int, data: bytes) -> int:
        """Return the message id of a datagram with one frame that vehicle i may use; -1 if it is not such a datagram."""
        size = len(data)
        if size < _HEAD + _CRC or data[0] != _V2 or data[2] != 0 or size != _HEAD + data[1] + _CRC:
            return -1
        own, msgid = self.system_ids[i], data[7] + 256 * data[8] + 65536 * data[9]
        if data[5] == own and data[6] == _AUTOPILOT:
            return -1
        if msgid == _ODOMETRY:
            return msgid if self._crc_fits(data, size - _CRC, self._odometry_seed) else -1
        if msgid != _SET_POSITION_TARGET or data[5] != own:
            return -1
        self._payload, self._length = _HEAD, data[1]
        system, component = self._byte_at(data, _SYSTEM), self._byte_at(data, _COMPONENT)
        if system not in (0, own) or component > _AUTOPILOT:
            return -1
        return msgid if self._crc_fits(data, size - _CRC, self._setpoint_seed) else -1

    def _crc_fits(self, data: bytes, end: int, seed: bytes) -> bool:
        """Return whether the CRC is right. end: position of the CRC in the datagram"""
        return mavlink_framing.checksum(data, 1, end, seed) == data[end] + (data[end + 1] << 8)

    def read_pose(self, i: int, data: bytes, payload: int, length: int) -> None:
        """Pass the pose in an ODOMETRY message to vehicle i on, or count it as refused if PX4 would not fuse it.

        payload, length: position and number of bytes of the payload in `data`. Bytes beyond its end are 0.
        """
        self._payload, self._length = payload, length
        frame, estimator = self._byte_at(data, _FRAME_ID), self._byte_at(data, _ESTIMATOR)
        if frame not in (_LOCAL_NED, _LOCAL_FRD) or estimator not in (_UNKNOWN, _VISION, _VIO):
            self.vision.refuse(i)
            return
        north, east, down = (
            self._float_at(data, _P),
            self._float_at(data, _P + 4),
            self._float_at(data, _P + 8),
        )
        w, x = self._float_at(data, _Q), self._float_at(data, _Q + 4)
        y, z = self._float_at(data, _Q + 8), self._float_at(data, _Q + 12)
        var_n, var_e = self._float_at(data, _VAR_N), self._float_at(data, _VAR_E)
        var_d, var_yaw = self._float_at(data, _VAR_D), self._float_at(data, _VAR_YAW)
        self.vision.receive(i, (north, east, down), (w, x, y, z), (var_n, var_e, var_d), var_yaw)

    def read_setpoint(self, i: int, data: bytes, payload: int, length: int, now: float) -> str | None:
        """Pass the setpoint in a SET_POSITION_TARGET_LOCAL_NED to vehicle i on. Return the reason if it is refused.

        payload, length: position and number of bytes of the payload in `data`. Bytes beyond its end are 0.
        now: time since boot [s]
        """
        self._payload, self._length = payload, length
        target = self.offboard.target
        for k in range(len(target)):
            target[k] = self._float_at(data, _TARGET + 4 * k)
        mask = self._byte_at(data, _MASK) + (self._byte_at(data, _MASK + 1) << 8)
        return self.offboard.set_local_target(i, mask, self._byte_at(data, _FRAME), now)

    def _byte_at(self, data: bytes, offset: int) -> int:
        """Return one byte of the payload."""
        return data[self._payload + offset] if offset < self._length else 0

    def _float_at(self, data: bytes, offset: int) -> float:
        """Return a float32 of the payload."""
        for k in range(4):
            self._bytes[k] = self._byte_at(data, offset + k)
        return self._float[0]
