"""Encoder and decoder for MAVLink messages in datagrams, with pymavlink's dialect.

Each datagram is parsed separately. A parser for serial streams would lose the beginning of the next datagram
after an incomplete frame or a wrong magic byte.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, pack_frame, parse_frames
from arena.wire.mavlink_minimal import pack_onboard_heartbeat


class Codec:
    """Encoder and decoder of MAVLink messages, with the system and component id of one sender.

    counts: number of bytes and messages that could not be decoded, by reason
    """

    def __init__(self, system: int, component: int, sender: Any = None) -> None:
        """Create a codec that sends with this system and component id.

        sender: object of pymavlink's class MAVLink that counts the sequence numbers; None creates a new object
        """
        self._sender = sender or mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.counts: Counter[str] = Counter()

    def pack(self, message: Any) -> bytes:
        """Return the frame of a pymavlink message, with the next sequence number."""
        data: bytes = message.pack(self._sender)
        self._sender.seq = (self._sender.seq + 1) % 256
        return data

    def frame(self, msgid: int, payload: bytes) -> bytes:
        """Return the frame of an encoded payload, with the next sequence number."""
        data = pack_frame(msgid, payload, self._sender, SEEDS[msgid])
        self._sender.seq = (self._sender.seq + 1) % 256
        return data

    def take_sequence(self, count: int) -> int:
        """Reserve sequence numbers for `count` frames, and return the first one."""
        seq: int = self._sender.seq
        self._sender.seq = (seq + count) % 256
        return seq

    def onboard_heartbeat(self) -> bytes:
        """Return the frame of a HEARTBEAT as onboard controller, with the next sequence number."""
        return pack_onboard_heartbeat(self._sender)

    def frames(self, datagram: Buffer) -> list[Frame]:
        """Return every frame of a datagram, without decoding the payloads. Never raises."""
        found = parse_frames(datagram)
        if found.garbage:
            self.counts["garbage bytes"] += found.garbage
        if found.bad_crc:
            self.counts["bad checksum"] += found.bad_crc
        return found.frames

    def decode(self, datagram: Buffer, at: Frame) -> Any | None:
        """Return the message of a frame, or None if the dialect does not contain it. Never raises an error."""
        try:
            return self._sender.decode(bytearray(datagram[at.start : at.end]))
        except (mavlink.MAVError, ValueError, IndexError):  # unknown message, or a string that is not UTF-8
            self.counts["not understood"] += 1
            return None

    def parse(self, datagram: Buffer, wanted: Container[int] | None = None) -> list[Any]:
        """Decode the messages of a datagram. Messages that the dialect does not contain are left out. Never raises.

        wanted: message ids to decode; None decodes all
        """
        frames = [at for at in self.frames(datagram) if wanted is None or at.msgid in wanted]
        return [m for m in (self.decode(datagram, at) for at in frames) if m is not None]
