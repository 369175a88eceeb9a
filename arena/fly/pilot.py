"""Flight by hand without sockets: MAVLink frames for sticks and requested modes, and the vehicle's telemetry.

Pure.

The sender is a ground station at the tools port of the router (docs/explanation/authority.md). A manual mode
request of this sender takes the vehicle from its program.
"""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import PILOT
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import MANUAL_MODES, mode_numbers
from arena.wire.sticks import Sticks, manual_control_fields
from arena.wire.telemetry import Telemetry

SOURCE_PARAMETER = "COM_RC_IN_MODE"
_JOYSTICK_SOURCES = (1, 2, 3)
_TRIES, _RETRY_S = 4, 0.5
_MODE_ENABLED = 1.0  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_OFFBOARD = "OFFBOARD"
_STALE_S = 2.5  # age above which a heartbeat is ignored
_TEXT_S = 8.0
_RECEIVED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}


class Pilot:
    """Manual flight of one vehicle by a person: the frames to send, and the vehicle's reported state.

    name: name of the vehicle. system: its MAVLink system id. All times `now` are monotonic [s].
    source: value of COM_RC_IN_MODE, None before the vehicle has reported it
    flies: True if this pilot has taken the vehicle with a mode or by arming it, and has not given it back
    """

    def __init__(self, name: str, system: int) -> None:
        self.name, self._system = name, system
        self._codec = Codec(PILOT.system, PILOT.component)
        self._telemetry = Telemetry(system, _RECEIVED)
        self.source: int | None = None
        self.flies = False
        self._request: tuple[str, bytes, int] | None = None  # what, command and number of MAV_CMD
        self._tries, self._next_try, self._requested_at = 0, 0.0, 0.0
        self.message = ""

    # -- what the vehicle reports ----------------------------------------------------------------------------

    def on_datagram(self, data: bytes, now: float) -> None:
        """Update the reported state of the vehicle from a received datagram."""
        self._telemetry.on_datagram(data, now)
        if self.source is None:
            for m in self._codec.parse(data, {mavlink.MAVLINK_MSG_ID_PARAM_VALUE}):
                if m.param_id == SOURCE_PARAMETER:
                    self.source = _integer_of(m.param_value)
        self._read_answer()

    def state(self, now: float) -> tuple[str, bool] | None:
        """Return (flight mode, True if armed); None without a recent heartbeat."""
        heart = self._telemetry.heartbeat
        return (heart.mode, heart.armed) if heart is not None and now - heart.received_at < _STALE_S else None

    def source_problem(self) -> str:
        """Return a text for the user if COM_RC_IN_MODE makes the vehicle ignore joysticks; otherwise ""."""
        if self.source is None or self.source in _JOYSTICK_SOURCES:
            return ""
        who = "only an RC transmitter" if self.source == 0 else "no sticks"
        return f"{self.name}: {SOURCE_PARAMETER} is {self.source}: the vehicle obeys {who}. Set it to 1 (joystick)"

    def status(self, now: float) -> str:
        """Return one line for the terminal: mode, arming state, height, speed, battery, last message."""
        state, t = self.state(now), self._telemetry
        if state is None:
            return f"{self.name}: no heartbeat"
        height = f"{-t.local.pos[2]:5.2f} m" if t.local is not None else "    ? m"
        speed = f"{float((t.local.vel @ t.local.vel) ** 0.5):4.1f} m/s" if t.local is not None else "   ? m/s"
        battery = f"{t.status.battery:3.0f} %" if t.status is not None else "  ? %"
        armed = "armed" if state[1] else "disarmed"
        return f"{self.name}  {state[0]:<12} {armed:<8}  height {height}  speed {speed}  battery {battery}  {self._news(now)}"

    def _news(self, now: float) -> str:
        if self._request is not None:
            return f"{self._request[0]} ..."
        texts = self._telemetry.recent_texts(now - _TEXT_S, mavlink.MAV_SEVERITY_INFO)
        return self.message or (texts[-1] if texts else "")

    # -- what the person wants -------------------------------------------------------------------------------

    def frames(self, sticks: Sticks | None, now: float) -> list[bytes]:
        """Return the MAVLink frames to send now: the stick positions, and a request that has no reply yet.

        sticks: stick positions; None sends no positions, so that the failsafe acts.
        """
        found = []
        if sticks is not None:
            fields = manual_control_fields(sticks)
            found.append(self._codec.pack(mavlink.MAVLink_manual_control_message(self._system, *fields, 0)))
        if self._request is not None and now >= self._next_try:
            if self._tries >= _TRIES:
                self.message, self._request = f"{self._request[0]}: no reply from the vehicle", None
            else:
                self._tries, self._next_try = self._tries + 1, now + _RETRY_S
                found.append(self._request[1])
        return found

    def source_request(self) -> bytes:
        """Return the PARAM_REQUEST_READ frame for COM_RC_IN_MODE, which selects the sticks that PX4 obeys."""
        name = SOURCE_PARAMETER.encode()
        return self._codec.pack(mavlink.MAVLink_param_request_read_message(self._system, 1, name, -1))

    def request(self, action: str, now: float) -> None:
        """Request a mode, `arm` or `disarm`. The request is sent up to four times, until the vehicle replies.

        A new request replaces the last one.
        """
        if action in ("arm", "disarm"):
            number, params = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, [1.0 if action == "arm" else 0.0]
        else:
            main, sub = mode_numbers(action)
            number, params = mavlink.MAV_CMD_DO_SET_MODE, [_MODE_ENABLED, float(main), float(sub)]
        seven = [*params, *[0.0] * 7][:7]
        frame = self._codec.pack(mavlink.MAVLink_command_long_message(self._system, 1, number, 0, *seven))
        self._telemetry.acks.clear()
        self._request, self._tries, self._next_try, self._requested_at = (action, frame, number), 0, now, now
        self.message = ""

    @property
    def is_busy(self) -> bool:
        """True while the vehicle has not replied to a request."""
        return self._request is not None

    def must_land(self, now: float) -> bool:
        """Return whether the person must land the vehicle before `arena fly` can end.

        This is so if the vehicle is armed and flown by this person.
        """
        state = self.state(now)
        if state is None:
            return self.flies
        mode, armed = state
        return armed and mode != _OFFBOARD and (self.flies or mode in MANUAL_MODES)

    def _read_answer(self) -> None:
        if self._request is None:
            return
        what, _, number = self._request
        for ack in list(self._telemetry.acks):
            if ack.command != number or ack.result == mavlink.MAV_RESULT_IN_PROGRESS:
                continue
            self._request = None
            if ack.result == mavlink.MAV_RESULT_ACCEPTED:
                self.message = ""
                self.flies = what not in (_OFFBOARD, "disarm")
            else:
                texts = self._telemetry.recent_texts(self._requested_at, mavlink.MAV_SEVERITY_WARNING)
                reason = f": {texts[-1]}" if texts else ""
                self.message = f"{what} refused ({result_words(ack.result)}){reason}"
            return


def _integer_of(value: float) -> int:
    """Decode an INT32 parameter, which PX4 sends in PARAM_VALUE as the four bytes of a float."""
    return int.from_bytes(struct.pack("<f", value), "little", signed=True)
