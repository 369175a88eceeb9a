"""Packs the ODOMETRY messages with captured poses, which a pose forwarder sends 30 to 100 times per second."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastcrc import crc16

if TYPE_CHECKING:
    Position = tuple[float, float, float]
    Quaternion = tuple[float, float, float, float]

_V2 = 0xFD
# Positions in a buffer in which the numbers of the payload are aligned.
_START, _SEQUENCE, _PAYLOAD, _POSE = 6, 10, 16, 24
_RESETS = 230  # position in the payload
_crc = crc16.mcrf4xx


class OdometryFrames:
    """Packer of MAVLink 2 frames with ODOMETRY messages of one sender.

    payload: a complete payload of the message, whose last byte is not 0. Time, pose and reset counter in it are replaced.
    message: message id.  seed: its seed byte CRC_EXTRA.  system, component: MAVLink ids of the sender.
    """

    def __init__(self, payload: bytes, message: int, seed: bytes, system: int, component: int) -> None:
        size = len(payload)
        end = _PAYLOAD + size
        raw = memoryview(bytearray(-(-(end + 2) // 8) * 8))
        head = _V2, size, 0, 0, 0, system, component, message & 0xFF, message >> 8 & 0xFF, message >> 16
        raw[_START:_PAYLOAD], raw[_PAYLOAD:end] = bytes(head), payload
        self._frame, self._checked = raw[_START : end + 2], raw[_START + 1 : end]
        self._u8, self._u64, self._f32 = raw, raw.cast("Q"), raw.cast("f")
        self._seed, self._end = seed, end

    def frame(self, sequence: int, time_us: int, p_n: Position, q_nb: Quaternion, resets: int) -> bytes:
        """Return a frame.

        sequence: sequence number, 0..255.  time_us: `time_usec` [us].  resets: `reset_counter`, 0..255.
        p_n: position [m] [NED] (3,).  q_nb: attitude [-] wxyz (4,).
        """
        u8, f32, at = self._u8, self._f32, _POSE // 4
        u8[_SEQUENCE], u8[_PAYLOAD + _RESETS] = sequence, resets
        self._u64[_PAYLOAD // 8] = time_us
        f32[at], f32[at + 1], f32[at + 2] = p_n
        f32[at + 3], f32[at + 4], f32[at + 5], f32[at + 6] = q_nb
        crc = _crc(self._seed, _crc(self._checked))
        u8[self._end], u8[self._end + 1] = crc & 0xFF, crc >> 8
        return self._frame.tobytes()
