"""Base class for reading and writing a vehicle's parameters and rebooting it, without sockets and clocks.

Callers pass received frames and the time, and send the frames that `due` returns. Any message of the autopilot shows that the
vehicle is connected. Only a heartbeat (one per second) shows that the vehicle is not armed.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from arena.params.transfer.uid_check import UidCheck
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, byte_at, uint_at
from arena.wire.mavlink_ids import PARAMETER_TOOL
from arena.wire.mavlink_minimal import (
    AUTOPILOT_VERSION,
    SYSTEM_TIME,
    parse_boot_ms,
    parse_firmware_version,
    parse_hardware_uid,
    result_words,
)
from arena.wire.mavlink_params import (
    ERROR,
    REBOOT,
    VALUE,
    Message,
    Value,
    parse_error,
    parse_value,
    reboot,
    request_boot_time,
    request_read,
    request_uid,
)

CONNECT_TIMEOUT_S = 10.0  # for the first message of the vehicle
VEHICLE_TIMEOUT_S = 3.0  # between two messages of the vehicle
_HEARTBEAT_PERIOD_S = 1.0
_PROBE_PERIOD_S = 0.4
_ARMED_BIT, _BASE_MODE_OFFSET = 128, 6
_REBOOT_TIMEOUT_S = 2.5
PROBE = 0  # index of a parameter that every vehicle has

Ending = Literal[
    "",
    "done",
    "armed",
    "no connection",
    "connection lost",
    "interrupted",
    "wrong vehicle",
    "wrong version",
    "not rebooted",
]
"""Why a transfer ended; "" while it runs."""
Outcome = Literal["same", "written", "refused", "unknown", "unanswered", "differs", "unread"]


class ParamResult(NamedTuple):
    """Outcome of writing one parameter to a vehicle, with its old and new values.

    outcome: same: the vehicle already had the value.
        written: the value was set and read back.
        refused: the vehicle kept its old value or set another one (`new`).
        unknown: the vehicle has no such parameter.
        unanswered: the vehicle did not answer; the value may or may not be set.
        differs: not written, because this was a dry run or the transfer ended early.
        unread: not read, because the transfer ended early.
    wanted: the wanted value, rounded to the parameter's type.
    old, new: values before and after the transfer; None if not read.
    kind: MAV_PARAM_TYPE.
    why: reason for the outcome; "" if there is none.
    """

    outcome: Outcome
    wanted: float
    old: float | None = None
    new: float | None = None
    kind: int = 0
    why: str = ""

    @property
    def may_have_changed(self) -> bool:
        """True if the vehicle has another value than before the transfer, or may have it because it did not answer."""
        if self.outcome == "refused":
            return self.new != self.old
        return self.outcome == "written" or (self.outcome == "unanswered" and self.old is not None)


class Progress(NamedTuple):
    """Progress of a transfer, for the display.

    n: number of steps done. of: total number of steps; 0 while it is unknown.
    """

    phase: str
    n: int
    of: int


class Transfer:
    """Base class of a transfer with one vehicle over MAVLink, such as reading its parameters.

    Sends this program's heartbeat, tracks the vehicle's heartbeat, and ends on a time-out.

    Call `due` a few times per second and after every received frame, until `done` is true. Then read `ending`.

    system: MAVLink system id of the vehicle.
    component: MAVLink component id of this program.
    now: monotonic time [s].
    uid: check of the vehicle's hardware uid, which must pass before the first request; None: not checked.
    booted_at: monotonic time at which the vehicle booted [s], from SYSTEM_TIME; None before the first SYSTEM_TIME.
    firmware: version of the vehicle's firmware, such as "1.16.0", from AUTOPILOT_VERSION; "" if it is not reported.
    requests_boot_time: SYSTEM_TIME is requested together with the uid.
    """

    requests_boot_time = False

    def __init__(self, *, system: int, component: int, now: float, uid: UidCheck | None = None) -> None:
        self.system, self.uid = system, uid
        self.ending: Ending = ""
        self.armed: bool | None = None
        self.booted_at: float | None = None
        self.firmware = ""
        self._codec = Codec(PARAMETER_TOOL.system, component)
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
        """End the transfer with the result "interrupted", unless it has already ended."""
        self.ending = self.ending or "interrupted"

    def due(self, now: float) -> list[bytes]:
        """Return the MAVLink frames that must be sent now. now: monotonic time [s]."""
        self._update(now)
        if self.done:
            return []
        frames = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + _HEARTBEAT_PERIOD_S
            frames.append(self._codec.onboard_heartbeat())
        if self._received_at is not None and self.uid is not None and not self.uid.passed:
            frames += [self._codec.frame(*message) for message in self._identity_requests(self.uid, now)]
        elif self._received_at is not None:
            frames += [self._codec.frame(*message) for message in (*self._requests(now), *self._probe(now))]
        return frames

    def receive(self, data: Buffer, frame: Frame, now: float) -> None:
        """Process a received MAVLink frame. Only frames of the vehicle's autopilot have an effect.

        data: bytes that contain the frame.
        now: monotonic time [s].
        """
        if frame.sysid != self.system or frame.compid != AUTOPILOT or self.done:
            return
        self._received_at = now
        if frame.msgid == AUTOPILOT_VERSION:
            self._on_version(data, frame)
        elif self.uid is not None and not self.uid.passed and frame.msgid == VALUE:
            return  # perhaps of another vehicle
        if frame.msgid == SYSTEM_TIME:
            self.booted_at = now - parse_boot_ms(data, frame) * 1e-3
        if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._heartbeat_at = now
            self.armed = bool(byte_at(data, frame, _BASE_MODE_OFFSET) & _ARMED_BIT)
            self._update(now)
        elif frame.msgid == VALUE:
            self._on_value(parse_value(data, frame), now)
        elif (
            frame.msgid == ERROR
            and frame.target_sys in (0, PARAMETER_TOOL.system)
            and frame.target_comp in (0, self._component)
        ):
            self._on_error(*parse_error(data, frame))
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            self._on_ack(data, frame)

    def _identity_requests(self, uid: UidCheck, now: float) -> Iterable[Message]:
        """Return the requests for the hardware uid and the boot time, if they are due."""
        if not uid.is_due(now):
            return []
        boot_time = [request_boot_time(self.system)] if self.requests_boot_time else []
        return [request_uid(self.system), *boot_time]

    def _on_version(self, data: Buffer, frame: Frame) -> None:
        """Process an AUTOPILOT_VERSION: hardware uid and version of the firmware."""
        version = parse_firmware_version(data, frame)
        self.firmware = ".".join(map(str, version)) if any(version) else ""
        if self.uid is not None:
            self.uid.receive(parse_hardware_uid(data, frame))
            self._check_uid()

    def _check_uid(self) -> None:
        """End the transfer if the hardware uid shows that a wrong vehicle answers."""
        if self.uid is not None and self.uid.problem:
            self.ending = self.ending or "wrong vehicle"

    def _update(self, now: float) -> None:
        """End the transfer if the vehicle has sent nothing for too long. now: monotonic time [s]."""
        if self._received_at is None and now - self._began > CONNECT_TIMEOUT_S:
            self.ending = self.ending or "no connection"
        elif self._received_at is not None and now - self._received_at > VEHICLE_TIMEOUT_S:
            self.ending = self.ending or "connection lost"
        self._check_uid()

    def _probe(self, now: float) -> Iterable[Message]:
        """Return a request to test the connection if the vehicle has sent nothing for a while, else an empty list.

        Every vehicle answers this request. The answer shows that the vehicle is still connected, although a lossy
        link has dropped messages.
        """
        if now - max(self._received_at or now, self._probed_at) < _PROBE_PERIOD_S:
            return []
        self._probed_at = now
        return [request_read(self.system, PROBE)]

    def _disarmed(self, now: float) -> bool:
        """Return whether a recent heartbeat has shown that the vehicle is disarmed."""
        recent = self._heartbeat_at is not None and now - self._heartbeat_at <= VEHICLE_TIMEOUT_S
        return self.armed is False and recent

    def _requests(self, now: float) -> Iterable[Message]:
        raise NotImplementedError

    def _on_value(self, value: Value, now: float) -> None:
        """Process a PARAM_VALUE, which may be the answer to a request of this program or of another one."""

    def _on_error(self, name: str, error: int, why: str) -> None:
        """Process a PARAM_ERROR that is addressed to this program."""

    def _on_ack(self, data: Buffer, frame: Frame) -> None:
        """Process a COMMAND_ACK. It may be addressed to another program."""


class Rebooter(Transfer):
    """Transfer that reboots the autopilot of a disarmed vehicle.

    The command is MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN.

    refusal: the autopilot's answer if it refuses; else "".
    """

    def __init__(self, *, system: int, component: int, now: float, uid: UidCheck | None = None) -> None:
        super().__init__(system=system, component=component, now=now, uid=uid)
        self.refusal = ""
        self._sent_at: float | None = None

    @property
    def progress(self) -> Progress:
        return Progress("rebooting", int(self.done), 1)

    def _update(self, now: float) -> None:
        sent, received = self._sent_at, self._received_at
        if sent is not None and received is not None and now - max(sent, received) > _REBOOT_TIMEOUT_S:
            self.ending = self.ending or "done"  # the acknowledgement was lost, but the vehicle is rebooting
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
        if frame.target_sys in (0, PARAMETER_TOOL.system) and frame.target_comp in (0, self._component):
            result = byte_at(data, frame, 2)
            self.refusal = "" if result == mavlink.MAV_RESULT_ACCEPTED else f"refused: {result_words(result)}"
            self.ending = "done"
