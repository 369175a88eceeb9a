"""Exchange of a signing key with an autopilot, by SETUP_SIGNING over a cable. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from arena.wire import mavlink_minimal as mav
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame
from arena.wire.mavlink_ids import KEY_EXCHANGE
from arena.wire.mavlink_signing import (
    SETUP,
    FrameSigner,
    has_signature,
    is_signed,
    pack_setup_signing,
    timestamp_at,
)

_REPEAT_S = 1.0


class KeyExchange:
    """Exchange that sends a signing key to an autopilot, and checks that the autopilot then signs with it.

    Call `receive` with the data of the vehicle, and send the frames that `due` returns, until `done` or `problem` is set.
    system: MAVLink id of the vehicle
    key: the new key
    old_key: key that the vehicle has now; None if it has none
    done: the vehicle signs with the new key
    changed: the vehicle has received the key in this exchange; false if it had the key before
    problem: why the exchange failed; "" if it did not
    """

    def __init__(self, system: int, key: bytes, old_key: bytes | None = None) -> None:
        self.done, self.changed, self.problem = False, False, ""
        self.seen = False
        self._system, self._key, self._old_key = system, key, old_key
        self._sender = mav.MinimalSender(KEY_EXCHANGE.system, KEY_EXCHANGE.component)
        self._old_signer = FrameSigner(old_key, SETUP) if old_key is not None else None
        self._uses_old_key = self._disarmed = False
        self._next = 0.0

    def receive(self, data: Buffer, frames: Sequence[Frame]) -> None:
        """Find in the autopilot's heartbeats which key the vehicle signs with. Other frames are ignored."""
        for frame in frames:
            if (frame.sysid, frame.compid, frame.msgid) != (self._system, AUTOPILOT, mav.HEARTBEAT):
                continue
            self.seen = True
            if has_signature(self._key, data, frame):
                self.done = True
                return
            self._uses_old_key = self._old_key is not None and has_signature(self._old_key, data, frame)
            if is_signed(data, frame) and not self._uses_old_key:
                self.problem = (
                    "the vehicle has another key, and takes a new key only from a sender that has its key. "
                    "Name the file of its key with --old-key. If it is lost, delete /mavlink/mavlink-signing-key.bin "
                    "on the SD card of the vehicle"
                )
            self._disarmed = not mav.parse_heartbeat(data, frame).base_mode & mav.ARMED
            if not self._disarmed:
                self.problem = "the vehicle is armed, and takes a key only while it is disarmed"

    def due(self, wall_s: float, now: float) -> list[bytes]:
        """Return the frames that are due: a heartbeat, and SETUP_SIGNING once the vehicle is known to be disarmed.

        wall_s: time of the wall clock [s since 1970]. now: monotonic [s]
        """
        if now < self._next or self.done or self.problem:
            return []
        self._next = now + _REPEAT_S
        frames = [self._sender.heartbeat()]
        if self._disarmed:
            self.changed = True
            setup = pack_setup_signing(self._sender, self._system, AUTOPILOT, self._key, timestamp_at(wall_s))
            signed = self._old_signer.sign(setup, wall_s) if self._old_signer and self._uses_old_key else None
            frames.append(signed or setup)
        return frames
