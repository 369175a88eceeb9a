"""Height, battery and warnings of one vehicle, read from the messages that the router forwards.

They are shown in the terminal of `arena up` and written to events.jsonl. They must not influence the routing.
"""

from __future__ import annotations

import struct

from arena.kernels.ordinary_datagrams import BATTERY_REMAINING
from arena.wire.mavlink_frame import Buffer, Frame, byte_at, uint_at

SYS_STATUS, LOCAL_POSITION_NED, STATUSTEXT = 1, 32, 253
WARNING = 4
"""MAV_SEVERITY: a smaller number is more severe."""
REPEAT_AFTER_S = 10.0
"""The same text is reported again only after this time [s]."""
_Z, _TEXT, _TEXT_BYTES, _ID, _CHUNK = 12, 1, 50, 51, 53  # payload offsets
_MOST_CHUNKS = 8
_FLOAT = struct.Struct("<f")


class VehicleTelemetry:
    """Latest height, battery charge and warnings of one vehicle, for the terminal and events.jsonl.

    height_m: height above the arena's floor [m], None before the first message.
    battery: remaining charge [%], None if unknown.
    texts: warnings of the autopilot; the reader must empty the list.
    """

    def __init__(self) -> None:
        self.height_m: float | None = None
        self.battery: int | None = None
        self.texts: list[str] = []
        self._chunks: dict[int, bytes] = {}
        self._reported: dict[str, float] = {}

    def on_frame(self, data: Buffer, frame: Frame, now: float) -> None:
        """Update height, battery or warnings from a frame of the vehicle's autopilot.

        now: monotonic [s].
        """
        if frame.msgid == LOCAL_POSITION_NED:
            self.on_z_n(*_FLOAT.unpack(_bytes_at(data, frame, _Z, 4)))
        elif frame.msgid == SYS_STATUS:
            battery = byte_at(data, frame, BATTERY_REMAINING)
            self.battery = battery if battery <= 100 else None  # -1: the autopilot does not measure it
        elif frame.msgid == STATUSTEXT and byte_at(data, frame, 0) <= WARNING:
            self._on_text(data, frame, now)

    def on_z_n(self, z: float) -> None:
        """Update the height. z: field of LOCAL_POSITION_NED [m] [NED]."""
        self.height_m = -z if abs(z) < 1e6 else None

    def values(self) -> dict[str, float | None]:
        """Return `height_m` [m], rounded to 1 cm, and `battery` [%]; None if unknown."""
        return {
            "height_m": None if self.height_m is None else round(self.height_m, 2),
            "battery": self.battery,
        }

    def _on_text(self, data: Buffer, frame: Frame, now: float) -> None:
        """Add the text of a STATUSTEXT to the warnings. The chunks of a long text are joined.

        The chunk that contains a zero byte is the last one.
        """
        raw, number = _bytes_at(data, frame, _TEXT, _TEXT_BYTES), uint_at(data, frame, _ID, 2)
        if number and byte_at(data, frame, _CHUNK):
            raw = self._chunks.pop(number, b"") + raw
        if number and b"\0" not in raw and len(raw) < _MOST_CHUNKS * _TEXT_BYTES:
            self._chunks = {number: raw}
            return
        # PX4 ends a text with a tab where it also sends the text as an event
        text = raw.partition(b"\0")[0].decode(errors="replace").strip()
        if text and now - self._reported.get(text, -REPEAT_AFTER_S) >= REPEAT_AFTER_S:
            self._reported = {t: at for t, at in self._reported.items() if now - at < REPEAT_AFTER_S}
            self._reported[text] = now
            self.texts.append(text)


def _bytes_at(data: Buffer, frame: Frame, offset: int, width: int) -> bytes:
    """Return `width` bytes of a frame's payload. Bytes that MAVLink 2 has truncated are zero."""
    end = frame.payload + min(offset + width, frame.size)
    return bytes(data[frame.payload + offset : end]).ljust(width, b"\0")
