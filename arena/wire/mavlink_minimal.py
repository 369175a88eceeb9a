"""The few MAVLink messages that `land-all` sends and reads, encoded without pymavlink.

Importing pymavlink's dialect takes longer than everything else that `land-all` does at its start. Tests
compare each message with pymavlink's bytes. The onboard heartbeat and the texts for MAV_RESULT are also in
this module, for all processes that need them.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, MavlinkSender, pack_frame, uint_at

HEARTBEAT, SYSTEM_TIME, COMMAND_LONG, COMMAND_ACK, TIMESYNC, AUTOPILOT_VERSION = 0, 2, 76, 77, 111, 148
EXTENDED_SYS_STATE, STATUSTEXT, RC_CHANNELS = 245, 253, 65
NAV_LAND, DO_SET_MODE, ARM_DISARM, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 21, 176, 400, 511, 512
TYPE_ONBOARD, AUTOPILOT_INVALID, STATE_ACTIVE = 18, 8, 4
ARMED, CUSTOM_MODE = 128, 1  # bits of base_mode
LANDED_UNKNOWN, LANDED_ON_GROUND = 0, 1  # MAV_LANDED_STATE
ACCEPTED, IN_PROGRESS = 0, 5  # MAV_RESULT
RESULT_WORDS = {
    0: "accepted",
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "in progress",
    6: "cancelled",
    7: "only as COMMAND_LONG",
    8: "only as COMMAND_INT",
    9: "unsupported frame",
}
"""MAV_RESULT -> text for the user."""
NO_UID = "none"
"""Value in place of the hardware uid if an autopilot reports none. Its address then identifies it."""

_HEARTBEAT, _COMMAND = struct.Struct("<IBBBBB"), struct.Struct("<7fHBBB")
_ACK, _EXTENDED = struct.Struct("<HB"), struct.Struct("BB")
_TEXT, _SYSTEM_TIME = struct.Struct("<B50s"), struct.Struct("<QI")
_VERSION = struct.Struct("<8xQ44x18s")  # capabilities, uid, versions and ids, uid2
_FIRMWARE_VERSION_OFFSET = 16  # flight_sw_version in AUTOPILOT_VERSION, after capabilities and uid
_CHANNEL_COUNT_OFFSET = 40  # in RC_CHANNELS, after the time and 18 channels
_ACK_BYTES = 10  # command, result, progress, result_param2 (4 bytes), target system, target component
_ONBOARD_HEARTBEAT = _HEARTBEAT.pack(0, TYPE_ONBOARD, AUTOPILOT_INVALID, 0, STATE_ACTIVE, 3)


class HeartbeatFields(NamedTuple):
    """Flight mode and armed bit of a HEARTBEAT."""

    custom_mode: int
    base_mode: int


class AckFields(NamedTuple):
    """Fields of COMMAND_ACK, an autopilot's reply to a command.

    target: (system, component) that sent the command; zeros if the autopilot does not report it.
    """

    command: int
    result: int
    target: tuple[int, int]


class HardwareUid(NamedTuple):
    """Hardware uid of an autopilot, from an AUTOPILOT_VERSION.

    uid: number of 64 bits; 0 if the autopilot does not report it
    uid2: 18 bytes; all zero if the autopilot does not report it
    """

    uid: int
    uid2: bytes

    def __str__(self) -> str:
        """Return the hardware uid in hexadecimal digits: uid2, or uid if uid2 is not reported, or "" without both."""
        if any(self.uid2):
            return self.uid2.hex()
        return f"{self.uid:016x}" if self.uid else ""

    def matches(self, recorded: str) -> bool:
        """Return whether a text is the uid of this autopilot: its uid2 or its uid, in hexadecimal digits."""
        wanted = recorded.strip().lower().removeprefix("0x")
        short = f"{self.uid:016x}" if self.uid else ""
        return bool(wanted) and wanted in (str(self), short)


class MinimalSender:
    """Encodes the messages that `land-all` sends, as one MAVLink system and component. The sequence number increases with each message."""

    def __init__(self, system: int, component: int) -> None:
        self.seq, self.srcSystem, self.srcComponent = 0, system, component

    def heartbeat(self) -> bytes:
        return pack_onboard_heartbeat(self)

    def command(self, system: int, component: int, number: int, *params: float) -> bytes:
        """Encode a COMMAND_LONG for `system` and `component`.

        params: up to seven; missing ones are 0.
        """
        filled = (*params, *(0.0,) * (7 - len(params)))
        return _pack(self, COMMAND_LONG, _COMMAND.pack(*filled, number, system, component, 0))


def pack_onboard_heartbeat(sender: MavlinkSender) -> bytes:
    """Encode the HEARTBEAT of an onboard controller.

    All processes of the arena send it, except the router, which is a ground station.

    sender: its sequence number is increased
    """
    return _pack(sender, HEARTBEAT, _ONBOARD_HEARTBEAT)


def result_words(result: int) -> str:
    """Return the text of a MAV_RESULT, such as "denied". Unknown numbers give "result 42"."""
    return RESULT_WORDS.get(result, f"result {result}")


def parse_heartbeat(data: Buffer, at: Frame) -> HeartbeatFields:
    custom, _, _, base, _, _ = _HEARTBEAT.unpack(_payload(data, at, _HEARTBEAT.size))
    return HeartbeatFields(custom, base)


def parse_landed_state(data: Buffer, at: Frame) -> int:
    """Decode an EXTENDED_SYS_STATE and return its `landed_state` (MAV_LANDED_STATE)."""
    return int(_EXTENDED.unpack(_payload(data, at, _EXTENDED.size))[1])


def parse_ack(data: Buffer, at: Frame) -> AckFields:
    payload = _payload(data, at, _ACK_BYTES)
    command, result = _ACK.unpack_from(payload)
    return AckFields(command, result, (payload[8], payload[9]))


def parse_channel_count(data: Buffer, at: Frame) -> int:
    """Decode RC_CHANNELS and return `chancount`, the number of received radio channels."""
    return uint_at(data, at, _CHANNEL_COUNT_OFFSET, 1)


def parse_statustext(data: Buffer, at: Frame) -> tuple[int, str]:
    """Decode a STATUSTEXT and return (severity as MAV_SEVERITY, text).

    The tab at its end, with which PX4 marks a text that it also sends as an event, is left out.
    """
    severity, text = _TEXT.unpack(_payload(data, at, _TEXT.size))
    return int(severity), bytes(text).rstrip(b"\0\t").decode(errors="replace")


def parse_hardware_uid(data: Buffer, at: Frame) -> HardwareUid:
    """Decode an AUTOPILOT_VERSION and return its hardware uid."""
    return HardwareUid(*_VERSION.unpack(_payload(data, at, _VERSION.size)))


def parse_firmware_version(data: Buffer, at: Frame) -> tuple[int, int, int]:
    """Decode an AUTOPILOT_VERSION and return (major, minor, patch) of the firmware; zeros if it is not reported."""
    number = uint_at(data, at, _FIRMWARE_VERSION_OFFSET, 4)
    return number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF


def parse_boot_ms(data: Buffer, at: Frame) -> int:
    """Decode a SYSTEM_TIME and return the time since the autopilot booted [ms]."""
    return int(_SYSTEM_TIME.unpack(_payload(data, at, _SYSTEM_TIME.size))[1])


def _pack(sender: MavlinkSender, msgid: int, payload: bytes) -> bytes:
    data = pack_frame(msgid, payload, sender, SEEDS[msgid])
    sender.seq = (sender.seq + 1) % 256
    return data


def _payload(data: Buffer, at: Frame, size: int) -> bytes:
    """Return the first `size` bytes of a payload. Zeros replace bytes that MAVLink 2 has truncated."""
    return bytes(data[at.payload : at.payload + min(at.size, size)]).ljust(size, b"\0")
