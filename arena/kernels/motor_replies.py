"""Reader of HIL_ACTUATOR_CONTROLS, PX4's replies to the sensor samples of the simulator API. `arena.wire.hil` has its layout."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

from arena.kernels import limits

if TYPE_CHECKING:
    from arena.kernels.arrays import Floats
    from arena.kernels.mavlink_framing import FrameParser

_LOCKSTEP, _ARMED = 1, 128  # bits of `flags` and of `mode`
_CONTROLS = struct.Struct("<QQ16fB")
_BYTES = _CONTROLS.size
_FIRST, _MODE = 2, 18  # elements of the first control and of the mode
_unpack = _CONTROLS.unpack


class MotorReplies:
    """Newest motor commands of one PX4.

    motors: motor commands 0..1 [-], the first of the 16 controls, 0 while disarmed (R,)
    time_usec: time of the sensor sample to which PX4 has replied [us]
    armed, lockstep: PX4 is armed; it waits for the next sensor sample
    """

    def __init__(self, parser: FrameParser, number: int, motors: Floats) -> None:
        """Create the reader.

        parser: finds the frame in received bytes.  number: message id of HIL_ACTUATOR_CONTROLS.  motors: R at most 16
        """
        self._parser, self._number, self.motors = parser, number, motors
        self.time_usec, self.armed, self.lockstep = 0, False, False

    def read(self, data: bytes) -> bool:
        """Read received bytes that are exactly one whole reply. For other bytes, change nothing and return False."""
        size = len(data)
        if size == 0:
            return False
        frame = self._parser.frame_at(data, 0, size)
        if frame is None or frame[1] != size or frame[6] != self._number:
            return False
        if not self._parser.crc_fits(data, frame):
            return False
        self.read_payload(data, frame[2], frame[3])
        return True

    def read_payload(self, data: bytes, at: int, size: int) -> None:
        """Read the payload of a reply, data[at:at + size]. Bytes beyond its end are 0. Controls that are not finite count as 0."""
        values = _unpack(data[at : at + min(size, _BYTES)].ljust(_BYTES, b"\0"))
        self.time_usec = values[0]
        self.lockstep, self.armed = values[1] & _LOCKSTEP != 0, values[_MODE] & _ARMED != 0
        for k in range(len(self.motors)):
            command = values[_FIRST + k]
            wanted = self.armed and math.isfinite(command)
            self.motors[k] = limits.within(command, 0.0, 1.0) if wanted else 0.0
