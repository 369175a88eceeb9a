"""Memory for the periodic ULog records of all vehicles during one second; overwritten every second.

All vehicles record the same topics at the same steps, so the records of a topic have the same place in the row of each vehicle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.ulog.message_formats import FORMATS
from arena.autopilot.ulog.topics import PERIODIC, STATE
from arena.kernels.arrays import integers, octets
from arena.kernels.ulog_quantities import (
    BITS,
    COLUMNS,
    GROUPS,
    SIZES,
    USE_SENSORS,
    USE_VEHICLES,
    UlogQuantities,
)
from arena.kernels.ulog_records import UlogRecords
from arena.wire.ulog_messages import record_type, set_record_head

if TYPE_CHECKING:
    from arena.kernels.arrays import Integers

Bytes = NDArray[np.uint8]
Records = NDArray[np.void]
_CYCLE_S = 1.0
_GROUPS = {quantity: BITS[group] for group, quantities in GROUPS.items() for quantity in quantities}


@dataclass(frozen=True, slots=True)
class Step:
    """Work that Python must do in one sensor period before the kernel writes the records. The steps repeat every second.

    uses_vehicles: the records contain values of the vehicles' commanders, such as the arming state
    uses_sensors: the records contain measurements, such as the magnetic field
    end: number of bytes in a row after this step
    """

    uses_vehicles: bool
    uses_sensors: bool
    end: int


class Layout:
    """Memory for the periodic ULog records of V vehicles during one second; overwritten every second.

    rows: the bytes of the records (V, B)
    steps: work of each step of the cycle
    state: topic of `STATE` -> newest records of all vehicles, written by `FlightState` (V,)
    is_logged: True for a vehicle whose records are written (V,)
    law: the compiled writer of the records
    """

    def __init__(self, vehicles: int, period_s: float, quantities: UlogQuantities) -> None:
        """Reserve the memory, and compute which ULog records are filled in each sensor period.

        period_s: sensor period [s]
        """
        self._types = {topic: record_type(FORMATS[topic]) for topic in PERIODIC}
        self._numbers = {topic: number for number, topic in enumerate(PERIODIC)}
        ends = np.cumsum([0, *(self._types[topic].itemsize for topic in STATE)]).tolist()
        self._state_at = dict(zip(STATE, ends, strict=False))
        state = np.zeros((vehicles, ends[-1]), np.uint8)
        self.state = {topic: self._state_records(state, topic) for topic in STATE}
        count = max(1, round(_CYCLE_S / period_s))
        due = [[topic for topic in PERIODIC if _is_due(topic, k, period_s)] for k in range(count)]
        size = sum(self._types[topic].itemsize for topics in due for topic in topics)
        self.rows: Bytes = np.zeros((vehicles, size), np.uint8)
        self.is_logged = np.zeros(vehicles, bool)
        records, steps, self.steps = self._place(due)
        self.law = UlogRecords(
            quantities,
            octets(self.rows),
            octets(state),
            self.is_logged,
            *self._fields(),
            records,
            steps,
        )

    def _state_records(self, rows: Bytes, topic: str) -> Records:
        """Return the records of one topic of `STATE` (V,), which share the memory of `rows`.

        rows: bytes of the records of all topics of `STATE` (V, S)
        """
        kind, at = self._types[topic], self._state_at[topic]
        records: Records = rows[:, at : at + kind.itemsize].view(kind)[:, 0]
        set_record_head(records, self._numbers[topic])
        return records

    def _place(self, due: list[list[str]]) -> tuple[Integers, Integers, list[Step]]:
        """Write the bytes of all records that never change. Return the tables `records` and `steps` of the kernel, and the steps.

        due: topics of each step
        """
        templates = {topic: self._template(topic) for topic in PERIODIC}
        records: list[tuple[int, ...]] = []
        table: list[tuple[int, ...]] = []
        steps, at = [], 0
        for topics in due:
            groups, first = 0, len(records)
            for topic in topics:
                records.append((self._numbers[topic], at))
                end = at + self._types[topic].itemsize
                self.rows[:, at:end] = templates[topic]
                groups |= _groups(topic)
                at = end
            table.append((first, groups))
            steps.append(Step(groups & USE_VEHICLES != 0, groups & USE_SENSORS != 0, at))
        table.append((len(records), 0))
        return _table(records), _table(table), steps

    def _template(self, topic: str) -> Bytes:
        """Return the bytes of one record of a topic: constant fields have their value, all other fields are 0."""
        record = np.zeros(1, self._types[topic])
        set_record_head(record, self._numbers[topic])
        for name, content in PERIODIC[topic].fields.items():
            if not isinstance(content, str):
                _field(record, name)[...] = content
        return record.view(np.uint8)

    def _fields(self) -> tuple[Integers, Integers]:
        """Return the tables `fields` and `topics` of the kernel."""
        fields: list[tuple[int, ...]] = []
        topics: list[tuple[int, ...]] = []
        for topic, kind in self._types.items():
            is_copied = topic in STATE
            topics.append((len(fields), self._state_at.get(topic, 0), kind.itemsize if is_copied else 0))
            for name, content in PERIODIC[topic].fields.items():
                if isinstance(content, str):
                    fields.append(
                        (COLUMNS[content], SIZES[content], *_place_in_record(kind, name, SIZES[content]))
                    )
        return _table(fields), _table([*topics, (len(fields), 0, 0)])


def _table(rows: list[tuple[int, ...]]) -> Integers:
    return integers(np.array(rows, np.int64))


def _groups(topic: str) -> int:
    """Return the groups of quantities of a ULog topic, as a sum of `BITS`."""
    groups = 0
    for content in PERIODIC[topic].fields.values():
        groups |= _GROUPS[content] if isinstance(content, str) else 0
    return groups


def _place_in_record(kind: np.dtype[np.void], name: str, count: int) -> tuple[int, int, bool]:
    """Return the offset of a field in a record [bytes], the size of one number [bytes], and whether it is a floating point number.

    name: field (`xyz`), or an element of a field (`xyz[2]`)
    count: number of values that are written

    Raises ValueError for a field with another number of values.
    """
    record = np.zeros(1, kind)
    field = _field(record, name)
    if field.size != count or field.dtype.kind not in "fu":
        raise ValueError(
            f"field {name}: {field.size} numbers of the type {field.dtype}, expected {count} of f or u"
        )
    at = field.__array_interface__["data"][0] - record.__array_interface__["data"][0]
    return at, field.itemsize, field.dtype.kind == "f"


def _is_due(topic: str, k: int, period_s: float) -> bool:
    """Return whether a topic is recorded in the sensor period with number k of each second.

    The slow topics begin at different steps, so that no step has much more work than the others.
    """
    wanted_s = PERIODIC[topic].period_s
    if wanted_s <= period_s:
        return True
    shifted = k + list(PERIODIC).index(topic)
    return math.floor(shifted * period_s / wanted_s + 1e-6) > math.floor(
        (shifted - 1) * period_s / wanted_s + 1e-6
    )


def _field(records: Records, name: str) -> NDArray[Any]:
    """Return a field (`xyz`), or an element of a field (`xyz[2]`), of the ULog records of all vehicles.

    name: such as `xyz` or `xyz[2]`
    """
    name, _, element = name.rstrip("]").partition("[")
    return records[name][:, int(element)] if element else records[name]
