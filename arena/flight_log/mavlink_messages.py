"""Collects the MAVLink messages of one sender, and decodes all messages of a type into one numpy array."""

from __future__ import annotations

import functools
from array import array
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from arena.flight_log.resample import sender_times
from arena.geometry import Array
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_layout import layout, payload_bytes


class MessageSeries:
    """All messages of selected types from one MAVLink sender, in the order of reception.

    system_id, component_id: sender; other senders are ignored.  wanted: message ids to collect.
    """

    def __init__(self, system_id: int, component_id: int, wanted: Collection[int]) -> None:
        self._sender = system_id, component_id
        self._payloads = {number: bytearray() for number in wanted}
        self._times = {number: array("d") for number in wanted}
        self._sizes = {number: payload_bytes(number) for number in wanted}

    def add(self, time_s: float, datagram: bytes) -> None:
        """Add the messages in a datagram; damaged frames are skipped. time_s: time of reception [s]."""
        sender, payloads = self._sender, self._payloads
        for _, _, start, size, system, component, number, _, _ in parse_frames(datagram).frames:
            if number not in payloads or (system, component) != sender:
                continue
            whole = self._sizes[number]
            payload = datagram[start : start + min(size, whole)]
            payloads[number] += payload if size >= whole else payload.ljust(whole, b"\0")
            self._times[number].append(time_s)

    @property
    def first_s(self) -> float | None:
        """Time of reception of the first message [s], or None without messages."""
        return min((times[0] for times in self._times.values() if times), default=None)

    @property
    def last_s(self) -> float | None:
        """Time of reception of the last message [s], or None without messages."""
        return max((times[-1] for times in self._times.values() if times), default=None)

    def messages(self, number: int) -> Messages:
        """Return all messages of one type. number: MAVLink message id."""
        fields = np.frombuffer(bytes(self._payloads[number]), payload_dtype(number))
        return Messages(fields, np.array(self._times[number], np.float64))


class Messages:
    """All m messages of one type: their fields as arrays, and their times of reception and of sending."""

    def __init__(self, fields: NDArray[np.void], received: Array) -> None:
        self._fields, self.received = fields, received

    @property
    def size(self) -> int:
        return int(self.received.size)

    def sent(self, stamp: str = "time_boot_ms", unit_s: float = 1e-3) -> Array:
        """Return the sender's time stamps, converted to the clock of the log [s] (m,).

        stamp: field with the time stamp. unit_s: unit of the field [s].
        """
        return sender_times(self._fields[stamp] * unit_s, self.received)

    def values(self, names: str) -> Array:
        """Return the given fields of all messages as one array (m, k) of floats.

        names: field names, separated by spaces. An array field gives one column per element.
        """
        return np.asarray(structured_to_unstructured(self._fields[names.split()], dtype=np.float64))

    def numbers(self, name: str) -> NDArray[Any]:
        """Return one field of all messages without conversion to float, for example as integers (m,)."""
        return np.asarray(self._fields[name])


@functools.cache
def payload_dtype(number: int) -> np.dtype[np.void]:
    """Return the numpy type of one complete MAVLink payload. number: MAVLink message id."""
    fields = layout(number)
    formats = [
        f"S{field.elements}"
        if field.code == "s"
        else np.dtype((f"<{_kind(field.code)}", (field.elements,) if field.elements > 1 else ()))
        for field in fields.values()
    ]
    return np.dtype(
        {
            "names": list(fields),
            "formats": formats,
            "offsets": [field.offset for field in fields.values()],
            "itemsize": payload_bytes(number),
        }
    )


def _kind(code: str) -> str:
    """Convert a type code of the module `struct` to numpy's type string."""
    return np.dtype(code).str.lstrip("<>|=")
