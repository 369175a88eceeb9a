"""Writes the periodic ULog records of the built-in autopilots to memory, which contains the records of one second.

`arena.autopilot.ulog.layout` makes the tables, so neither topics nor fields are in this module.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import flags

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Integers
    from arena.kernels.ulog_quantities import UlogQuantities

_COLUMN, _COUNT, _AT, _SIZE, _IS_FLOAT = range(5)
_FIRST_FIELD, _STATE_AT, _STATE_SIZE = range(3)
_TOPIC, _RECORD_AT = range(2)
_FIRST_RECORD, _GROUPS = range(2)
"""Columns of the tables."""
_FLOAT32_BYTES = 4


class UlogRecords:
    """Writer of the periodic ULog records of V vehicles.

    All vehicles record the same topics in the same steps. The records have fields at any byte, because ULog has no padding.

    quantities: computes the values of the fields
    rows: the records of a cycle (V, B). They contain all bytes that never change
    state: records that are copied: the newest ones of topics about mode, arming and failsafes (V, S)
    is_logged: input: True for a vehicle whose records are written (V,)
    fields: for each field with a quantity: position of its value in `UlogQuantities.values`, number of values, offset in the
        record [bytes], size of one value [bytes], and 1 for floating point, 0 for an unsigned integer (F, 5)
    topics: for each topic: its first field, offset of its record in a row of `state` and size of this record [bytes]; the size
        is 0 for a record that is not copied. The last row contains only the number of fields (T + 1, 3)
    records: for each record of a cycle: its topic, and its offset in a row [bytes] (N, 2)
    steps: for each step of a cycle: its first record, and the groups of quantities, see `UlogQuantities.compute`. The last row
        contains only the number of records (K + 1, 2)
    """

    def __init__(
        self,
        quantities: UlogQuantities,
        rows: memoryview[int],
        state: memoryview[int],
        is_logged: NDArray[np.bool_],
        fields: Integers,
        topics: Integers,
        records: Integers,
        steps: Integers,
    ) -> None:
        self.quantities, self.rows, self.state, self.is_logged = quantities, rows, state, flags(is_logged)
        self.fields, self.topics, self.records, self.steps = fields, topics, records, steps
        raw = memoryview(bytearray(8))
        self._raw, self._float32, self._float64 = raw, raw.cast("f"), raw.cast("d")

    def write(self, step: int, now: float, time_us: float) -> None:
        """Write the records of one step of the cycle, for all vehicles that are logged.

        now, time_us: time since boot [s], and as an integer [us]
        """
        self.quantities.set_time(now, time_us)
        for i in range(len(self.is_logged)):
            if self.is_logged[i]:
                self.quantities.compute(i, self.steps[step, _GROUPS])
                for record in range(self.steps[step, _FIRST_RECORD], self.steps[step + 1, _FIRST_RECORD]):
                    self._write_record(i, self.records[record, _TOPIC], self.records[record, _RECORD_AT])

    def _write_record(self, i: int, topic: int, at: int) -> None:
        """Write a record of vehicle i. at: its offset in the row [bytes]"""
        source = self.topics[topic, _STATE_AT]
        for k in range(self.topics[topic, _STATE_SIZE]):
            self.rows[i, at + k] = self.state[i, source + k]
        for field in range(self.topics[topic, _FIRST_FIELD], self.topics[topic + 1, _FIRST_FIELD]):
            column, size = self.fields[field, _COLUMN], self.fields[field, _SIZE]
            to, is_float = at + self.fields[field, _AT], self.fields[field, _IS_FLOAT]
            for k in range(self.fields[field, _COUNT]):
                if is_float:
                    self._store_float(i, to + k * size, self.quantities.values[column + k], size)
                else:
                    self._store_integer(i, to + k * size, self.quantities.values[column + k], size)

    def _store_float(self, i: int, at: int, value: float, size: int) -> None:
        if size == _FLOAT32_BYTES:
            self._float32[0] = value
        else:
            self._float64[0] = value
        for k in range(size):
            self.rows[i, at + k] = self._raw[k]

    def _store_integer(self, i: int, at: int, value: float, size: int) -> None:
        """Store a number of at least 0, truncated to an integer. The first byte is the least significant."""
        whole = int(value)
        for k in range(size):
            self.rows[i, at + k] = whole & 0xFF
            whole >>= 8
