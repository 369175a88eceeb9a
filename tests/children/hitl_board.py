"""A flight controller on a serial line, for tests of hardware in the loop: `hitl_board.py DEVICE ID [PARAMS]`.

The built-in autopilot behind one serial line that carries HIL and ordinary MAVLink, as PX4 with SYS_HITL 1 does. The sensor
samples are its only clock; it replies to each with HIL_ACTUATOR_CONTROLS without the lockstep flag, and sends heartbeats
while no samples arrive. PARAMS: a .params file; names that the autopilot does not have are stored, too.
"""

from __future__ import annotations

import os
import selectors
import signal
import struct
import sys
import time
import tty
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.sitl_standin import StandIn
from arena.builtin_parameters import SPECS
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Stream
from arena.wire.qgc_params import parse_params

_ROTORS = ((0.1, 0.1, 0.01), (-0.1, -0.1, 0.01), (0.1, -0.1, -0.01), (-0.1, 0.1, -0.01))
_QUAD_X = {"CA_ROTOR_COUNT": 4} | {
    f"CA_ROTOR{i}_{k}": v
    for i, place in enumerate(_ROTORS)
    for k, v in zip(("PX", "PY", "KM"), place, strict=True)
}
_HIL = mavlink.MAVLINK_MSG_ID_HIL_SENSOR
_READ = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ


class Board(StandIn):
    """The board: serial bytes in, serial bytes out."""

    def __init__(self, system: int, params: dict[str, float]) -> None:
        own = {k: v for k, v in params.items() if k in SPECS or k.startswith("CA_ROTOR")}
        super().__init__("board", {**_QUAD_X, **own, "MAV_SYS_ID": system})
        self.extra = {"MAV_SYS_ID": system, **{k: v for k, v in params.items() if k not in SPECS}}
        self._line, self._voice = Stream(), Codec(system, 1)
        self._beat = self._sampled = 0.0

    def take(self, data: bytes) -> bytes:
        """Return the reply to received bytes."""
        buffer, found = self._line.feed(data)
        answers = b""
        for f in found.frames:
            frame = buffer[f.start : f.end]
            if f.msgid == _HIL:
                self._sampled = time.monotonic()
                answers += self.receive_simulator(frame) + b"".join(
                    d for link, d in self.transmit() if link == "router"
                )
            elif time.monotonic() - self._sampled >= 0.5 and self._is_uid_request(frame):
                answers += self._voice.pack(
                    mavlink.MAVLink_autopilot_version_message(
                        0, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1
                    )
                )
            elif f.msgid == _READ and (extra := self._extra(frame)):
                answers += extra
            else:
                self.receive("router", frame)
        return answers

    def idle(self, now: float) -> bytes:
        """Send heartbeats while no sensor samples arrive."""
        if now - max(self._beat, self._sampled) < 0.5:
            return b""
        self._beat = now
        return self._voice.pack(
            mavlink.MAVLink_heartbeat_message(2, 12, 1 | mavlink.MAV_MODE_FLAG_HIL_ENABLED, 0, 3, 3)
        )

    def _controls(self, time_usec: int, motors: Any) -> bytes:
        """Return actuator controls without the lockstep flag."""
        (m,) = self._voice.parse(super()._controls(time_usec, motors))
        m = mavlink.MAVLink_hil_actuator_controls_message(m.time_usec, m.controls, m.mode, 0)
        return self._voice.pack(m)

    def _is_uid_request(self, frame: bytes) -> bool:
        return any(
            getattr(m, "command", 0) == mavlink.MAV_CMD_REQUEST_MESSAGE for m in self._voice.parse(frame)
        )

    def _extra(self, frame: bytes) -> bytes:
        (m,) = self._voice.parse(frame)
        if m.param_id not in self.extra:
            return b""
        value = self.extra[m.param_id]
        whole = isinstance(value, int)
        packed = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
        return self._voice.pack(
            mavlink.MAVLink_param_value_message(m.param_id.encode(), packed, 6 if whole else 9, 900, 1)
        )


def main() -> int:
    device, system, *files = sys.argv[1:]
    board = Board(int(system), parse_params(Path(files[0]).read_text()) if files else {})
    line = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(line)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with selectors.DefaultSelector() as selector:
        selector.register(line, selectors.EVENT_READ)
        while True:
            data = os.read(line, 65536) if selector.select(0.1) else b""
            out = board.take(data) + board.idle(time.monotonic())
            while out:
                try:
                    out = out[os.write(line, out) :]
                except BlockingIOError:  # a full line loses what does not fit, as a real one does
                    break


if __name__ == "__main__":
    sys.exit(main())
