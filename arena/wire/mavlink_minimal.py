"""The few messages of the panic path as bytes, without pymavlink.

Its dialect alone costs more to load than all the rest, and much more where no bytecode of it lies on the disk. Tests hold each
message to pymavlink's bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, frame

HEARTBEAT, COMMAND_LONG, COMMAND_ACK, EXTENDED_SYS_STATE = 0, 76, 77, 245
NAV_LAND, DO_SET_MODE, ARM_DISARM, SET_MESSAGE_INTERVAL = 21, 176, 400, 511
TYPE_ONBOARD, AUTOPILOT_INVALID, STATE_ACTIVE = 18, 8, 4
ARMED, CUSTOM_MODE = 128, 1  # bits of base_mode
LANDED_UNKNOWN, LANDED_ON_GROUND = 0, 1
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, CANCELLED = 0, 1, 2, 3, 4, 6

_HEARTBEAT, _COMMAND = struct.Struct("<IBBBBB"), struct.Struct("<7fHBBB")
_ACK, _EXTENDED = struct.Struct("<HB"), struct.Struct("BB")


class Voice:
    """Speaks as one system and component."""

    def __init__(self, system: int, component: int) -> None:
        self.seq, self.srcSystem, self.srcComponent = 0, system, component

    def heartbeat(self) -> bytes:
        """Of an onboard controller."""
        return self._frame(HEARTBEAT, _HEARTBEAT.pack(0, TYPE_ONBOARD, AUTOPILOT_INVALID, 0, STATE_ACTIVE, 3))

    def command(self, system: int, component: int, number: int, *params: float) -> bytes:
        """COMMAND_LONG. params: up to seven; the others are 0."""
        filled = (*params, *(0.0,) * (7 - len(params)))
        return self._frame(COMMAND_LONG, _COMMAND.pack(*filled, number, system, component, 0))

    def _frame(self, msgid: int, payload: bytes) -> bytes:
        data = frame(msgid, payload, self, SEEDS[msgid])
        self.seq = (self.seq + 1) % 256
        return data


class Beat(NamedTuple):
    custom_mode: int
    base_mode: int


class Ack(NamedTuple):
    """target: system and component that it is for; 0 for one that does not say."""

    command: int
    result: int
    target: tuple[int, int]


def heartbeat_of(data: Buffer, at: Frame) -> Beat:
    custom, _, _, base, _, _ = _HEARTBEAT.unpack(_payload(data, at, _HEARTBEAT.size))
    return Beat(custom, base)


def landed_of(data: Buffer, at: Frame) -> int:
    """EXTENDED_SYS_STATE.landed_state"""
    return int(_EXTENDED.unpack(_payload(data, at, _EXTENDED.size))[1])


def ack_of(data: Buffer, at: Frame) -> Ack:
    payload = _payload(
        data, at, 10
    )  # command, result, progress, a number of four bytes, target system and component
    command, result = _ACK.unpack_from(payload)
    return Ack(command, result, (payload[8], payload[9]))


def _payload(data: Buffer, at: Frame, size: int) -> bytes:
    """With the zeros that MAVLink 2 cuts off."""
    return bytes(data[at.payload : at.payload + min(at.size, size)]).ljust(size, b"\0")
