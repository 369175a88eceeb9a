"""Backend that sends setpoints and commands with MAVSDK 4 (PyPI package `mavsdk`).

MAVSDK is a native library with threads of its own.

MAVSDK repeats the last setpoint 20 times a second, also when the program hangs. So MAVSDK has no socket here: all its bytes pass
`_Gate`, which sends each setpoint of the program once and drops the repetitions. So the autopilot
and the copilot react to a program that hangs, crashes or is slow as with pymavlink.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError, NotConfirmedError, NotInstalledError, RunError
from arena.uav.backend import Command, Wire
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.mavlink_layout import decoder

try:
    import mavsdk
    from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage
    from mavsdk.plugins.offboard import Offboard

    from arena.uav import mavsdk_setpoints as setpoints

    _SEND_COMMAND = MavlinkDirect.send_command_async
except (ImportError, AttributeError) as error:
    raise NotInstalledError(
        f"backend mavsdk: needs the package mavsdk, version 4.1 or newer ({error}): pip install 'flying-arena[sdk]'. "
        "Or use `backend: mavlink`"
    ) from error

_COMMANDS = mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT
_SEND_TIMEOUT_S = 5.0  # wall time; usually 0.0001 s
_RESULT_TIMEOUT_S = 1.0  # wall time from the received acknowledgement to MAVSDK's result


class _Channels:
    """Counter of this process's free MAVLink channels. Each MAVSDK connection needs one channel.

    MAVSDK 4.1 gives out 32 channels, but MAVLink's C code has buffers for 16. With 20 connections or more, the C library aborted
    each process at its end, because other memory had been overwritten.
    """

    LIMIT = 16

    def __init__(self) -> None:
        self._free = threading.BoundedSemaphore(self.LIMIT)

    def take(self) -> None:
        """Reserve a MAVLink channel. Raises InputError if all channels are in use."""
        if not self._free.acquire(blocking=False):
            raise InputError(
                f"backend mavsdk: at most {self.LIMIT} vehicles in one process (MAVSDK has buffers for {self.LIMIT} connections). "
                "Use `backend: mavlink`, or divide the group"
            )

    def release(self) -> None:
        self._free.release()


_CHANNELS = _Channels()


class MavsdkCommand:
    """Command to the autopilot that is sent with MAVSDK. It implements `Command`."""

    def __init__(self, wire: Wire, gate: _Gate, direct: MavlinkDirect, number: int) -> None:
        self._wire, self._gate, self._direct, self._number = wire, gate, direct, number
        self._ended, self._is_sent = threading.Event(), False
        self._result: int | None = None
        wire.telemetry.acks.clear()

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send the command with MAVSDK; send every repetition directly as a MAVLink message.

        MAVSDK's own repetitions would follow the wall clock.
        """
        if self._is_sent:
            return self._wire.send(message)
        self._is_sent = True
        asked = setpoints.as_json(self._wire.own_address, message)
        self._gate.command.pass_one(message, lambda: _SEND_COMMAND(self._direct, asked, self._on_result))

    def result(self) -> int | None:
        """Return the MAV_RESULT of the acknowledgement, or None before it has arrived.

        MAVSDK's thread reports the result a moment after the acknowledgement has arrived. The method waits for it, so that
        flights in lockstep do not depend on the speed of MAVSDK's threads. MAVSDK's own time-out is wall time: if
        it is over before the acknowledgement arrives, the result is that of the acknowledgement.
        """
        received = self._wire.acknowledged(self._number)
        if received is None:
            return None
        self._ended.wait(_RESULT_TIMEOUT_S)
        return received if self._result is None else self._result

    def _on_result(self, result: MavlinkDirectResult, ack: MavlinkMessage, _: object) -> None:
        if result == MavlinkDirectResult.SUCCESS:
            self._result = int(json.loads(ack.fields_json)["result"])
        self._ended.set()


class _Gate:
    """Filter of MAVSDK's output: sends each requested setpoint and command to the vehicle once, drops all else.

    Only messages that a call of the program has requested are passed.

    All else that MAVSDK sends is dropped: repeated setpoints and commands, heartbeats (the connection sends one per second), pings
    and its own requests. So MAVSDK's threads change neither what the autopilot receives nor when.
    dropped: number of dropped setpoints.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.setpoint, self.command = _Slot(setpoints.same_setpoint), _Slot(_same_command)
        self.dropped = 0

    def on_bytes(self, data: bytes) -> None:
        """Send or drop the frames of one datagram from MAVSDK. It runs on a thread of MAVSDK."""
        for frame in parse_frames(data).frames:
            is_setpoint = frame.msgid in setpoints.SETPOINTS
            if not is_setpoint and frame.msgid not in _COMMANDS:
                continue
            slot, message = self.setpoint if is_setpoint else self.command, decoder(frame.msgid)(data, frame)
            if slot.take(frame.msgid, message):
                self._wire.send_payload(frame.msgid, data[frame.payload : frame.payload + frame.size])
                slot.sent.set()
            else:
                self.dropped += is_setpoint


class _Slot:
    """Store for the message that the program has requested and that MAVSDK has not sent yet.

    There is one slot for setpoints and one slot for commands.

    same: function that compares the message that was asked for with one that MAVSDK sends.
    sent: set when the message has been sent to the vehicle.
    """

    def __init__(self, same: Callable[[Any, Any], bool]) -> None:
        self.sent = threading.Event()
        self._same, self._asked = same, None
        self._lock, self._calls = threading.Lock(), threading.Lock()

    def pass_one(self, asked: Any, call: Callable[[], object]) -> None:
        """Call a function of MAVSDK, and wait until its message has been sent to the vehicle.

        Raises NotConfirmedError if MAVSDK does not send the message.
        """
        with self._calls:
            with self._lock:
                self._asked = asked
                self.sent.clear()
            call()
            if self.sent.wait(_SEND_TIMEOUT_S):
                return
            with self._lock:
                self._asked = None
        raise NotConfirmedError(
            f"MAVSDK has not sent {asked.get_type()} within {_SEND_TIMEOUT_S:g} s of wall time"
        )

    def take(self, msgid: int, message: Any) -> bool:
        """Return whether a message is the one that the program has requested. True only once per request."""
        with self._lock:
            if (
                self._asked is None
                or self._asked.get_msgId() != msgid
                or not self._same(self._asked, message)
            ):
                return False
            self._asked = None
            return True


class MavsdkBackend:
    """Backend that sends with MAVSDK's plugins Offboard and MavlinkDirect. It implements `Backend`."""

    def __init__(self, wire: Wire) -> None:
        self._wire, self._gate = wire, _Gate(wire)
        _CHANNELS.take()
        with (
            contextlib.ExitStack() as undo
        ):  # if MAVSDK raises, its threads end and the channel is free again
            undo.callback(_CHANNELS.release)
            _subscribe_to_errors()
            self._mavsdk = mavsdk.Mavsdk(
                mavsdk.Configuration.create_manual(wire.system_id, PROGRAM_COMPONENT, False)
            )
            undo.callback(self._mavsdk.destroy)
            result = self._mavsdk.add_any_connection("raw://")
            if result != mavsdk.ConnectionResult.SUCCESS:
                raise RunError(f"backend mavsdk: MAVSDK cannot add a connection: {result.name}")
            self._mavsdk.subscribe_raw_bytes_to_be_sent(self._gate.on_bytes)
            undo.pop_all()
        self._plugins: tuple[Offboard, MavlinkDirect] | None = None
        self._is_closed, self._opening = False, threading.Lock()

    @property
    def dropped(self) -> int:
        """Number of setpoints from MAVSDK that were dropped, because the program had not requested them."""
        return self._gate.dropped

    def receive(self, datagram: bytes) -> None:
        """Pass a datagram to MAVSDK. Another thread must not call `close` meanwhile: MAVSDK would end the process."""
        self._mavsdk.pass_received_raw_bytes(datagram)

    def send_setpoint(self, message: mavlink.MAVLink_message) -> None:
        """Send one setpoint. Raises NotConfirmedError before MAVSDK has received a heartbeat of the vehicle."""
        offboard, direct = self._open_plugins()
        own = self._wire.own_address
        self._gate.setpoint.pass_one(message, lambda: setpoints.send(offboard, direct, own, message))

    def command(self, number: int) -> Command:
        """Create a command, without sending it. Raises NotConfirmedError before MAVSDK has received a heartbeat."""
        return MavsdkCommand(self._wire, self._gate, self._open_plugins()[1], number)

    def close(self) -> None:
        with self._opening:
            if not self._is_closed:
                self._is_closed = True
                # The plugins free the functions for MAVSDK's results while its threads still call them. So they are kept.
                kept = [list(getattr(plugin, "_callbacks", ())) for plugin in self._plugins or ()]
                self._mavsdk.destroy()
                kept.clear()
                _CHANNELS.release()

    def _open_plugins(self) -> tuple[Offboard, MavlinkDirect]:
        with self._opening:
            return self._plugins or self._find_plugins()

    def _find_plugins(self) -> tuple[Offboard, MavlinkDirect]:
        if self._is_closed:  # MAVSDK itself would end the process
            raise NotConfirmedError("the connection to the vehicle is closed")
        if self._plugins is None:
            if self._wire.telemetry.heartbeat is not None:  # MAVSDK has it too, but handles it on a thread
                self._mavsdk.first_autopilot(_SEND_TIMEOUT_S)
            for system in self._mavsdk.get_systems():
                if system.get_system_id() == self._wire.system_id:
                    self._plugins = Offboard(system), MavlinkDirect(system)
        if self._plugins is None:
            raise NotConfirmedError(
                "MAVSDK has not received a heartbeat of the vehicle yet: is the arena up?"
            )
        return self._plugins


def _same_command(asked: Any, sent: Any) -> bool:
    wanted = (asked.command, *(getattr(asked, f"param{i}") for i in range(1, 8)))
    found = (sent.command, *(getattr(sent, f"param{i}") for i in range(1, 8)))
    return all(abs(a - b) < 1e-4 * (1.0 + abs(a)) for a, b in zip(wanted, found, strict=True))


@cache
def _subscribe_to_errors() -> None:
    """Print the errors of MAVSDK. Call it once per process, before MAVSDK has threads.

    A second subscription frees the C function of the first one while a thread of MAVSDK may call it (mavsdk 4.1.0).
    """
    mavsdk.log_subscribe(_log)


def _log(level: mavsdk.LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Print an error of MAVSDK. Return True, so that MAVSDK does not print it again."""
    if level >= mavsdk.LogLevel.ERROR:
        print(f"mavsdk: {message}", file=sys.stderr, flush=True)
    return True
