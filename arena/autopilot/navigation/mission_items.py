"""Decoding and encoding of mission, fence and rally items, as in PX4 v1.16.

PX4 stores and returns only what it supports: yaw within 0..360 degrees, unused parameters as zero. So a
client that downloads its mission may get values that differ from those it uploaded. The built-in autopilot
does the same.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.constants import INT32_MAX, INT32_MIN
from arena.geometry import local_from_globe

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255  # MAV_MISSION_TYPE
_ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_INT_ONLY = (mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
FENCE_COMMANDS = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
)
POLYGONS = FENCE_COMMANDS[:2]
_ROI = (mavlink.MAV_CMD_NAV_ROI, mavlink.MAV_CMD_DO_SET_ROI)
_YAWED = (
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
    mavlink.MAV_CMD_NAV_VTOL_LAND,
)
# Indices of the parameters that are stored for each command with a position. Flags are stored as 0 or 1.
_KEPT: dict[int, tuple[int, ...]] = {
    mavlink.MAV_CMD_NAV_WAYPOINT: (0, 1, 3),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: (2, 3),
    mavlink.MAV_CMD_NAV_LOITER_TIME: (0, 1, 2, 3),
    mavlink.MAV_CMD_NAV_LAND: (1, 3),
    mavlink.MAV_CMD_NAV_TAKEOFF: (3,),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: (0, 1, 3),
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: (3,),
    mavlink.MAV_CMD_NAV_VTOL_LAND: (3,),
    mavlink.MAV_CMD_CONDITION_GATE: (),
    mavlink.MAV_CMD_NAV_ROI: (0,),
    mavlink.MAV_CMD_DO_SET_ROI: (0,),
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: (),
    mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT: (),
    mavlink.MAV_CMD_NAV_RALLY_POINT: (),
    **dict.fromkeys(FENCE_COMMANDS, (0,)),
}
_FLAGS: dict[int, tuple[int, ...]] = {
    mavlink.MAV_CMD_NAV_LOITER_TIME: (1, 3),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: (0, 3),
}
_WITHOUT_POSITION = {
    mavlink.MAV_CMD_DO_JUMP,
    mavlink.MAV_CMD_DO_WINCH,
    mavlink.MAV_CMD_DO_GRIPPER,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
    mavlink.MAV_CMD_DO_SET_HOME,
    mavlink.MAV_CMD_DO_LAND_START,
    mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
    mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
    mavlink.MAV_CMD_DO_MOUNT_CONTROL,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    mavlink.MAV_CMD_SET_CAMERA_FOCUS,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    mavlink.MAV_CMD_IMAGE_START_CAPTURE,
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
    mavlink.MAV_CMD_VIDEO_START_CAPTURE,
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
    mavlink.MAV_CMD_DO_CONTROL_VIDEO,
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    mavlink.MAV_CMD_OBLIQUE_SURVEY,
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL,
    mavlink.MAV_CMD_SET_CAMERA_MODE,
    mavlink.MAV_CMD_SET_CAMERA_SOURCE,
    mavlink.MAV_CMD_DO_VTOL_TRANSITION,
    mavlink.MAV_CMD_NAV_DELAY,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET,
    mavlink.MAV_CMD_DO_SET_ROI_NONE,
    mavlink.MAV_CMD_CONDITION_DELAY,
    mavlink.MAV_CMD_CONDITION_DISTANCE,
    mavlink.MAV_CMD_DO_SET_ACTUATOR,
    *_ROI,
}


class Origin(NamedTuple):
    """Global position of the origin of the local frame, and direction of the frame's north axis.

    lat, lon: latitude, longitude [deg]
    alt: altitude AMSL [m]
    heading: direction of the local frame's north, clockwise from true north [rad]
    """

    lat: float
    lon: float
    alt: float
    heading: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """Stored item of a mission, fence or rally point list.

    frame: MAV_FRAME as received
    command: MAV_CMD
    params: param1 to param4, as stored
    x, y, z: if `has_position`, latitude, longitude [deg] and altitude [m] (above home if `relative`), else
        param5 to param7
    autocontinue, current: flags as received
    """

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    autocontinue: int = 1
    current: bool = False

    @property
    def has_position(self) -> bool:
        """True if the item has a global frame, False for MAV_FRAME_MISSION."""
        return bool(self.frame != mavlink.MAV_FRAME_MISSION)

    @property
    def relative(self) -> bool:
        """True if the altitude is measured from home."""
        return self.frame in _RELATIVE


def item_of(m: Any, *, ints: bool) -> Item | int:
    """Decode a MISSION_ITEM or MISSION_ITEM_INT message.

    ints: True for MISSION_ITEM_INT

    Returns a MAV_MISSION_RESULT instead of an item if the item is refused.
    """
    params = (m.param1, m.param2, m.param3, m.param4)
    refused = _refusal(m.frame, m.command, params, ints)
    if refused:
        return refused
    x, y = (float(m.x), float(m.y))
    if m.frame == mavlink.MAV_FRAME_MISSION:
        return Item(
            frame=m.frame,
            command=m.command,
            params=params,
            x=x,
            y=y,
            z=m.z,
            autocontinue=m.autocontinue,
            current=m.current == 1,
        )
    lat, lon = (x * 1e-7, y * 1e-7) if ints else (x, y)
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and math.isfinite(m.z) and abs(m.z) < 1e5):
        return int(mavlink.MAV_MISSION_INVALID)  # PX4 accepts these values and flies to them
    kept = _kept(m.command, params)
    return Item(
        frame=m.frame,
        command=m.command,
        params=kept,
        x=lat,
        y=lon,
        z=m.z,
        autocontinue=m.autocontinue,
        current=m.current == 1,
    )


def _refusal(frame: int, command: int, params: tuple[float, ...], ints: bool) -> int:
    roi: tuple[int, ...] = (
        0,
        3,
    )  # MAV_ROI values: none, location; without a position none, next waypoint, waypoint index
    if frame == mavlink.MAV_FRAME_MISSION:
        known, roi = command in _WITHOUT_POSITION, (0, 1, 2)
    elif frame in _ABSOLUTE + _RELATIVE and (ints or frame not in _INT_ONLY):
        known = command in _KEPT
    else:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not known:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if command in _ROI and not (math.isfinite(params[0]) and int(params[0]) in roi):
        return int(mavlink.MAV_MISSION_INVALID_PARAM1)
    return 0


def _kept(command: int, params: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    kept = [value if k in _KEPT[command] else 0.0 for k, value in enumerate(params)]
    for k in _FLAGS.get(command, ()):
        kept[k] = 1.0 if kept[k] > 0 else 0.0
    if command in _YAWED:
        kept[3] = kept[3] % 360.0 if math.isfinite(kept[3]) else math.nan
    if command in POLYGONS:
        kept[0] = float(int(kept[0] + 0.5)) if 0 <= kept[0] < 65535 else 0.0
    return kept[0], kept[1], kept[2], kept[3]


def item_crc(m: Any, before: int, *, ints: bool) -> int:
    """Add one item to the checksum of an uploaded mission, fence or rally list, and return the new checksum.

    It is PX4's CRC-32 (without inversions) of the received fields. The checksum of the whole list is its
    identifier.

    before: checksum of the items before this one
    """
    raw = struct.pack("<BHB4f", m.frame, m.command, m.autocontinue, m.param1, m.param2, m.param3, m.param4)
    raw += struct.pack("<iif" if ints else "<fff", m.x, m.y, m.z)
    return zlib.crc32(raw, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def position_of(item: Item, origin: Origin, home_d: float) -> tuple[float, float, float]:
    """Return the position of a mission or rally item [m] [NED].

    home_d: height of home [m] [NED down]
    """
    n, e = local(origin, item.x, item.y)
    return n, e, home_d - item.z if item.relative else origin.alt - item.z


def local(origin: Origin, lat: float, lon: float) -> tuple[float, float]:
    """Convert latitude, longitude [deg] to north, east [m] of the local frame.

    The earth is a sphere, as in PX4.
    """
    n, e = local_from_globe(origin.lat, origin.lon, lat, lon, origin.heading)
    return float(n), float(e)


def item_message(item: Item, seq: int, kind: int, to: tuple[int, int], *, current: bool, ints: bool) -> Any:
    """Encode a mission, fence or rally item as MISSION_ITEM_INT, or as MISSION_ITEM.

    ints: True for MISSION_ITEM_INT

    to: system and component id of the client
    """
    frame, x, y = item.frame, item.x, item.y
    if item.has_position:
        relative = item.relative and kind != FENCE  # PX4 does not keep it for a fence
        frame = (_RELATIVE if relative else _ABSOLUTE)[1 if ints else 0]
        x, y = (round(x * 1e7), round(y * 1e7)) if ints else (x, y)
    auto = 0 if kind == FENCE else item.autocontinue
    if ints:
        return mavlink.MAVLink_mission_item_int_message(
            *to, seq, frame, item.command, current, auto, *item.params, _whole(x), _whole(y), item.z, kind
        )
    return mavlink.MAVLink_mission_item_message(
        *to, seq, frame, item.command, current, auto, *item.params, x, y, item.z, kind
    )


def _whole(x: float) -> int:
    return max(INT32_MIN, min(INT32_MAX, round(x))) if math.isfinite(x) else 0
