"""Radio between a stand-in for a real vehicle and its arena: a UDP proxy that can be cut, with a pilot and a stranger.

The stand-in is a built-in autopilot in a world of its own. It flies no manual modes, so the proxy plays the pilot: it reports
POSCTL to the arena and commands the stand-in itself. It records every frame from the arena that could move a vehicle.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import threading
import time
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import Kind, parse_request
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Frame, parse_frames, uint_at

Address = tuple[str, int]

POSCTL = 3 << 16
LOITER, LAND = (4, 3), (4, 6)
_POLL_S = 0.02
_ARMED = 128
_PILOT_SYSTEM = 255
_WRITES = frozenset({mavlink.MAVLINK_MSG_ID_PARAM_SET})
_COMMANDS = frozenset({mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT})
_COMMAND_OFFSET = 28


@dataclass(frozen=True, kw_only=True)
class Received:
    """Frame from the arena. at: time of arrival [s]. sender: (system, component). what: its request, as text."""

    at: float
    sender: tuple[int, int]
    what: str


@dataclass(kw_only=True)
class TrueState:
    """State that the vehicle's autopilot really reports, whether the arena receives it or not. mode: custom_mode."""

    armed: bool = False
    landed: bool | None = None
    mode: int = 0
    was_armed: bool = False
    was_airborne: bool = False


@dataclass(kw_only=True)
class Pilot:
    """Pilot of one vehicle. Times in s.

    since: when the pilot took control. reported_at: first heartbeat of it that the arena received. until: when the vehicle was disarmed.
    """

    since: float
    reported_at: float | None = None
    until: float = float("inf")
    lands_at: float = field(default=float("inf"))


class Radio(threading.Thread):
    """Proxy of one vehicle. Start it before the arena, and call `close` at the end.

    system: MAVLink id of the vehicle.
    vehicle: address of the stand-in's router link.
    near: address on which the stand-in is received.
    own: address from which the arena receives the vehicle.
    arena: address at which the arena's link listens.
    uid: hardware uid that the vehicle reports.
    """

    def __init__(
        self, *, system: int, vehicle: Address, near: Address, own: Address, arena: Address, uid: bytes
    ) -> None:
        super().__init__(daemon=True)
        self.system, self.uid = system, uid.ljust(18, b"\0")
        self.state = TrueState()
        self.received: list[Received] = []
        self.to_stranger: list[Received] = []
        self.cut = False
        self.pilot: Pilot | None = None
        self._vehicle, self._arena = vehicle, arena
        self._near, self._far = _bound(near), _bound(own)
        self._stranger: socket.socket | None = None
        self._stranger_address = (own[0], own[1] + 1)
        self._stranger_codec = Codec(system, AUTOPILOT)
        self._stranger_next = 0.0
        self._autopilot, self._hand = Codec(system, AUTOPILOT), Codec(_PILOT_SYSTEM, 190)
        self._over = threading.Event()

    # -- faults, called by the flight

    def take_over(self, lands_after_s: float) -> None:
        """Let the pilot take control now and land after a while [s]."""
        now = time.monotonic()
        self.pilot = Pilot(since=now, lands_at=now + lands_after_s)
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, *LOITER)

    def bring_stranger(self) -> None:
        """Switch on another vehicle with the same system id, on the ground, on another address."""
        self._stranger = _bound(self._stranger_address)

    def send_stranger_home(self) -> None:
        """Switch the other vehicle off."""
        stranger, self._stranger = self._stranger, None
        if stranger is not None:
            stranger.close()

    def close(self) -> None:
        self._over.set()
        self.join(5.0)
        for sock in (self._near, self._far, self._stranger):
            if sock is not None:
                sock.close()

    # -- the proxy

    def run(self) -> None:
        while not self._over.is_set():
            stranger = self._stranger
            sockets = [self._near, self._far, *([stranger] if stranger is not None else [])]
            with contextlib.suppress(OSError, ValueError):  # the stranger's socket may have been closed
                for ready in select.select(sockets, [], [], _POLL_S)[0]:
                    self._read(ready, stranger)
            self._act(time.monotonic(), stranger)

    def _read(self, ready: socket.socket, stranger: socket.socket | None) -> None:
        data, _ = ready.recvfrom(65535)
        now = time.monotonic()
        if ready is self._near:
            out = b"".join(self._from_vehicle(data, frame, now) for frame in parse_frames(data).frames)
            if out and not self.cut:
                self._far.sendto(out, self._arena)
        elif ready is self._far:
            if not self.cut:
                self._from_arena(data, now)
        elif stranger is not None:
            self._from_arena_to_stranger(data, now, stranger)

    def _from_vehicle(self, data: bytes, frame: Frame, now: float) -> bytes:
        raw = data[frame.start : frame.end]
        if frame.compid != AUTOPILOT:
            return raw
        if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return self._heartbeat(data, frame, now)
        if frame.msgid == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            self.state.landed = uint_at(data, frame, 1, 1) == mavlink.MAV_LANDED_STATE_ON_GROUND
            self.state.was_airborne |= self.state.armed and not self.state.landed
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return self._version(self._autopilot, self.uid)
        return raw

    def _heartbeat(self, data: bytes, frame: Frame, now: float) -> bytes:
        state, armed = self.state, bool(uint_at(data, frame, 6, 1) & _ARMED)
        state.mode, state.armed, state.was_armed = uint_at(data, frame, 0, 4), armed, state.was_armed or armed
        mode = state.mode
        if self.pilot is not None:
            mode = POSCTL
            if self.pilot.reported_at is None and armed and not self.cut:
                self.pilot.reported_at = now
            if not armed:
                self.pilot.until = min(self.pilot.until, now)
        base, status = uint_at(data, frame, 6, 1), uint_at(data, frame, 7, 1)
        heartbeat = self._autopilot.pack(mavlink.MAVLink_heartbeat_message(2, 12, base, mode, status, 3))
        return heartbeat if self.pilot is None else self._stick_positions() + heartbeat

    def _stick_positions(self) -> bytes:
        """Return RC_CHANNELS with centred sticks, which shows the arena that the manual mode is that of a pilot."""
        return self._autopilot.pack(mavlink.MAVLink_rc_channels_message(0, 16, *[1500] * 18, 80))

    def _version(self, codec: Codec, uid: bytes) -> bytes:
        capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        (uid8,) = struct.unpack("<Q", uid[:8])
        message = mavlink.MAVLink_autopilot_version_message(
            capabilities, 0x011000FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid8, list(uid)
        )
        return codec.pack(message)

    def _from_arena(self, data: bytes, now: float) -> None:
        out = b""
        for frame in parse_frames(data).frames:
            what = request_text(data, frame)
            if what:
                self.received.append(Received(at=now, sender=(frame.sysid, frame.compid), what=what))
            if (
                not what or self.pilot is None or what == "setpoint"
            ):  # the pilot's stand-in obeys its pilot only
                out += data[frame.start : frame.end]
        if out:
            self._near.sendto(out, self._vehicle)

    # -- the pilot and the stranger

    def _act(self, now: float, stranger: socket.socket | None) -> None:
        pilot = self.pilot
        if pilot is not None and now >= pilot.lands_at and self.state.armed:
            pilot.lands_at = now + 1.0
            self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, *LAND)
        if stranger is not None and now >= self._stranger_next:
            self._stranger_next = now + 0.2
            codec = self._stranger_codec
            frames = codec.pack(mavlink.MAVLink_heartbeat_message(2, 12, 1, 4 << 16 | 6 << 24, 3, 3))
            frames += codec.pack(mavlink.MAVLink_extended_sys_state_message(0, 1))
            with contextlib.suppress(OSError):
                stranger.sendto(frames, self._arena)

    def _from_arena_to_stranger(self, data: bytes, now: float, stranger: socket.socket) -> None:
        for frame in parse_frames(data).frames:
            command = uint_at(data, frame, _COMMAND_OFFSET, 2) if frame.msgid in _COMMANDS else 0
            what = request_text(data, frame)
            if what and what != "setpoint":
                self.to_stranger.append(Received(at=now, sender=(frame.sysid, frame.compid), what=what))
            if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
                with contextlib.suppress(OSError):
                    stranger.sendto(
                        self._version(
                            self._stranger_codec, (b"stranger" + bytes([self.system])).ljust(18, b"\0")
                        ),
                        self._arena,
                    )

    def _command(self, number: int, *params: float) -> None:
        filled = (*params, *(0.0,) * (7 - len(params)))
        message = mavlink.MAVLink_command_long_message(self.system, AUTOPILOT, number, 0, *map(float, filled))
        self._near.sendto(self._hand.pack(message), self._vehicle)


def request_text(data: bytes, frame: Frame) -> str:
    """Return what a frame requests of a vehicle, as text; "" if it neither moves the vehicle nor writes a parameter."""
    if frame.msgid in _WRITES:
        return "parameter write"
    request = parse_request(data, frame)
    if request is None or request.kind is Kind.MANUAL_INPUT:
        return ""
    return f"mode {request.mode}" if request.kind is Kind.MODE else request.kind.value


def _bound(address: Address) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind(address)
    sock.setblocking(False)
    return sock
