"""Parameters of replayed vehicles: their values during the flight, and replies to parameter requests. Pure.

The values at the start are those of the ULog of the flight. Each PARAM_VALUE in the record changes one value. A request for a parameter
that is neither in the ULog nor in the record gets no reply, as for a parameter that the autopilot does not have.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from arena.errors import WireError
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, parse_frames
from arena.wire.mavlink_params import (
    HASH,
    REQUEST_LIST,
    REQUEST_READ,
    SET,
    VALUE,
    Value,
    parse_requested,
    parse_set_name,
    parse_value,
    value_message,
)
from arena.wire.qgc_params import INT32, REAL32
from arena.wire.ulog import parse_ulog

_VALUE_ID = VALUE.to_bytes(3, "little")  # in the head of a MAVLink 2 frame
_VALUES_PER_CALL = 8
_DEFINITIONS_BYTES = 1 << 20  # more than the definitions of a ULog, which contain the parameters


class Stored(NamedTuple):
    """Recorded value of a parameter, with its type.

    kind: MAV_PARAM_TYPE.
    """

    value: float
    kind: int


class ParameterHistory:
    """Values of one vehicle's parameters during a flight.

    initial: name -> value at the start.
    """

    def __init__(self, initial: Mapping[str, Stored] | None = None) -> None:
        self._values: dict[str, list[tuple[int, Stored]]] = {
            name: [(0, value)] for name, value in (initial or {}).items()
        }

    def add(self, time_ns: int, datagram: bytes) -> None:
        """Store the parameter values of a recorded datagram (PARAM_VALUE). Call it in the order of time.

        time_ns: time of the datagram by the clock of the record [ns].
        """
        if _VALUE_ID not in datagram:
            return
        for at in parse_frames(datagram).frames:
            if at.msgid == VALUE and at.compid == AUTOPILOT:
                found = parse_value(datagram, at)
                if found.name != HASH:
                    self._take(time_ns, found.name, Stored(found.value, found.kind))

    def _take(self, time_ns: int, name: str, value: Stored) -> None:
        known = self._values.setdefault(name, [(0, value)])
        if known[-1][1] != value:
            known.append((time_ns, value))

    @property
    def names(self) -> list[str]:
        """Names of all parameters in alphabetical order, which is the order of PX4."""
        return sorted(self._values)

    def at(self, name: str, time_ns: int) -> Stored | None:
        """Return the value of a parameter at a time of the record [ns], or None if the parameter is unknown."""
        known = self._values.get(name)
        if known is None:
            return None
        return known[max(0, bisect_right(known, time_ns, key=itemgetter(0)) - 1)][1]


class ParameterReplies:
    """Parameter server of all replayed vehicles: replies to parameter requests with the recorded values.

    histories: parameters of each vehicle.
    ids: MAVLink system id of each vehicle.
    """

    def __init__(self, histories: Sequence[ParameterHistory], ids: Sequence[int]) -> None:
        self._histories, self._codecs = histories, [Codec(system, AUTOPILOT) for system in ids]
        self._places = [{name: place for place, name in enumerate(history.names)} for history in histories]
        self._to_list: list[deque[str]] = [deque() for _ in ids]

    def on_datagram(self, vehicle: int, datagram: bytes, record_ns: int) -> list[bytes]:
        """Return the replies to the parameter requests in a datagram.

        PARAM_SET does not change a value: the reply contains the recorded value.

        vehicle: index of the receiver.  record_ns: present place in the record [ns].
        """
        replies = []
        for at in parse_frames(datagram).frames:
            if at.msgid == REQUEST_LIST:
                self._to_list[vehicle] = deque(self._places[vehicle])
            elif at.msgid in (REQUEST_READ, SET):
                name = (
                    parse_set_name(datagram, at)
                    if at.msgid == SET
                    else self._name(vehicle, *parse_requested(datagram, at))
                )
                replies.append(self._value(vehicle, name, record_ns))
        return [reply for reply in replies if reply]

    def next_values(self, record_ns: int) -> list[tuple[int, bytes]]:
        """Return the next PARAM_VALUE messages of the requested parameter lists, as (vehicle, datagram).

        Call it regularly: each call returns only some of the messages.
        """
        found = []
        for vehicle, left in enumerate(self._to_list):
            if left:
                names = [left.popleft() for _ in range(min(_VALUES_PER_CALL, len(left)))]
                found.append((vehicle, b"".join(self._value(vehicle, name, record_ns) for name in names)))
        return found

    def _name(self, vehicle: int, index: int, name: str) -> str:
        names = list(self._places[vehicle])
        return name if index < 0 else names[index] if index < len(names) else ""

    def _value(self, vehicle: int, name: str, record_ns: int) -> bytes:
        stored, places = self._histories[vehicle].at(name, record_ns), self._places[vehicle]
        if stored is None:
            return b""
        value = Value(name, stored.value, stored.kind, places[name], len(places))
        return self._codecs[vehicle].frame(*value_message(value))


def parameters_of_ulog(path: Path) -> dict[str, Stored]:
    """Return the parameters at the start of a ULog. The result is empty if the file is not a readable ULog."""
    try:
        with path.open("rb") as file:
            log = parse_ulog(file.read(_DEFINITIONS_BYTES))
    except (OSError, WireError):
        return {}
    return {
        name: Stored(int(value), INT32) if log.types.get(name) == "INT32" else Stored(value, REAL32)
        for name, value in log.initial.items()
    }
