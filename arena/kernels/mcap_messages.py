"""Collects the messages of an MCAP file in memory, and makes their index.

`arena.recorder.mcap_records` packs the other records of the file. The recorder logs tens of messages per step of the world.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.viewer_meters import nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from arena.kernels.arrays import Integers
    from arena.kernels.viewer_meters import Datagram

    Log = Callable[[bytes, int], None]

_MESSAGE = 5  # MCAP's opcode
# Bytes of a record before its content: opcode and size. Those of a message before its data: channel, sequence number, two times.
_RECORD_HEAD, _MESSAGE_HEAD = 9, 22
# Positions in a buffer in which the numbers are aligned, except the size, which is written in two halves.
_OPCODE, _SIZE, _CHANNEL, _SEQUENCE, _LOG_TIME, _PUBLISH_TIME, _DATA = 9, 10, 18, 20, 24, 32, 40
_LATEST = (1 << 63) - 1
_NUMBER_BYTES = 8


class MessageBuffer:
    """Buffer of records: messages, and before the first message of each channel the definition of the channel.

    define: function that returns the records with which a channel is defined, by its number.
    """

    def __init__(self, define: Callable[[int], bytes]) -> None:
        self._define = define
        head = memoryview(bytearray(_DATA))
        head[_OPCODE] = _MESSAGE
        self._head = head[_OPCODE:]
        self._u16, self._u32, self._u64 = head.cast("H"), head.cast("I"), head.cast("Q")
        self._records = bytearray()
        self._first, self._last = _LATEST, 0
        self._is_open = True

    def add(self, channel: int, sequence: int, data: bytes, log_time: int) -> None:
        """Add a message.

        channel: number of its channel.  sequence: its number in the channel, from 1 on.  log_time: [ns].
        """
        if not self._is_open:
            return
        if sequence == 1:
            self._records += self._define(channel)
        size = _MESSAGE_HEAD + len(data)
        self._u16[_SIZE // 2], self._u16[_SIZE // 2 + 1] = size & 0xFFFF, size >> 16
        self._u16[_CHANNEL // 2], self._u32[_SEQUENCE // 4] = channel, sequence & 0xFFFFFFFF
        self._u64[_LOG_TIME // 8] = self._u64[_PUBLISH_TIME // 8] = log_time
        self._records += self._head
        self._records += data
        self._first, self._last = min(self._first, log_time), max(self._last, log_time)

    def take(self) -> tuple[bytes, int, int]:
        """Return the records since the last call, and the first and the last log time in them [ns]."""
        found = bytes(self._records), self._first, self._last
        self._records.clear()
        self._first, self._last = _LATEST, 0
        return found

    def stop(self) -> None:
        """Remove all records, and ignore later messages."""
        self._is_open = False
        self._records.clear()


class MessageChannel:
    """Channel of an MCAP file.

    number: of the channel in the file.  count: number of its messages.
    """

    def __init__(self, buffer: MessageBuffer, number: int) -> None:
        self._buffer, self.number, self.count = buffer, number, 0

    def log(self, data: bytes, log_time: int) -> None:
        """Send a message of this channel to the buffer. log_time: time of the message [ns]."""
        self.count += 1
        self._buffer.add(self.number, self.count, data, log_time)


def log_datagrams(datagrams: list[Datagram], down: Mapping[str, Log], up: Mapping[str, Log]) -> None:
    """Log datagrams unchanged.

    datagrams: (vehicle, up, data, time of reception [s]) of each.
    down, up: vehicle name -> function (data, log time [ns]) that logs a datagram from the vehicle, or to it.
    """
    for vehicle, is_up, data, time_s in datagrams:
        log = up[vehicle] if is_up else down[vehicle]
        log(data, nanoseconds(time_s))


def message_index(records: bytes, channels: int) -> list[bytes]:
    """Return the message index of each channel, in the order of their numbers: log time and place of each message.

    records: all records of a chunk, as from `MessageBuffer.take`.  channels: number of channels. Their numbers begin with 1.
    """
    ends, total = _integers(channels + 1), 0
    at, size = 0, len(records)
    while at < size:
        if records[at] == _MESSAGE:
            ends[_number(records, at + _RECORD_HEAD, 2)] += 1
        at += _RECORD_HEAD + _number(records, at + 1, _NUMBER_BYTES)
    begins = _integers(channels + 1)
    for k in range(channels + 1):
        begins[k] = total
        total += ends[k]
        ends[k] = begins[k]
    raw = memoryview(bytearray(2 * _NUMBER_BYTES * total))
    entries = raw.cast("l")
    at = 0
    while at < size:
        if records[at] == _MESSAGE:
            channel = _number(records, at + _RECORD_HEAD, 2)
            entry = 2 * ends[channel]
            entries[entry], entries[entry + 1] = _number(records, at + _LOG_TIME - _OPCODE, _NUMBER_BYTES), at
            ends[channel] += 1
        at += _RECORD_HEAD + _number(records, at + 1, _NUMBER_BYTES)
    return [
        bytes(raw[2 * _NUMBER_BYTES * begins[k] : 2 * _NUMBER_BYTES * ends[k]])
        for k in range(1, channels + 1)
    ]


def _number(data: bytes, at: int, size: int) -> int:
    """Return the number in some bytes, little endian."""
    found = 0
    for k in range(size):
        part = data[at + k]
        found += part << 8 * k
    return found


def _integers(count: int) -> Integers:
    return memoryview(bytearray(_NUMBER_BYTES * count)).cast("l")
