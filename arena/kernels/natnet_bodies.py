"""Encoder of the rigid bodies in a NatNet FRAME packet.

`arena.mocap.natnet.codec` describes the format. The motion capture emulator encodes 180 frames per second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from arena.kernels.capture_types import Quad, Triple

    BodyFields = tuple[int, Triple, Quad, float, bool]

_BODY_BYTES = 38


class BodyEncoder:
    """Encoder of rigid bodies. It has a buffer for one body.

    tracking_valid: parameters of a body that is tracked
    """

    def __init__(self, tracking_valid: int) -> None:
        self._tracking_valid = tracking_valid
        # a multiple of four bytes, for views of four-byte numbers
        body = memoryview(bytearray(_BODY_BYTES + 2))
        self._bytes, self._i32, self._f32, self._i16 = body, body.cast("i"), body.cast("f"), body.cast("h")

    def encode(self, bodies: Sequence[BodyFields]) -> bytes:
        """Return the encoded bodies, 38 bytes each.

        bodies: (streaming id, position [m] [capture axes], quaternion xyzw [-], mean error [m], tracked) of each body.
            Numbers of a body are stored as four-byte floats.
        """
        out = bytearray(_BODY_BYTES * len(bodies))
        at = 0
        for number, position, quat_xyzw, error_m, tracked in bodies:
            body = self._f32
            self._i32[0] = number
            body[1], body[2], body[3] = position
            body[4], body[5], body[6], body[7] = quat_xyzw
            body[8] = error_m
            self._i16[18] = self._tracking_valid if tracked else 0
            for k in range(_BODY_BYTES):
                out[at + k] = self._bytes[k]
            at += _BODY_BYTES
        return bytes(out)
