"""Statistics of one vehicle: message rates, armed state, and time of takeoff. Pure."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.viewer_meters import DatagramCounter, GapMeter
from arena.wire.mavlink_frame import AUTOPILOT, parse_frames
from arena.wire.mavlink_layout import decoder

AIRBORNE_HEIGHT_M = 0.05
_HEARTBEAT, _LANDED = mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
_STATUS = (_HEARTBEAT, _LANDED)
_decode_heartbeat, _decode_landed = decoder(_HEARTBEAT), decoder(_LANDED)


class VehicleWatch:
    """Statistics and state of one vehicle, from the datagrams that the recorder receives.

    system_id: MAVLink system id of the vehicle.
    armed: armed flag of the last heartbeat; false before the first one.
    datagrams: counter of the datagrams. If its `count` returns True, call `on_status`.  poses: counter of its captured poses.
    airborne_unix_s: Unix time of the first take-off [s]; None before.
    """

    def __init__(self, system_id: int) -> None:
        self.datagrams = DatagramCounter(_HEARTBEAT, _LANDED)
        self.poses = GapMeter()
        self.airborne_unix_s: float | None = None
        self.armed = False
        self._on_ground: bool | None = None
        self._sender = (system_id, AUTOPILOT)
        self._floor_m: float | None = None

    def on_status(self, data: bytes) -> bool:
        """Read the state of the autopilot in a datagram. Return True if it reports the vehicle's first takeoff.

        The autopilot's land detector (EXTENDED_SYS_STATE) reports the takeoff.
        """
        return (
            self._take_status(data)
            and self.airborne_unix_s is None
            and self.armed
            and self._on_ground is False
        )

    def _take_status(self, data: bytes) -> bool:
        """Read HEARTBEAT and EXTENDED_SYS_STATE in a datagram. Return whether it contains one of them."""
        found = False
        for frame in parse_frames(data).frames:
            if frame.msgid not in _STATUS or (frame.sysid, frame.compid) != self._sender:
                continue
            found = True
            if frame.msgid == _HEARTBEAT:
                self.armed = bool(
                    _decode_heartbeat(data, frame).base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
                )
            else:
                landed_state = _decode_landed(data, frame).landed_state
                self._on_ground = landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        return found

    def is_above_floor(self, height_m: float) -> bool:
        """Return whether a vehicle is more than AIRBORNE_HEIGHT_M above its starting height. height_m: true height [m].

        The first call stores the starting height.
        """
        self._floor_m = height_m if self._floor_m is None else self._floor_m
        return height_m > self._floor_m + AIRBORNE_HEIGHT_M

    def stats(self, now_s: float) -> dict[str, Any]:
        """Return the mean rates since the first datagram [Hz], and the time of takeoff.

        now_s: run's clock [s].
        """
        datagrams = self.datagrams
        since = now_s - datagrams.first_s  # NaN before the first datagram
        counts = {"datagrams_hz": datagrams.down, "commands_hz": datagrams.up, "mocap_hz": self.poses.count}
        found: dict[str, Any] = {
            key: round(count / since, 2) if since > 1.0 else 0.0 for key, count in counts.items()
        }
        if self.airborne_unix_s is not None:
            found["airborne_unix_s"] = round(self.airborne_unix_s, 3)
        return found
