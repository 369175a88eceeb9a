"""Finds the newest frame of each kind of telemetry in datagrams of one autopilot. A frame is decoded when its value is read.

`arena.wire.mavlink_frame` describes the layout of frames.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.mavlink_frame_types import Frame
from arena.kernels.mavlink_framing import checksum

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from arena.kernels.mavlink_framing import FrameParser

    Waiting = dict[int, dict[int, tuple[bytes, Frame, float]]]

_V2, _HEAD, _CRC, _SIGNATURE, _SIGNED = 0xFD, 10, 2, 13, 0x01
_KEYS = 1 << 16  # keys of one slot; a slot and a key together are one number
_new = tuple.__new__  # the constructor of a NamedTuple costs twice as much


class NewestFrames:
    """Finder of the newest frame of each kind of telemetry that one autopilot sends.

    waiting: slot -> key -> (datagram, frame, time of arrival [s]) of the newest frames, in the order of arrival.
    """

    def __init__(
        self,
        parser: FrameParser,
        sender: tuple[int, int],
        wanted: Collection[int],
        slots: Mapping[int, int],
        keyed: tuple[int, int, int],
        waiting: Waiting,
    ) -> None:
        """Create the finder.

        parser: finds the frames in a datagram that contains more than whole MAVLink 2 frames
        sender: system and component of the autopilot.  wanted: message ids of the frames to find
        slots: message id -> slot in `waiting`, for the frames that are decoded later. A newer frame of a slot replaces an older one
        keyed: (slot, offset, mask). In this slot, the key of a frame is `uint16 at offset & mask` of its payload. In all other slots
            the key is 0
        waiting: dictionary to fill, see the class
        """
        self._parser, self._wanted, self._slots = parser, frozenset(wanted), dict(slots)
        self._system, self._component = sender
        self._keyed, self._offset, self._mask = keyed
        self.waiting = waiting

    def receive(self, data: bytes, now: float) -> list[Frame] | None:
        """Store the frames of a datagram that are decoded later. Return the frames that the caller must decode now.

        Return None if the datagram contains no wanted frame of the autopilot.
        now: time of arrival [s]
        """
        newest: dict[int, int] = {}
        rare: list[Frame] = []
        at, size, found = 0, len(data), False
        while at < size:
            end = self._end(data, at, size)
            if end < 0:
                return self._search(data, now)
            if data[at + 5] == self._system and data[at + 6] == self._component:
                msgid = data[at + 7] + (data[at + 8] << 8) + (data[at + 9] << 16)
                if msgid in self._wanted:
                    found = True
                    slot = self._slots.get(msgid)
                    if slot is None:
                        rare.append(self._frame(data, at, size))
                    else:
                        code = slot * _KEYS + self._key(slot, data, at + _HEAD, data[at + 1])
                        newest.pop(code, None)  # so that the frames stay in the order of arrival
                        newest[code] = at
            at = end
        for code, at in newest.items():
            self._store(code // _KEYS, code % _KEYS, data, self._frame(data, at, size), now)
        return rare if found else None

    def _end(self, data: bytes, at: int, size: int) -> int:
        """Return the end of a complete MAVLink 2 frame with a correct CRC; -1 for anything else, such as an unknown message."""
        if at + _HEAD + _CRC > size or data[at] != _V2 or data[at + 2] > _SIGNED:
            return -1
        crc_at = at + _HEAD + data[at + 1]
        end = crc_at + _CRC + (_SIGNATURE if data[at + 2] == _SIGNED else 0)
        if end > size:
            return -1
        seed = self._parser.seeds.get(data[at + 7] + (data[at + 8] << 8) + (data[at + 9] << 16))
        if seed is None or checksum(data, at + 1, crc_at, seed) != data[crc_at] + (data[crc_at + 1] << 8):
            return -1
        return end

    def _search(self, data: bytes, now: float) -> list[Frame] | None:
        """Do the same as `receive`, for a datagram that also contains garbage, MAVLink 1, or damaged frames."""
        frames = self._parser.search(data, self._wanted, self._system, self._component).frames
        rare = []
        for frame in frames:
            slot = self._slots.get(frame[6])
            if slot is None:
                rare.append(frame)
            else:
                self._store(slot, self._key(slot, data, frame[2], frame[3]), data, frame, now)
        return rare if frames else None

    def _key(self, slot: int, data: bytes, payload: int, length: int) -> int:
        """Return the key of a frame in its slot: a newer frame replaces only a frame with the same key.

        payload, length: position of its payload, and number of bytes
        """
        if slot != self._keyed:
            return 0
        low = data[payload + self._offset] if self._offset < length else 0
        high = data[payload + self._offset + 1] if self._offset + 1 < length else 0
        return (low + (high << 8)) & self._mask

    def _frame(self, data: bytes, at: int, size: int) -> Frame:
        """Return the frame at an offset. The caller has checked that it is complete."""
        return _new(Frame, self._parser.frame_at(data, at, size) or ())

    def _store(self, slot: int, key: int, data: bytes, frame: Frame, now: float) -> None:
        waiting = self.waiting.get(slot)
        if waiting is None:
            self.waiting[slot] = {key: (data, frame, now)}
        else:
            waiting.pop(key, None)
            waiting[key] = data, frame, now
