"""Commands, confirmations and the watch over OFFBOARD: how a program takes a vehicle, and notices when it is taken away."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from pymavlink.dialects.v20 import common as mavlink

from arena.clock import Clock
from arena.errors import (
    CommandRefusedError,
    NotConfirmedError,
    OffboardLostError,
    StaleDataError,
    VehicleError,
)
from arena.geometry import Array, yaw_from_quat
from arena.uav.connection import COMPONENT, Connection
from arena.uav.data_groups import Source
from arena.uav.heartbeat import Heart
from arena.uav.setpoints import Encoder
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import mode_numbers

T = TypeVar("T")

STREAM_HZ = 50.0
READY_TIMEOUT_S = 20.0
LAND_TIMEOUT_S = 60.0
_CONFIRM_TIMEOUT_S = 3.0
_RETRY_S = 0.5
_TRIES = 5
_STREAM_FIRST_S = 0.5  # PX4 enters OFFBOARD only where setpoints already flow
_TEXTS_S = 10.0
_SILENCE = (
    2.0  # in multiples of stale_s: 1 s by default, when the autopilot itself gives up on a silent program
)


class Pilot:
    """One vehicle's commands. Everything here runs in the caller's own call."""

    def __init__(self, source: Source, link: Connection, clock: Clock, system_id: int, heart: Heart) -> None:
        self.encoder = Encoder(system_id)
        self._source, self._link, self._clock, self._me = source, link, clock, (system_id, COMPONENT)
        self._heart = heart
        self._offboard = False
        self._armed = False
        self._lost = ""
        self._hold: tuple[Array, float] | None = None
        self._holding_since = math.inf

    def guard(self) -> None:
        """Raise if OFFBOARD or arming was taken away, or the autopilot fell silent, since the program had them."""
        self._link.refresh()
        heart, heard = self._source.telemetry.heartbeat, self._source.telemetry.received_at
        if self._lost:
            raise OffboardLostError(self._lost)
        if heart is None or heard is None:
            return
        self._offboard = self._offboard or heart.mode == "OFFBOARD"
        if not self._offboard:
            return
        silent, limit = self._source.now() - heard, _SILENCE * self._source.stale_s
        if silent > limit:
            raise StaleDataError(
                f"{self._source.ns}: the autopilot has been silent for {silent:.2f} s (limit {limit:g} s)"
            )
        if heart.mode != "OFFBOARD":
            self._lose(f"the vehicle left OFFBOARD and is now in {heart.mode}")
        if self._armed and not heart.armed:
            self._lose("the vehicle was disarmed")
        self._armed = heart.armed

    def send(self, message: mavlink.MAVLink_message) -> None:
        """A setpoint, if the vehicle is still the program's."""
        self._heart.beat()
        self.guard()
        self._link.send(message)

    def arm(self) -> None:
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), "arming")
        self._confirm(lambda: self._heart_says(armed=True), "armed")
        self._armed = True

    def disarm(self) -> None:
        offboard, self._offboard = (
            self._offboard,
            False,
        )  # what we ask for ourselves is not taken away from us
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,), "disarming")
        self._confirm(lambda: self._heart_says(armed=False), "disarmed")
        self._offboard, self._armed = offboard, False

    def enter_offboard(self) -> None:
        """Stream the place where the vehicle is, then ask for OFFBOARD until it is confirmed; the stream never pauses."""
        self._begin()
        self._enter()

    def take(self) -> None:
        """Ready, OFFBOARD, armed: each confirmed, with setpoints flowing throughout."""
        self._begin()
        if self._wait(lambda: self._source.telemetry.received_at is not None, READY_TIMEOUT_S):
            # two programs that start on two sides of a heartbeat would take off a second apart
            self._ask_for_heartbeat()
        if not self._wait(self._is_ready, READY_TIMEOUT_S):
            raise NotConfirmedError(
                f"{self._source.ns}: not ready after {READY_TIMEOUT_S:g} s: {self._why_not_ready()}"
            )
        self._enter()
        if not self._heart_says(armed=True):
            self.arm()

    def land(self) -> None:
        """AUTO.LAND, then wait until the vehicle is on the ground and disarmed."""
        if self._is_down():
            return
        self._hold, self._lost = None, ""
        self._offboard = self._armed = False
        self._command(mavlink.MAV_CMD_DO_SET_MODE, _mode("AUTO.LAND"), "landing")
        self._confirm(lambda: self._heart_says(mode="AUTO.LAND") or self._is_down(), "in AUTO.LAND")
        if not self._wait(
            lambda: self._is_down() or self._taken_from_landing(), LAND_TIMEOUT_S, stream=False
        ):
            raise NotConfirmedError(
                f"{self._source.ns}: landing not confirmed in {LAND_TIMEOUT_S:g} s: {self._state()}"
            )
        if not self._is_down():
            raise OffboardLostError(f"{self._source.ns}: something else ended the landing: {self._state()}")

    def ask_version(self) -> tuple[int, int, int] | None:
        """The autopilot's release, or None when it does not tell."""
        telemetry = self._source.telemetry
        if telemetry.version is None:
            request = (float(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),)
            try:
                self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, request, "telling its version", stream=False)
            except VehicleError:
                return None
            self._wait(lambda: telemetry.version is not None, _RETRY_S, stream=False)
        return telemetry.version

    def _enter(self) -> None:
        self._wait(
            lambda: self._source.age(self._source.telemetry.local) <= self._source.stale_s, READY_TIMEOUT_S
        )
        self._source.fresh(self._source.telemetry.local, "estimated position")
        self._wait(lambda: self._clock.now() - self._holding_since >= _STREAM_FIRST_S, READY_TIMEOUT_S)
        self._ask_for_offboard()
        self._confirm(lambda: self._heart_says(mode="OFFBOARD"), "in OFFBOARD")
        self._offboard = True

    def _begin(self) -> None:
        """The program asks for the vehicle anew: what was lost before is past."""
        self._lost, self._hold, self._holding_since, self._offboard, self._armed = (
            "",
            None,
            math.inf,
            False,
            False,
        )

    def _ask_for_offboard(self) -> None:
        end = self._clock.now() + _CONFIRM_TIMEOUT_S
        while True:
            try:
                return self._command(mavlink.MAV_CMD_DO_SET_MODE, _mode("OFFBOARD"), "OFFBOARD")
            except CommandRefusedError:
                if self._clock.now() > end:
                    raise

    def _command(self, number: int, params: tuple[float, ...], what: str, *, stream: bool = True) -> None:
        """Send until it is answered, with MAVLink's confirmation counter; judge the answer."""
        self._link.refresh()
        self._source.telemetry.acks.clear()
        for confirmation in range(_TRIES):
            self._link.send(self.encoder.command(number, params, confirmation))
            result = self._wait(lambda: self._answer(number), _RETRY_S, stream=stream)
            if result is not None:
                return self._judge(result - 1, what)
        raise NotConfirmedError(
            f"{self._source.ns}: the autopilot did not answer to {what}, asked {_TRIES} times{self._texts()}"
        )

    def _answer(self, number: int) -> int | None:
        """The result of our command plus one (so that accepted is true), or None while there is none."""
        for ack in list(self._source.telemetry.acks):
            ours = ack.command == number and ack.target == self._me
            if ours and ack.result != mavlink.MAV_RESULT_IN_PROGRESS:
                return ack.result + 1
        return None

    def _judge(self, result: int, what: str) -> None:
        if result == mavlink.MAV_RESULT_ACCEPTED:
            return
        self._wait(lambda: False, 0.3)  # the reason may come after the answer
        words = result_words(result)
        raise CommandRefusedError(f"{self._source.ns}: the autopilot refused {what} ({words}){self._texts()}")

    def _confirm(self, done: Callable[[], bool], what: str) -> None:
        self._ask_for_heartbeat()
        if not self._wait(done, _CONFIRM_TIMEOUT_S):
            late = f"accepted, but not {what} after {_CONFIRM_TIMEOUT_S:g} s"
            raise NotConfirmedError(f"{self._source.ns}: {late}: {self._state()}")

    def _ask_for_heartbeat(self) -> None:
        """They come once a second; asked for, one comes at once. What is acknowledged of it is no matter."""
        heartbeat = (float(mavlink.MAVLINK_MSG_ID_HEARTBEAT),)
        self._link.send(self.encoder.command(mavlink.MAV_CMD_REQUEST_MESSAGE, heartbeat, 0))

    def _wait(self, done: Callable[[], T], timeout_s: float, *, stream: bool = True) -> T | None:
        """Until done() is true, streaming; its value, or None when the time is over. `_lost` ends it with an error."""
        rate = self._clock.rate(STREAM_HZ)
        end = self._clock.now() + timeout_s
        while True:
            self._heart.beat()
            if self._offboard:
                self.guard()
            self._link.refresh()
            if stream:
                self._stream_hold()
            found = done()
            if found:
                return found
            if rate.sleep() >= end:
                return None

    def _stream_hold(self) -> None:
        """One setpoint: stay where you are. On the ground that place follows the estimate; in the air it is fixed."""
        telemetry, stale = self._source.telemetry, self._source.stale_s
        local, attitude, heart = telemetry.local, telemetry.attitude, telemetry.heartbeat
        if local is None or attitude is None or heart is None:
            return
        if (self._hold is None or not heart.armed) and self._source.age(local) <= stale:
            self._hold = local.pos, float(yaw_from_quat(attitude.q_nb))
            self._holding_since = min(self._holding_since, self._clock.now())
        if self._hold is not None:
            self._link.send(self.encoder.pos_yaw(*self._hold, self._clock.now()))

    def _is_ready(self) -> bool:
        t, limit = self._source.telemetry, self._source.limit_s
        if self._source.age(t.local) > limit("") or self._source.age(t.attitude) > limit(""):
            return False
        if t.heartbeat is None or self._source.age(t.heartbeat) > limit("heartbeat"):
            return False
        return t.heartbeat.armed or (t.status is not None and t.status.prearm)

    def _why_not_ready(self) -> str:
        t = self._source.telemetry
        if t.heartbeat is None:
            return "no heartbeat of the autopilot has been heard" + (
                f" ({self._link.fault})" if self._link.fault else ""
            )
        if self._source.age(t.local) > self._source.stale_s:
            return f"the autopilot has no position estimate{self._texts()}"
        return f"the autopilot's pre-arm checks fail{self._texts(READY_TIMEOUT_S + _TEXTS_S)}"

    def _heart_says(self, *, mode: str | None = None, armed: bool | None = None) -> bool:
        heart = self._source.telemetry.heartbeat
        return heart is not None and mode in (None, heart.mode) and armed in (None, heart.armed)

    def _is_down(self) -> bool:
        ground = self._source.telemetry.ground
        fresh = self._source.age(ground) <= self._source.limit_s("landed state")
        return fresh and ground is not None and ground.landed and self._heart_says(armed=False)

    def _taken_from_landing(self) -> bool:
        return self._heart_says(armed=True) and not self._heart_says(mode="AUTO.LAND")

    def _state(self) -> str:
        t = self._source.telemetry
        if t.heartbeat is None:
            return "no heartbeat has been heard"
        ground = "unknown" if t.ground is None else "on the ground" if t.ground.landed else "in the air"
        age = self._source.age(t.heartbeat)
        armed = "armed" if t.heartbeat.armed else "disarmed"
        return f"mode {t.heartbeat.mode}, {armed}, {ground}, last telemetry {age:.1f} s ago{self._texts()}"

    def _texts(self, seconds: float = _TEXTS_S) -> str:
        worst = mavlink.MAV_SEVERITY_WARNING
        said = self._source.telemetry.recent_texts(self._source.now() - seconds, worst)
        return f"; it says: {'; '.join(said[-3:])}" if said else ""

    def _lose(self, what: str) -> None:
        self._lost = (
            f"{self._source.ns}: {what}: the pilot wins, and the program does not take it back{self._texts()}"
        )
        raise OffboardLostError(self._lost)


def _mode(words: str) -> tuple[float, float, float]:
    main, sub = mode_numbers(words)
    return float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub)
