"""One vehicle spoken to about its parameters: frames and time in, frames and state out. No sockets, no clocks.

What reading (`reading.py`), writing (`writing.py`) and rebooting have in common. A vehicle is there while anything is heard of
its autopilot; that it is not armed, only its heartbeats tell, of which there is one a second.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer, Frame, byte_at, uint_at
from arena.wire.mavlink_minimal import result_words
from arena.wire.mavlink_params import (
    AUTOPILOT,
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
PATIENCE_S = 10.0  # for the first word of the vehicle
SILENT_S = 3.0  # then it has vanished
_HEARTBEAT_S = 1.0
_KNOCK_S = 0.4
_ARMED, _BASE_MODE = 128, 6
_REBOOTING_S = 2.5
PROBE = 0  # the index of a parameter that is always there

Ending = Literal["", "done", "armed", "vanished", "not heard", "interrupted"]
Outcome = Literal["same", "written", "refused", "unknown", "lost", "differs", "untried"]


class Result(NamedTuple):
    """What became of one parameter.

    same: held already.  written: set, and read back.  refused: the vehicle kept, or took, `new`.  unknown: no such parameter.
    lost: no answer, so that it may or may not be set.  differs: to be written, but this was a dry run, or cut short.
    untried: cut short before it was read.
    wanted: as the vehicle's type holds it.  old: before.  new: as last heard.  why: in words, where there is more to say.
    """

    outcome: Outcome
    wanted: float
    old: float | None = None
    new: float | None = None
    kind: int = 0
    why: str = ""


class Progress(NamedTuple):
    """phase: in words.  n, of: steps done and all of them."""

    phase: str
    n: int
    of: int


class Transfer:
    """What reading, writing and rebooting have in common: our heartbeat, and what the vehicle's tells.

    Ask `due` a few times a second and after whatever was heard, until `done`; then look at `ending`.
    """

    def __init__(self, *, system: int, component: int, now: float) -> None:
        """system: of the vehicle.  component: ours.  now: monotonic [s]."""
        self.system = system
        self.ending: Ending = ""
        self.armed: bool | None = None
        self._codec = Codec(SYSTEM, component)
        self._component = component
        self._began = self._next_heartbeat = now
        self._heard_at: float | None = None
        self._pulse_at: float | None = None
        self._knocked_at = now

    @property
    def done(self) -> bool:
        return self.ending != ""

    @property
    def progress(self) -> Progress:
        raise NotImplementedError

    def stop(self) -> None:
        """Somebody has had enough of it."""
        self.ending = self.ending or "interrupted"

    def due(self, now: float) -> list[bytes]:
        """Frames to send now."""
        self._look(now)
        if self.done:
            return []
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_S
            frames.append(self._codec.onboard_heartbeat())
        if self._heard_at is not None:
            frames += [self._codec.frame(*message) for message in (*self._ask(now), *self._knock(now))]
        return frames

    def hear(self, data: Buffer, frame: Frame, now: float) -> None:
        """A frame that stands in `data`, whoever sent it."""
        if frame.sysid != self.system or frame.compid != AUTOPILOT or self.done:
            return
        self._heard_at = now
        if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._pulse_at = now
            self.armed = bool(byte_at(data, frame, _BASE_MODE) & _ARMED)
            self._look(now)
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

    def _look(self, now: float) -> None:
        if self._heard_at is None and now - self._began > PATIENCE_S:
            self.ending = self.ending or "not heard"
        elif self._heard_at is not None and now - self._heard_at > SILENT_S:
            self.ending = self.ending or "vanished"

    def _knock(self, now: float) -> Iterable[Message]:
        """Is anybody there? Not every silence of a wire that loses some is a vehicle that has gone."""
        if now - max(self._heard_at or now, self._knocked_at) < _KNOCK_S:
            return []
        self._knocked_at = now
        return [request_read(self.system, PROBE)]

    def _pulse(self, now: float) -> bool:
        """Is it known by a fresh heartbeat that the vehicle is not armed?"""
        return self.armed is False and self._pulse_at is not None and now - self._pulse_at <= SILENT_S

    def _ask(self, now: float) -> Iterable[Message]:
        raise NotImplementedError

    def _on_value(self, value: Value, now: float) -> None:
        """A PARAM_VALUE, whoever it answers."""

    def _on_error(self, name: str, error: int, why: str) -> None:
        """A PARAM_ERROR, to us."""

    def _on_ack(self, data: Buffer, frame: Frame) -> None:
        """A COMMAND_ACK, to anybody."""


class Rebooter(Transfer):
    """MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN of an autopilot that is not armed. refusal: its answer, where it was no."""

    def __init__(self, *, system: int, component: int, now: float) -> None:
        super().__init__(system=system, component=component, now=now)
        self.refusal = ""
        self._asked_at: float | None = None

    @property
    def progress(self) -> Progress:
        return Progress("rebooting", int(self.done), 1)

    def _look(self, now: float) -> None:
        asked, heard = self._asked_at, self._heard_at
        if asked is not None and heard is not None and now - max(asked, heard) > _REBOOTING_S:
            self.ending = self.ending or "done"  # its acknowledgement was lost, and it is gone
        super()._look(now)
        if self.armed:
            self.ending = self.ending or "armed"

    def _ask(self, now: float) -> Iterable[Message]:
        if not self._pulse(now) or (self._asked_at is not None and now - self._asked_at < _REBOOTING_S):
            return []
        self._asked_at = now
        return [reboot(self.system)]

    def _on_ack(self, data: Buffer, frame: Frame) -> None:
        if uint_at(data, frame, 0, 2) != REBOOT or self._asked_at is None:
            return
        if frame.target_sys in (0, SYSTEM) and frame.target_comp in (0, self._component):
            result = byte_at(data, frame, 2)
            self.refusal = "" if result == mavlink.MAV_RESULT_ACCEPTED else f"refused: {result_words(result)}"
            self.ending = "done"
