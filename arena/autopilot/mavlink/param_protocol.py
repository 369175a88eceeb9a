"""The parameter protocol of one vehicle, as PX4 speaks it: list, read, write, hash. Messages in, messages out.

Only what names this system is answered: PX4 takes no broadcast here. What it meets with silence (unknown names, other types,
indices beyond the end) is met with silence. One thing is not PX4's: a value that is not finite or out of its documented range
is refused, by telling the value that stays.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.param_table import SPECS, Params

HASH = "_HASH_CHECK"
_PER_STEP = 8
_NO_INDEX = 65535
HEARD = (
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_PARAM_SET,
)


@dataclass(slots=True)
class ParamServer:
    """i: row in the fleet. refused: sentences about writes that were not taken, for whoever tells people."""

    i: int
    params: Params
    refused: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    _left: dict[str, deque[str]] = field(default_factory=dict)

    def hear(self, link: str, m: Any) -> list[Any]:
        """A message that names this vehicle -> answers for the same link."""
        kind = m.get_msgId()
        if kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            again = bool(self._left.get(link))
            self._left[link] = deque(self.params.names if again else [HASH, *self.params.names])
            return []
        if kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
            return self._read(m)
        return self._write(link, m)

    @property
    def busy(self) -> bool:
        """Is a list being told?"""
        return any(self._left.values())

    def speak(self, link: str) -> list[Any]:
        """The next few of a list that was asked for on this link."""
        left = self._left.get(link)
        return [self.value(left.popleft()) for _ in range(min(_PER_STEP, len(left)))] if left else []

    def value(self, name: str) -> Any:
        """PARAM_VALUE of a name that exists."""
        count = len(self.params.names)
        if name == HASH:
            carried = _carried("<I", self.hash())
            return mavlink.MAVLink_param_value_message(
                HASH.encode(), carried, mavlink.MAV_PARAM_TYPE_UINT32, count, _NO_INDEX
            )
        value, kind = float(self.params[name][self.i]), mavlink.MAV_PARAM_TYPE_REAL32
        if SPECS[name].type == "int32":
            value, kind = _carried("<i", int(value)), mavlink.MAV_PARAM_TYPE_INT32
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, count, self.params.index[name])

    def hash(self) -> int:
        """Changes with any name or value: a ground station that knows it need not list again."""
        found = 0
        for name in self.params.names:
            value = float(self.params[name][self.i])
            raw = struct.pack("<i", int(value)) if SPECS[name].type == "int32" else struct.pack("<f", value)
            found = zlib.crc32(name.encode() + raw, found)
        return found

    def _read(self, m: Any) -> list[Any]:
        names = self.params.names
        if m.param_index >= 0:
            return [self.value(names[m.param_index])] if m.param_index < len(names) else []
        return [self.value(m.param_id)] if m.param_id in self.params or m.param_id == HASH else []

    def _write(self, link: str, m: Any) -> list[Any]:
        if m.param_id == HASH:  # the ground station has it all already
            self._left.pop(link, None)
            return []
        spec = SPECS.get(m.param_id)
        if spec is None:
            self.counts["unknown parameter"] += 1
            return []
        if m.param_type != (
            mavlink.MAV_PARAM_TYPE_INT32 if spec.type == "int32" else mavlink.MAV_PARAM_TYPE_REAL32
        ):
            self.counts["parameter of another type"] += 1
            return []
        value = (
            struct.unpack("<i", struct.pack("<f", m.param_value))[0]
            if spec.type == "int32"
            else m.param_value
        )
        try:
            self.params.set(self.i, m.param_id, value)
        except ValueError as error:
            self.refused.append(str(error))
        return [self.value(m.param_id)]


def _carried(layout: str, value: int) -> float:
    """An integer's bytes in the float's place."""
    return float(struct.unpack("<f", struct.pack(layout, value))[0])
