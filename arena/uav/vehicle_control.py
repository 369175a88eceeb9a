"""Commands that wait for their confirmation, and the check that the program still controls its vehicle.

Methods that wait return `Steps`, which `UAV` carries out on its clock and `AsyncUAV` in an event loop.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock, LockstepClock
from arena.errors import (
    CommandRefusedError,
    NotConfirmedError,
    OffboardLostError,
    StaleDataError,
    VehicleError,
)
from arena.geometry import Array, yaw_from_quat
from arena.uav.connection import Connection
from arena.uav.data_source import Source
from arena.uav.heartbeat import Heartbeat
from arena.uav.loss_cause import UNKNOWN, cause_of_loss
from arena.uav.reported_state import TEXTS_S, ReportedState
from arena.uav.setpoints import Encoder
from arena.uav.steps import Steps
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import mode_numbers

T = TypeVar("T")

STREAM_HZ = 50.0
READY_TIMEOUT_S = 20.0
LAND_TIMEOUT_S = 60.0
_CONFIRM_TIMEOUT_S = 3.0
_RETRY_S = 0.5
_TRIES = 5
_REARM_S = 1.0  # from a rejected arming until the next request
_REOFFBOARD_S = 0.3  # from a rejected OFFBOARD until the next request
# PX4 enters OFFBOARD only where setpoints already flow: its check every 0.1 s (v1.16, offboardCheck) must have seen one. Two periods
# and a reserve, sent before the request on the same link, so the delay of the link does not matter.
_STREAM_FIRST_S = 0.25
_RECORD_S, _RECORD_POLL_S = 0.5, 0.05  # wall time: the router records a takeover when the program sees it
_SHARED_RECORD_S = 0.1  # wall time: the world waits for a program for 1 s
_NOT_RECORDED = "the run has not recorded the cause yet: see its events.jsonl"
_HEARTBEAT_S = (
    1.0  # period of heartbeats: the mode in a heartbeat may be as old as this, even if it is read late
)
_MAX_SILENCE = 2.0  # in multiples of stale_s: 1 s by default, as the autopilot's limit for a silent program


class VehicleControl:
    """Commands and setpoints of one vehicle. Setpoints are sent only while the user program calls a method.

    heartbeat: sender of the program's heartbeat, called in each method.
    run: the run folder, which records who took control of the vehicle; None without one.
    """

    def __init__(
        self,
        source: Source,
        connection: Connection,
        clock: Clock,
        system_id: int,
        heartbeat: Heartbeat,
        run: Path | None = None,
    ) -> None:
        self.encoder = Encoder(system_id)
        self._source, self._connection, self._clock = source, connection, clock
        self._heartbeat, self._run = heartbeat, run
        self._reported = ReportedState(source)
        self._record_wait_s, self._unknown_cause = _RECORD_S, UNKNOWN
        self._offboard = False
        self._armed = False
        self._lost = ""
        self._hold: tuple[Array, float] | None = None
        self._holding_since = math.inf

    def share_thread(self) -> None:
        """Call this if the same thread also flies other vehicles: they receive no setpoints while a method waits.

        After a loss of control, no method then waits until the run has recorded the cause; in lockstep only for a short time.
        """
        lockstep = isinstance(self._clock, LockstepClock) and self._clock.lockstep
        self._record_wait_s = _SHARED_RECORD_S if lockstep else 0.0
        self._unknown_cause = _NOT_RECORDED

    def guard(self) -> None:
        """Check that the program still controls the vehicle, and raise an error if not.

        Raises OffboardLostError if the vehicle left OFFBOARD or was disarmed without a command of the
        program. Raises StaleDataError if the autopilot is silent.
        """
        self._connection.refresh()
        heart, last = self._source.telemetry.heartbeat, self._source.telemetry.received_at
        if self._lost:
            raise OffboardLostError(self._lost)
        if heart is None or last is None:
            return
        self._offboard = self._offboard or heart.mode == "OFFBOARD"
        if not self._offboard:
            return
        silent, limit = self._source.now() - last, _MAX_SILENCE * self._source.stale_s
        if silent > limit:
            raise StaleDataError(
                f"{self._source.ns}: the autopilot has been silent for {silent:.2f} s (limit {limit:g} s)"
            )
        if heart.mode != "OFFBOARD":
            self._lose(f"the vehicle left OFFBOARD and is now in {heart.mode}")
        if self._armed and not heart.armed:
            self._lose("the vehicle was disarmed")
        self._armed = heart.armed

    def has_control(self) -> bool:
        """Return whether the vehicle is armed and in OFFBOARD. Raises the errors of `guard`."""
        self.guard()
        return self._offboard and self._reported.has(mode="OFFBOARD", armed=True)

    def flies(self, offboard_loss_s: float) -> bool:
        """Return whether the vehicle follows this program's setpoints. The setpoints of other programs do not count.

        The vehicle must be armed in OFFBOARD, and this program must have sent a setpoint since the vehicle was last in another mode
        or disarmed. A vehicle that is still in OFFBOARD long after that setpoint follows another program: without setpoints, its
        failsafe would have ended OFFBOARD.

        offboard_loss_s: time without setpoints after which the autopilot's failsafe acts, COM_OF_LOSS_T [s]
        """
        if not self._reported.has(mode="OFFBOARD", armed=True):
            return False
        sent_at, telemetry = self._connection.setpoint_at, self._source.telemetry
        heart = telemetry.heartbeat
        silent_s = math.inf if heart is None else heart.received_at - sent_at
        return sent_at > telemetry.outside_offboard_at and silent_s <= offboard_loss_s + _HEARTBEAT_S

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a setpoint. Raises OffboardLostError if the program no longer controls the vehicle."""
        self._heartbeat.beat()
        self.guard()
        self._connection.send_setpoint(message)

    def arm(self, until: float = -math.inf) -> Steps[None]:
        """Arm, and wait until the heartbeat confirms it.

        until: time until which a temporarily rejected request is repeated, when the vehicle is ready [s]
        """
        self._hold = None if self._reported.has(armed=True) else self._hold
        while True:
            result = yield from self._result_of(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), "arming")
            if result != mavlink.MAV_RESULT_TEMPORARILY_REJECTED or self._clock.now() + _REARM_S > until:
                break
            yield from self._wait(lambda: False, _REARM_S)
            yield from self._wait(self._reported.is_ready, until - self._clock.now())
        yield from self._check_result(result, "arming")
        yield from self._confirm(lambda: self._reported.has(armed=True), "armed")
        self._armed = True

    def disarm(self) -> Steps[None]:
        """Disarm, and wait until the heartbeat confirms it. In the air the vehicle holds its position while it waits."""
        offboard, self._offboard, self._hold = self._offboard, False, None  # a requested disarming is no loss
        try:
            yield from self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,), "disarming")
            yield from self._confirm(lambda: self._reported.has(armed=False), "disarmed")
            self._armed = False
        finally:
            self._offboard = offboard

    def enter_offboard(self) -> Steps[None]:
        """Send the current position as setpoint, repeatedly, and request OFFBOARD until the autopilot confirms it."""
        self._begin()
        yield from self._enter()

    def start_mission(self) -> Steps[None]:
        """Wait until the vehicle is ready, enter OFFBOARD and arm. Wait for the confirmation of each step.

        A vehicle that is disarmed in AUTO.LAND, for example after `arena land-all` on the ground, enters OFFBOARD first, because it
        cannot become ready in AUTO.LAND.

        Setpoints are sent all the time. If arming is temporarily rejected, e.g. because poses were missing for
        a moment, it is requested again until READY_TIMEOUT_S has passed.
        """
        self._begin()
        end = self._clock.now() + READY_TIMEOUT_S
        if (yield from self._wait(lambda: self._source.telemetry.received_at is not None, READY_TIMEOUT_S)):
            # heartbeats come once a second: without this, two programs could take off a second apart
            self._request_heartbeat()
        reported = self._reported
        yield from self._wait(lambda: reported.is_ready() or reported.is_disarmed_in_land(), READY_TIMEOUT_S)
        if reported.is_disarmed_in_land():
            yield from self._enter()
        if not (yield from self._wait(reported.is_ready, end - self._clock.now())):
            reason = self._reported.why_not_ready(
                READY_TIMEOUT_S, self._connection.url, self._connection.fault
            )
            raise NotConfirmedError(f"{self._source.ns}: not ready after {READY_TIMEOUT_S:g} s: {reason}")
        if not self._offboard:
            yield from self._enter()
        if not reported.has(armed=True):
            yield from self.arm(until=end)

    def wait_until(self, done: Callable[[], T], timeout_s: float) -> Steps[T | None]:
        """Call `done` repeatedly until it returns a true value, and return this value. Return None after `timeout_s`.

        In OFFBOARD the vehicle holds its position while it waits. Raises OffboardLostError if the program
        loses control.
        """
        self._hold = None
        return (yield from self._wait(done, timeout_s, stream=self._offboard))

    def land(self, *, wait: bool = True) -> Steps[None]:
        """Enter AUTO.LAND and wait until the vehicle is on the ground and disarmed.

        Raises NotConfirmedError after 60 s. Raises OffboardLostError if the vehicle leaves AUTO.LAND in the
        air.
        wait: False returns when the autopilot has confirmed AUTO.LAND.
        """
        if self._reported.is_down():
            return
        self._hold, self._lost = None, ""
        self._offboard = self._armed = False
        sent_at = self._source.now()
        try:
            yield from self._command(mavlink.MAV_CMD_DO_SET_MODE, _mode("AUTO.LAND"), "landing")
        except NotConfirmedError:
            if not self._reported.has_entered(
                "AUTO.LAND", sent_at
            ):  # else only the acknowledgements were lost
                raise
        yield from self._confirm(
            lambda: self._reported.has(mode="AUTO.LAND") or self._reported.is_down(), "in AUTO.LAND"
        )
        if not wait:
            return
        landing = yield from self._wait(
            lambda: self._reported.is_down() or self._reported.has_left_landing(),
            LAND_TIMEOUT_S,
            stream=False,
        )
        if not landing:
            raise NotConfirmedError(
                f"{self._source.ns}: landing not confirmed in {LAND_TIMEOUT_S:g} s: {self._reported.words()}"
            )
        if not self._reported.is_down():
            raise OffboardLostError(
                f"{self._source.ns}: the vehicle left AUTO.LAND before it was on the ground ({self._cause()}): {self._reported.words()}"
            )

    def request_version(self) -> Steps[tuple[int, int, int] | None]:
        """Return the version of the autopilot's software, such as (1, 16, 0), or None if the autopilot does not reply."""
        telemetry = self._source.telemetry
        if telemetry.version is None:
            request = (float(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),)
            try:
                yield from self._command(
                    mavlink.MAV_CMD_REQUEST_MESSAGE, request, "the version request", stream=False
                )
            except VehicleError:
                return None
            yield from self._wait(lambda: telemetry.version is not None, _RETRY_S, stream=False)
        return telemetry.version

    def _enter(self) -> Steps[None]:
        yield from self._wait(
            lambda: self._source.age(self._source.telemetry.local) <= self._source.stale_s, READY_TIMEOUT_S
        )
        self._source.fresh(self._source.telemetry.local, "estimated position")
        yield from self._wait(
            lambda: self._clock.now() - self._holding_since >= _STREAM_FIRST_S, READY_TIMEOUT_S
        )
        yield from self._request_offboard()
        yield from self._confirm(lambda: self._reported.has(mode="OFFBOARD"), "in OFFBOARD")
        self._offboard = True

    def _begin(self) -> None:
        """Reset the states of an earlier flight: control lost, in OFFBOARD, armed. Called when the program takes control."""
        self._lost, self._hold, self._holding_since = "", None, math.inf
        self._offboard = self._armed = False

    def _request_offboard(self) -> Steps[None]:
        """Request OFFBOARD until it is accepted. A final refusal, such as "denied", is not repeated."""
        end = self._clock.now() + _CONFIRM_TIMEOUT_S
        while True:
            result = yield from self._result_of(mavlink.MAV_CMD_DO_SET_MODE, _mode("OFFBOARD"), "OFFBOARD")
            if result != mavlink.MAV_RESULT_TEMPORARILY_REJECTED or self._clock.now() > end:
                return (yield from self._check_result(result, "OFFBOARD"))
            yield from self._wait(lambda: False, _REOFFBOARD_S)

    def _command(
        self, number: int, params: tuple[float, ...], what: str, *, stream: bool = True
    ) -> Steps[None]:
        """Send a command and wait until the autopilot acknowledges it. Raises CommandRefusedError if the autopilot refuses it."""
        result = yield from self._result_of(number, params, what, stream=stream)
        yield from self._check_result(result, what)

    def _result_of(
        self, number: int, params: tuple[float, ...], what: str, *, stream: bool = True
    ) -> Steps[int]:
        """Send a command repeatedly until the autopilot acknowledges it, and return its MAV_RESULT.

        Raises NotConfirmedError after _TRIES tries.
        number: MAV_CMD.  what: the command in error messages.  stream: send setpoints meanwhile.
        """
        self._connection.refresh()
        command = self._connection.command(number)

        def answer() -> int | None:
            """Return the MAV_RESULT of the command plus 1, because `_wait` needs a true value and MAV_RESULT_ACCEPTED is 0."""
            return None if (result := command.result()) is None else result + 1

        for confirmation in range(_TRIES):
            command.send(self.encoder.command(number, params, confirmation))
            result = yield from self._wait(answer, _RETRY_S, stream=stream)
            if result is not None:
                return result - 1
        raise NotConfirmedError(
            f"{self._source.ns}: no acknowledgement of {what} from the autopilot after {_TRIES} tries{self._reported.texts()}"
        )

    def _check_result(self, result: int, what: str) -> Steps[None]:
        if result == mavlink.MAV_RESULT_ACCEPTED:
            return
        yield from self._wait(lambda: False, 0.3)  # the reason may arrive after the answer
        raise CommandRefusedError(
            f"{self._source.ns}: the autopilot refused {what} ({result_words(result)}){self._reported.texts()}"
        )

    def _confirm(self, done: Callable[[], bool], what: str) -> Steps[None]:
        self._request_heartbeat()
        if not (yield from self._wait(done, _CONFIRM_TIMEOUT_S)):
            late = f"command accepted, but the vehicle is not {what} after {_CONFIRM_TIMEOUT_S:g} s"
            raise NotConfirmedError(f"{self._source.ns}: {late}: {self._reported.words()}")

    def _request_heartbeat(self) -> None:
        """Request a heartbeat now, instead of waiting up to 1 s for the next one.

        The acknowledgement of the request is not checked.
        """
        request = mavlink.MAV_CMD_REQUEST_MESSAGE, (float(mavlink.MAVLINK_MSG_ID_HEARTBEAT),)
        self._connection.send(self.encoder.command(*request, 0))

    def _wait(self, done: Callable[[], T], timeout_s: float, *, stream: bool = True) -> Steps[T | None]:
        """Call `done` repeatedly until it returns a true value, and return this value. Return None after `timeout_s`.

        stream: during the wait, send setpoints that hold the position.
        Raises OffboardLostError if the program loses control of the vehicle.
        """
        due = self._clock.now() + 1.0 / STREAM_HZ
        end = self._clock.now() + timeout_s
        while True:
            self._heartbeat.beat()
            if self._offboard:
                self.guard()
            self._connection.refresh()
            if stream:
                self._stream_hold()
            if found := done():
                return found
            yield due
            now = self._clock.now()
            due = max(due + 1.0 / STREAM_HZ, now)  # missed deadlines are skipped
            if now >= end:
                return None

    def _stream_hold(self) -> None:
        """Send one setpoint that holds the position: the current position on the ground, a fixed position in the air."""
        telemetry, stale = self._source.telemetry, self._source.stale_s
        local, attitude, heart = telemetry.local, telemetry.attitude, telemetry.heartbeat
        if local is None or attitude is None or heart is None:
            return
        if (self._hold is None or not heart.armed) and self._source.age(local) <= stale:
            self._hold = local.pos, float(yaw_from_quat(attitude.q_nb))
            self._holding_since = min(self._holding_since, self._clock.now())
        if self._hold is not None:
            self._connection.send_setpoint(self.encoder.pos_yaw(*self._hold, self._clock.now()))

    def _cause(self) -> str:
        """Return the cause of the loss of control, as text."""
        end = time.monotonic() + (self._record_wait_s if self._run is not None else 0.0)
        while True:
            since = self._source.now() - TEXTS_S
            texts = self._source.telemetry.recent_texts(since, mavlink.MAV_SEVERITY_WARNING)
            cause = cause_of_loss(self._source.ns, texts, self._run, time.monotonic())
            if cause != UNKNOWN:
                return cause
            if time.monotonic() >= end:
                return UNKNOWN if self._run is None else self._unknown_cause
            time.sleep(_RECORD_POLL_S)

    def _lose(self, what: str) -> None:
        self._lost = f"{self._source.ns}: {what}: {self._cause()}. The program does not take the vehicle back{self._reported.texts()}"
        raise OffboardLostError(self._lost)


def _mode(words: str) -> tuple[float, float, float]:
    main, sub = mode_numbers(words)
    return float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub)
