"""Filter for poses that another sender than the pose forwarder sends to a vehicle. Pure.

PX4 fuses the poses of all senders. Poses in other axes, old poses or poses of another body would pull the estimate away from
those of the pose forwarder, and no check of the forwarder sees them. A relay of MAVROS is an example.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.age_limits import POSES
from arena.wire.mavlink_frame import Frame

_MOST_REPORTS = 16


class ForeignPoses:
    """Refuses poses that do not come from the pose forwarder, if the vehicle has one.

    forwarded: the vehicle has a pose forwarder (not `forward: false`)
    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(self, *, forwarded: bool) -> None:
        self._forwarded = forwarded
        self._reported: set[tuple[int, int, int]] = set()
        self.events: list[str] = []

    def refuses(self, link: str, frame: Frame) -> bool:
        """Return whether a frame to the vehicle is such a pose. A new sender is reported.

        link: "router", "vision" (pose forwarder) or "panic"
        """
        if not self._forwarded or link == "vision" or frame.msgid not in POSES:
            return False
        sender = frame.sysid, frame.compid, frame.msgid
        if sender not in self._reported and len(self._reported) < _MOST_REPORTS:
            self._reported.add(sender)
            name = mavlink.mavlink_map[frame.msgid].msgname
            self.events.append(
                f"{name} of {frame.sysid}/{frame.compid} is not sent to the vehicle, because its pose forwarder sends its poses. "
                "To send other poses, set `forward: false`"
            )
        return True
