"""Synthetic scripts for the tests of the replay."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from arena.replay.parameters import ParameterHistory
from arena.replay.script import Item, Kind, ScriptVehicle
from arena.wire.mavlink_codec import Codec

MS = 1_000_000
UAV1 = ScriptVehicle(name="uav1", id=1, body="uav1", simulated=True)


@dataclass(frozen=True, kw_only=True)
class ListScript:
    """Script with a list of messages."""

    messages: Sequence[Item]
    vehicles: tuple[ScriptVehicle, ...] = (UAV1,)
    bodies: frozenset[str] = frozenset({"uav1"})
    parameters: tuple[ParameterHistory, ...] = (ParameterHistory(),)

    @property
    def start_ns(self) -> int:
        return self.messages[0].time_ns

    @property
    def end_ns(self) -> int:
        return self.messages[-1].time_ns

    def items(self, from_ns: int) -> Iterator[Item]:
        return (item for item in self.messages if item.time_ns >= from_ns)


def heartbeat(system: int = 1, mode: int = 0) -> bytes:
    """Return the datagram of a HEARTBEAT. mode: its custom_mode."""
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 1, mode, mavlink.MAV_STATE_ACTIVE, 3
    )
    return Codec(system, 1).pack(message)


def position(system: int, x: float) -> bytes:
    """Return the datagram of a LOCAL_POSITION_NED with this north position [m]."""
    return Codec(system, 1).pack(mavlink.MAVLink_local_position_ned_message(0, x, 0.0, 0.0, 0.0, 0.0, 0.0))


def down(time_ms: int, data: bytes) -> Item:
    """Return a datagram from the first vehicle at a time [ms]."""
    return Item(time_ms * MS, Kind.DOWN, 0, data)
