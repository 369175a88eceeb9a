"""The newest state messages of each vehicle, such as HEARTBEAT, for a replay from mid-flight on. Pure."""

from __future__ import annotations

from arena.wire.mavlink_frame import AUTOPILOT, parse_frames
from arena.wire.px4_mode import AVAILABLE_MODES, CURRENT_MODE

_HEARTBEAT, _SYS_STATUS, _GPS_GLOBAL_ORIGIN, _BATTERY_STATUS = 0, 1, 49, 147
_ATTITUDE_QUATERNION, _LOCAL_POSITION_NED = 31, 32
_AUTOPILOT_VERSION, _HOME_POSITION, _EXTENDED_SYS_STATE, _COMPONENT_INFORMATION = 148, 242, 245, 395
STATE_MESSAGES = frozenset(
    {
        _HEARTBEAT,
        _SYS_STATUS,
        _ATTITUDE_QUATERNION,
        _LOCAL_POSITION_NED,
        _GPS_GLOBAL_ORIGIN,
        _BATTERY_STATUS,
        _AUTOPILOT_VERSION,
        _HOME_POSITION,
        _EXTENDED_SYS_STATE,
        _COMPONENT_INFORMATION,
        CURRENT_MODE,
        AVAILABLE_MODES,
    }
)
"""Messages of which a viewer needs the newest one: state, attitude and position of the vehicle. Parameters are not repeated."""
_MODE_INDEX_OFFSET = 9  # in AVAILABLE_MODES, after custom_mode, properties and number_modes


class StateMessages:
    """Store of the newest frame of each state message (such as HEARTBEAT) of each vehicle.

    vehicles: number of vehicles.
    """

    def __init__(self, vehicles: int) -> None:
        self._frames: list[dict[tuple[int, int, int], bytes]] = [{} for _ in range(vehicles)]

    def take(self, vehicle: int, datagram: bytes) -> None:
        """Store the state messages of a datagram from a vehicle.

        vehicle: its index.
        """
        for at in parse_frames(datagram).frames:
            if at.msgid in STATE_MESSAGES and at.compid == AUTOPILOT:
                index = 0
                if at.msgid == AVAILABLE_MODES and at.size > _MODE_INDEX_OFFSET:
                    index = datagram[at.payload + _MODE_INDEX_OFFSET]
                self._frames[vehicle][at.msgid, at.compid, index] = bytes(datagram[at.start : at.end])

    def newest(self, vehicle: int, msgid: int) -> bytes | None:
        """Return a vehicle's newest stored frame with a given MAVLink message id, or None if there is none.

        msgid: MAVLink message id.
        """
        found = [frame for key, frame in self._frames[vehicle].items() if key[0] == msgid]
        return found[-1] if found else None

    def all(self) -> list[tuple[int, bytes]]:
        """Return (vehicle, frame) of all stored messages. Each vehicle's first frame is its HEARTBEAT."""
        return [(i, frames[key]) for i, frames in enumerate(self._frames) for key in sorted(frames)]
