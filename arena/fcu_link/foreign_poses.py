"""Filter for poses and position resets to a vehicle that do not come from its pose forwarder. Pure.

PX4 fuses the poses of all senders. Poses in other axes, old poses or poses of another body would pull the estimate away from
those of the pose forwarder, and no check of the forwarder sees them. A relay of MAVROS is an example.

SET_GPS_GLOBAL_ORIGIN moves the origin of PX4's local frame, so the local position jumps. EXTERNAL_POSITION_ESTIMATE resets the
position while PX4 has lost its position sensor (EKF2.cpp, v1.16). In flight, the vehicle then flies away.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import command_of
from arena.wire.age_limits import POSES
from arena.wire.mavlink_frame import Buffer, Frame

_MOST_REPORTS = 16
_ORIGIN, _POSITION = mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN, mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE


class ForeignPoses:
    """Refuses what only the pose forwarder may send: poses, if the vehicle has a forwarder, and position resets while it is armed.

    system: MAVLink id of the vehicle
    forwarded: the vehicle has a pose forwarder (not `forward: false`)
    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(self, system: int, *, forwarded: bool) -> None:
        self._system, self._forwarded = system, forwarded
        self._reported: set[tuple[int, int, int]] = set()
        self.events: list[str] = []

    def refusal(self, link: str, data: Buffer, frame: Frame, *, armed: bool) -> str:
        """Return what a refused frame contains, such as "pose of another sender"; "" if the frame may pass.

        A new sender is reported.

        link: "router", "vision" (pose forwarder) or "panic"
        armed: the vehicle is armed, or may be
        """
        if link == "vision":
            return ""
        if frame.msgid in POSES and self._forwarded:
            why = "because its pose forwarder sends its poses. To send other poses, set `forward: false`"
            self._report(frame, mavlink.mavlink_map[frame.msgid].msgname, why)
            return "pose of another sender"
        if not armed or frame.target_sys not in (0, self._system):
            return ""
        if frame.msgid == _ORIGIN or command_of(data, frame) == _POSITION:
            name = "SET_GPS_GLOBAL_ORIGIN" if frame.msgid == _ORIGIN else "EXTERNAL_POSITION_ESTIMATE"
            self._report(frame, name, "because the vehicle is armed and its position would jump")
            return "position reset of an armed vehicle"
        return ""

    def _report(self, frame: Frame, name: str, why: str) -> None:
        sender = frame.sysid, frame.compid, frame.msgid
        if sender not in self._reported and len(self._reported) < _MOST_REPORTS:
            self._reported.add(sender)
            self.events.append(f"{name} of {frame.sysid}/{frame.compid} is not sent to the vehicle, {why}")
