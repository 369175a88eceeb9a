"""MAVLink 2 message signing: signs frames, and checks the signatures of received frames. Pure: no files, no clocks.

A signed frame has bit 0 of its incompatibility flags set, and 13 more bytes at its end:

    link id (1 byte)   timestamp (6 bytes, little-endian, 10 us since 2015-01-01)   signature (6 bytes)

The signature is the beginning of SHA-256(key, frame from its magic byte to its CRC, link id, timestamp).
Each sender, (system, component, link id), is a stream with increasing timestamps: a frame with an old timestamp
is a repetition by somebody else. Signing authenticates messages and does not encrypt them.
https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from collections import Counter
from collections.abc import Sequence
from enum import Enum

from fastcrc import crc16

from arena.wire.mavlink_frame import SEEDS, Buffer, Frame, MavlinkSender, pack_frame, parse_frames

KEY_BYTES = 32
RADIO_STATUS, SETUP_SIGNING = 109, 256
LINK_PROCESS, LAND_ALL, SETUP, PARAMS = 1, 2, 3, 4  # link ids of the processes that sign
TICKS_PER_S = 100_000
NEW_STREAM_AGE = (
    60 * TICKS_PER_S
)  # the first frame of a stream may be this much older than the newest timestamp
STREAM_LIMIT = 16  # PX4 refuses all further senders until its next start
_EPOCH_S = 1_420_070_400  # 2015-01-01 00:00 UTC
_MOST_TICKS = (1 << 48) - 1
_MAGIC, _SIGNED, _HEAD, _CRC, _TRAILER, _HASH = 0xFD, 0x01, 10, 2, 13, 6
_LITTLE, _SETUP = struct.Struct("<H"), struct.Struct("<QBB32s")


class Verdict(Enum):
    """Result of the check of one frame's signature. The value is the text that users see."""

    VALID = "valid"
    UNSIGNED = "not signed"
    WRONG = "wrong signature"
    OLD = "old timestamp"


class FrameSigner:
    """Signs frames with increasing timestamps.

    key: 32 bytes
    link_id: number of this connection, 0 to 255; senders of the vehicle on another connection have another number
    timestamp: last timestamp that was used; store it, and pass it in after a restart [10 us since 2015-01-01]
    own: (system, component) of this process. The receiver knows at most STREAM_LIMIT senders, so frames of further
    senders are sent as frames of this process. None: always keep the sender
    most_senders: number of senders that keep their own ids
    """

    def __init__(
        self,
        key: bytes,
        link_id: int,
        timestamp: int = 0,
        *,
        own: tuple[int, int] | None = None,
        most_senders: int = STREAM_LIMIT - 4,
    ) -> None:
        self.timestamp = timestamp
        self._key, self._link_id, self._own, self._most = checked_key(key), link_id, own, most_senders
        self._senders: set[tuple[int, int]] = set() if own is None else {own}

    def sign(self, data: Buffer, wall_s: float) -> bytes | None:
        """Return a frame with a signature, which replaces an earlier one.

        Return None for a frame that cannot be
        signed: MAVLink 1, or a message that is not in the table of CRC seeds.

        data: one frame. wall_s: time of the wall clock [s since 1970]
        """
        frames = parse_frames(data).frames
        if not frames or data[frames[0].start] != _MAGIC:
            return None
        frame = frames[0]
        seed = SEEDS.get(frame.msgid)
        if seed is None:
            return None
        body = bytearray(data[frame.start + 1 : frame.payload + frame.size])
        body[1] |= _SIGNED
        body[4], body[5] = self._sender_of(frame)
        self.timestamp = min(max(self.timestamp + 1, timestamp_at(wall_s)), _MOST_TICKS)
        signed = bytes([_MAGIC]) + body + _LITTLE.pack(crc16.mcrf4xx(bytes(body) + seed))
        signed += bytes([self._link_id]) + self.timestamp.to_bytes(6, "little")
        return signed + _signature(self._key, signed)

    def on_received(self, timestamp: int) -> None:
        """Record the timestamp of a correctly signed frame.

        Later frames are signed with newer timestamps only.
        """
        self.timestamp = max(self.timestamp, timestamp)

    def _sender_of(self, frame: Frame) -> tuple[int, int]:
        sender = frame.sysid, frame.compid
        if self._own is None or sender in self._senders:
            return sender
        if len(self._senders) >= self._most:
            return self._own
        self._senders.add(sender)
        return sender


class SignatureCheck:
    """Check of the signatures of received frames.

    It refuses replayed frames, which were recorded and are sent again.

    timestamp: newest timestamp of a valid frame [10 us since 2015-01-01]
    """

    def __init__(self, key: bytes) -> None:
        self.timestamp = 0
        self._key = checked_key(key)
        self._streams: dict[tuple[int, int, int], int] = {}

    def check(self, data: Buffer, frame: Frame, local: int) -> Verdict:
        """Check the signature of a frame, and record its timestamp to refuse the same frame later. Call it once per frame.

        local: newest timestamp that this process has used, or that of its clock [10 us since 2015-01-01]
        """
        if not is_signed(data, frame):
            return Verdict.UNSIGNED
        if not has_signature(self._key, data, frame):
            return Verdict.WRONG
        at = frame.end - _TRAILER
        timestamp = int.from_bytes(data[at + 1 : at + 7], "little")
        stream = frame.sysid, frame.compid, data[at]
        last = self._streams.get(stream)
        if timestamp <= last if last is not None else timestamp + NEW_STREAM_AGE < max(local, self.timestamp):
            return Verdict.OLD
        self._streams[stream] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        return Verdict.VALID


class SignedConnection:
    """MAVLink signing on the connection to one vehicle.

    It signs the frames to the vehicle, and drops its unsigned or wrongly signed frames.

    RADIO_STATUS is accepted without a signature, because telemetry radios do not sign.

    key, link_id, timestamp, own: see `FrameSigner`
    counts: number of frames from the vehicle by result of the check
    """

    def __init__(
        self, key: bytes, link_id: int, timestamp: int = 0, *, own: tuple[int, int] | None = None
    ) -> None:
        self.counts: Counter[Verdict] = Counter()
        self._signer = FrameSigner(key, link_id, timestamp, own=own)
        self._check = SignatureCheck(key)

    @property
    def timestamp(self) -> int:
        """Last timestamp that was used [10 us since 2015-01-01]."""
        return self._signer.timestamp

    def sign(self, data: Buffer, wall_s: float) -> bytes | None:
        """Return a frame with a signature, or None if the frame cannot be signed.

        wall_s: time of the wall clock [s since 1970]
        """
        return self._signer.sign(data, wall_s)

    def accepted(self, data: Buffer, frames: Sequence[Frame], wall_s: float) -> list[Frame]:
        """Return the frames that have a valid signature.

        wall_s: time of the wall clock [s since 1970]
        """
        local = max(self._signer.timestamp, timestamp_at(wall_s))
        found = []
        for frame in frames:
            verdict = self._check.check(data, frame, local)
            self.counts[verdict] += 1
            if verdict is Verdict.VALID or (verdict is Verdict.UNSIGNED and frame.msgid == RADIO_STATUS):
                found.append(frame)
        self._signer.on_received(self._check.timestamp)
        return found


def is_signed(data: Buffer, frame: Frame) -> bool:
    """Return whether a frame has a signature, valid or not."""
    return data[frame.start] == _MAGIC and bool(data[frame.start + 2] & _SIGNED)


def has_signature(key: bytes, data: Buffer, frame: Frame) -> bool:
    """Return whether a frame was signed with a given key.

    A replayed frame passes, too; `SignatureCheck` refuses it.
    """
    if not is_signed(data, frame):
        return False
    found = bytes(data[frame.end - _HASH : frame.end])
    return hmac.compare_digest(found, _signature(key, bytes(data[frame.start : frame.end - _HASH])))


def timestamp_at(wall_s: float) -> int:
    """Return the signing timestamp of a wall-clock time [10 us since 2015-01-01], or 0 for earlier times."""
    return min(max(0, int((wall_s - _EPOCH_S) * TICKS_PER_S)), _MOST_TICKS)


def checked_key(key: bytes) -> bytes:
    """Return the key if it is valid. Raises ValueError for a wrong length or a key of zeros.

    The message never contains the key.
    """
    if len(key) != KEY_BYTES or not any(key):
        raise ValueError(f"a signing key has {KEY_BYTES} bytes, not all of them 0; got {len(key)} bytes")
    return key


def pack_setup_signing(
    sender: MavlinkSender, system: int, component: int, key: bytes, timestamp: int
) -> bytes:
    """Encode a SETUP_SIGNING message, which gives a vehicle its key.

    It contains the key as plain text: send it only over a cable.

    timestamp: initial timestamp of the vehicle [10 us since 2015-01-01]
    """
    payload = _SETUP.pack(timestamp, system, component, checked_key(key))
    data = pack_frame(SETUP_SIGNING, payload, sender, SEEDS[SETUP_SIGNING])
    sender.seq = (sender.seq + 1) % 256
    return data


def _signature(key: bytes, signed: bytes) -> bytes:
    return hashlib.sha256(key + signed).digest()[:_HASH]
