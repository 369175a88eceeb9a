"""MAVLink messages in and out of datagrams, by pymavlink's dialect.

Each datagram stands alone: half a frame, or a stray magic byte, never swallows the beginning of the next one, as it would in a
parser made for a serial stream.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, cut, frame


class Codec:
    """Speaks as one system and component. counts: what was heard and not understood."""

    def __init__(self, system: int, component: int) -> None:
        self._voice = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.counts: Counter[str] = Counter()

    def pack(self, message: Any) -> bytes:
        """The message's frame, with the next sequence number."""
        data: bytes = message.pack(self._voice)
        self._voice.seq = (self._voice.seq + 1) % 256
        return data

    def frame(self, msgid: int, payload: bytes) -> bytes:
        """The frame of a payload that is ready, with the next sequence number."""
        data = frame(msgid, payload, self._voice, SEEDS[msgid])
        self._voice.seq = (self._voice.seq + 1) % 256
        return data

    def frames(self, datagram: Buffer) -> list[Frame]:
        """Every frame of a datagram, for `decode` or a reader of one's own. Never raises."""
        found = cut(datagram)
        if found.garbage:
            self.counts["garbage bytes"] += found.garbage
        if found.bad_crc:
            self.counts["bad checksum"] += found.bad_crc
        return found.frames

    def decode(self, datagram: Buffer, at: Frame) -> Any | None:
        """The message of a frame; None for one that this dialect does not know. Never raises."""
        try:
            return self._voice.decode(bytearray(datagram[at.start : at.end]))
        except (mavlink.MAVError, ValueError, IndexError):  # unknown here, or a text that is no text
            self.counts["not understood"] += 1
            return None

    def parse(self, datagram: Buffer, wanted: Container[int] | None = None) -> list[Any]:
        """Every message of a datagram that this dialect knows. wanted: decode only these ids. Never raises."""
        frames = [at for at in self.frames(datagram) if wanted is None or at.msgid in wanted]
        return [m for m in (self.decode(datagram, at) for at in frames) if m is not None]
