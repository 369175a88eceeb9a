"""Recorded messages in the order of time, the input of a replay. Pure.

A script is made from the record of an arena (`record_script`) or from logs of flights (`flight_script`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol

from arena.replay.parameters import ParameterHistory
from arena.wire.flight_record import RecordedFrame

NS = 1_000_000_000
"""Nanoseconds per second. Times are whole nanoseconds, as in the record, so that no time changes by rounding."""


class Kind(IntEnum):
    """Kind of a recorded message: MAVLink datagram, motion capture frame, true state or event.

    DOWN, UP: MAVLink datagram from a vehicle, or to it.  FRAME: frame of motion capture.  TRUTH: true state of a vehicle.
    EVENT: line of events.jsonl.
    """

    DOWN = 0
    UP = 1
    FRAME = 2
    TRUTH = 3
    EVENT = 4


class TrueState(NamedTuple):
    """True state of a vehicle: position, velocity, attitude and body rates.

    p_n [m] [NED] (3,), v_n [m/s] [NED] (3,), q_nb [-] wxyz (4,), omega_b [rad/s] [FRD] (3,).
    """

    p_n: tuple[float, ...]
    v_n: tuple[float, ...]
    q_nb: tuple[float, ...]
    omega_b: tuple[float, ...]


class RecordedLine(NamedTuple):
    """Recorded line of the event file events.jsonl.

    line: JSON object as bytes.
    fields: its content.
    """

    line: bytes
    fields: Mapping[str, Any]


Payload = bytes | RecordedFrame | TrueState | RecordedLine


class Item(NamedTuple):
    """Recorded message with its time, kind and vehicle.

    time_ns: time by the clock of the record [ns].  vehicle: index in `Script.vehicles`, -1 if it belongs to none.
    payload: datagram (DOWN, UP), frame, true state or event.
    """

    time_ns: int
    kind: Kind
    vehicle: int
    payload: Payload


@dataclass(frozen=True, kw_only=True)
class ScriptVehicle:
    """Vehicle of a recorded flight.

    name, body: its name, and that of its rigid body in the motion capture.  id: MAVLink system id.
    simulated: whether a simulated vehicle was recorded.  autopilot: `builtin`, `px4`, `hitl` or `hardware`, "" if unknown.
    profile: name of its profile, "" if unknown.
    """

    name: str
    id: int
    body: str
    simulated: bool
    autopilot: str = ""
    profile: str = ""


class Script(Protocol):
    """Interface of a source of recorded messages, which a replay sends in their order.

    vehicles: vehicles of the flight.  start_ns, end_ns: times of the first and the last message [ns].
    bodies: names of all rigid bodies in the frames of motion capture.
    """

    @property
    def vehicles(self) -> tuple[ScriptVehicle, ...]: ...

    @property
    def bodies(self) -> frozenset[str]: ...

    @property
    def start_ns(self) -> int: ...

    @property
    def end_ns(self) -> int: ...

    @property
    def parameters(self) -> Sequence[ParameterHistory]:
        """Autopilot parameters of each vehicle during the flight."""

    def items(self, from_ns: int) -> Iterator[Item]:
        """Yield the messages at or after the time `from_ns` [ns], in the order of recording."""


def nanoseconds(time_s: float) -> int:
    """Convert a time [s] to nanoseconds."""
    return round(time_s * NS)
