"""Transfer of parameters with one vehicle: what reading, writing and rebooting share. Frames and time in, frames and state out.

No sockets, no clocks. The vehicle is connected while any message of its autopilot arrives. Only a heartbeat, one per second, shows that
the vehicle is not armed.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, byte_at, uint_at
from arena.wire.mavlink_minimal import result_words
from arena.wire.mavlink_params import (
    ERROR,
    REBOOT,
    VALUE,
    Message,
    Value,
    parse_error,
    parse_value,
    reboot,
    request_read,
)

SYSTEM = 252
CONNECT_TIMEOUT_S = 10.0  # for the first message of the vehicle
VEHICLE_TIMEOUT_S = 3.0  # between two messages of the vehicle
_HEARTBEAT_PERIOD_S = 1.0
_PROBE_PERIOD_S = 0.4
_ARMED_BIT, _BASE_MODE_OFFSET = 128, 6
_REBOOT_TIMEOUT_S = 2.5
PROBE = 0  # index of a parameter that every vehicle has

Ending = Literal["", "done", "armed", "no connection", "connection lost", "interrupted"]
"""Why a transfer ended; "" while it runs."""
Outcome = Literal["same", "written", "refused", "unknown", "unanswered", "differs", "unread"]


class ParamResult(NamedTuple):
    """The outcome for one parameter.

    outcome: same: the vehicle already has the value.
        written: set and read back.
        refused: the vehicle kept, or set, another value (`new`).
        unknown: the vehicle has no such parameter.
        unanswered: no answer, so the value may or may not be set.
        differs: not written yet: a dry run, or interrupted.
        unread: interrupted before it was read.
    wanted: the value as the vehicle's type holds it.
    old, new: the values before and after, as far as they were read.
    kind: MAV_PARAM_TYPE.
    why: the reason, where there is one.
    """

    outcome: Outcome
    wanted: float
    old: float | None = None
    new: float | None = None
    kind: int = 0
    why: str = ""


class Progress(NamedTuple):
    """Progress of a transfer. n, of: steps done and in total; of is 0 while the total is unknown."""

    phase: str
    n: int
    of: int


class Transfer:
    """Base of all transfers: sends our heartbeat, follows the vehicle's, and ends on a time-out.

    Call `due` a few times per second and after every received frame, until `done`; then read `ending`.

    system: MAVLink system id of the vehicle.
    component: our own component id.
    now: monotonic time [s].
    """

    def __init__(self, *, system: int, component: int, now: float) -> None:
        self.system = system
        self.ending: Ending = ""
        self.armed: bool | None = None
        self._codec = Codec(SYSTEM, component)
        self._component = component
        self._began = self._next_heartbeat = now
        self._received_at: float | None = None
        self._heartbeat_at: float | None = None
        self._probed_at = now

    @property
    def done(self) -> bool:
        return self.ending != ""

    @property
    def progress(self) -> Progress:
        raise NotImplementedError

    def stop(self) -> None:
        """Stop a running transfer: it ends as interrupted."""
        self.ending = self.ending or "interrupted"

    def due(self, now: float) -> list[bytes]:
        """Return the frames to send now. now: monotonic time [s]."""
        self._update(now)
        if self.done:
            return []
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_PERIOD_S
            frames.append(self._codec.onboard_heartbeat())
        if self._received_at is not None:
            frames += [self._codec.frame(*message) for message in (*self._requests(now), *self._probe(now))]
        return frames

    def receive(self, data: Buffer, frame: Frame, now: float) -> None:
        """Take a frame of any sender. data: the bytes that contain the frame."""
        if frame.sysid != self.system or frame.compid != AUTOPILOT or self.done:
            return
        self._received_at = now
        if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._heartbeat_at = now
            self.armed = bool(byte_at(data, frame, _BASE_MODE_OFFSET) & _ARMED_BIT)
            self._update(now)
        elif frame.msgid == VALUE:
            self._on_value(parse_value(data, frame), now)
        elif (
            frame.msgid == ERROR
            and frame.target_sys in (0, SYSTEM)
            and frame.target_comp in (0, self._component)
        ):
            self._on_error(*parse_error(data, frame))
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            self._on_ack(data, frame)

    def _update(self, now: float) -> None:
        """End the transfer after a time-out."""
        if self._received_at is None and now - self._began > CONNECT_TIMEOUT_S:
            self.ending = self.ending or "no connection"
        elif self._received_at is not None and now - self._received_at > VEHICLE_TIMEOUT_S:
            self.ending = self.ending or "connection lost"

    def _probe(self, now: float) -> Iterable[Message]:
        """Return a request that is always answered, after a pause: a lossy link may drop several answers in a row."""
        if now - max(self._received_at or now, self._probed_at) < _PROBE_PERIOD_S:
            return []
        self._probed_at = now
        return [request_read(self.system, PROBE)]

    def _disarmed(self, now: float) -> bool:
        """Return whether a recent heartbeat shows that the vehicle is not armed."""
        recent = self._heartbeat_at is not None and now - self._heartbeat_at <= VEHICLE_TIMEOUT_S
        return self.armed is False and recent

    def _requests(self, now: float) -> Iterable[Message]:
        raise NotImplementedError

    def _on_value(self, value: Value, now: float) -> None:
        """Handle a PARAM_VALUE, an answer to anybody."""

    def _on_error(self, name: str, error: int, why: str) -> None:
        """Handle a PARAM_ERROR addressed to us."""

    def _on_ack(self, data: Buffer, frame: Frame) -> None:
        """Handle a COMMAND_ACK, addressed to anybody."""


class Rebooter(Transfer):
    """Reboot of a disarmed autopilot with MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN. refusal: its answer where it refuses."""

    def __init__(self, *, system: int, component: int, now: float) -> None:
        super().__init__(system=system, component=component, now=now)
        self.refusal = ""
        self._sent_at: float | None = None

    @property
    def progress(self) -> Progress:
        return Progress("rebooting", int(self.done), 1)

    def _update(self, now: float) -> None:
        sent, received = self._sent_at, self._received_at
        if sent is not None and received is not None and now - max(sent, received) > _REBOOT_TIMEOUT_S:
            self.ending = self.ending or "done"  # the acknowledgement was lost, and the vehicle reboots
        super()._update(now)
        if self.armed:
            self.ending = self.ending or "armed"

    def _requests(self, now: float) -> Iterable[Message]:
        if not self._disarmed(now) or (self._sent_at is not None and now - self._sent_at < _REBOOT_TIMEOUT_S):
            return []
        self._sent_at = now
        return [reboot(self.system)]

    def _on_ack(self, data: Buffer, frame: Frame) -> None:
        if uint_at(data, frame, 0, 2) != REBOOT or self._sent_at is None:
            return
        if frame.target_sys in (0, SYSTEM) and frame.target_comp in (0, self._component):
            result = byte_at(data, frame, 2)
            self.refusal = "" if result == mavlink.MAV_RESULT_ACCEPTED else f"refused: {result_words(result)}"
            self.ending = "done"
