"""MAVLink's parameter protocol for one vehicle, as PX4 implements it: list, read, write, hash.

Input and output are messages.

Like PX4, it sends no reply to an unknown name, a wrong type or an index that does not exist. Unlike PX4, it
refuses
a value that is not finite or outside its documented range: the reply then contains the old value.
"""

from __future__ import annotations

import struct
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.param_table import Params
from arena.builtin_parameters import SPECS, effect_problem
from arena.wire.px4_messages import px4_crc32

HASH_NAME = "_HASH_CHECK"
_VALUES_PER_STEP = 8
_NO_INDEX = 65535
MESSAGE_IDS = (
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_PARAM_SET,
)


@dataclass(slots=True)
class ParamServer:
    """Server of MAVLink's parameter protocol: lists, reads and writes the parameters of one vehicle.

    row: row of the vehicle in the parameter table
    refused: reasons of refused writes; the reader removes them
    """

    row: int
    params: Params
    refused: list[str] = field(default_factory=list)
    without_effect: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    _to_list: dict[str, deque[str]] = field(default_factory=dict)

    def receive(self, link: str, m: Any) -> list[Any]:
        """Process a PARAM_* message to this vehicle. Return the replies for the same link."""
        kind = m.get_msgId()
        if kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            again = bool(self._to_list.get(link))
            self._to_list[link] = deque(self.params.names if again else [HASH_NAME, *self.params.names])
            return []
        if kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
            return self._read(m)
        return self._write(link, m)

    @property
    def busy(self) -> bool:
        """True while a parameter list is being sent on any link."""
        return any(self._to_list.values())

    def next_messages(self, link: str) -> list[Any]:
        """Return the next PARAM_VALUE messages of the list that a client requested on this link."""
        left = self._to_list.get(link)
        return [self.value(left.popleft()) for _ in range(min(_VALUES_PER_STEP, len(left)))] if left else []

    def value(self, name: str) -> Any:
        """Return the PARAM_VALUE message of a parameter. The parameter must exist."""
        count = len(self.params.names)
        if name == HASH_NAME:
            value = _as_float_bytes("<I", self.hash())
            return mavlink.MAVLink_param_value_message(
                HASH_NAME.encode(), value, mavlink.MAV_PARAM_TYPE_UINT32, count, _NO_INDEX
            )
        value, kind = float(self.params[name][self.row]), mavlink.MAV_PARAM_TYPE_REAL32
        if SPECS[name].type == "int32":
            value, kind = _as_float_bytes("<i", int(value)), mavlink.MAV_PARAM_TYPE_INT32
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, count, self.params.index[name])

    def hash(self) -> int:
        """Return PX4's hash of all parameter names and values (a CRC-32).

        A ground station that has cached the same hash need not request the list.
        """
        found = 0
        for name in self.params.names:
            value = float(self.params[name][self.row])
            raw = struct.pack("<i", int(value)) if SPECS[name].type == "int32" else struct.pack("<f", value)
            found = px4_crc32(name.encode() + raw, found)
        return found

    def _read(self, m: Any) -> list[Any]:
        names = self.params.names
        if m.param_index >= 0:
            return [self.value(names[m.param_index])] if m.param_index < len(names) else []
        return [self.value(m.param_id)] if m.param_id in self.params or m.param_id == HASH_NAME else []

    def _write(self, link: str, m: Any) -> list[Any]:
        if m.param_id == HASH_NAME:  # the ground station has all values already
            self._to_list.pop(link, None)
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
            changed = value != self.params[m.param_id][self.row]
            self.params.set(self.row, m.param_id, value)
        except ValueError as error:
            self.refused.append(str(error))
        else:
            if changed and (why := effect_problem(m.param_id, value)):
                self.without_effect.append(why)
        return [self.value(m.param_id)]


def _as_float_bytes(layout: str, value: int) -> float:
    """Return the float that has the same four bytes as an integer.

    PARAM_VALUE contains integers in this form.

    layout: struct format of the integer.
    """
    return float(struct.unpack("<f", struct.pack(layout, value))[0])
