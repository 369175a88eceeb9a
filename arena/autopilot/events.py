"""Events that the built-in autopilot reports to ground stations by the MAVLink event protocol.

Names, arguments and log levels are those of PX4 v1.16, so that a client knows the events with the metadata of
either autopilot. The id of an event is computed from its name. Pure: no vehicle, no messages.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from arena.autopilot.flight_modes import Mode

EMERGENCY, CRITICAL, ERROR, WARNING, INFO, DISABLED = 0, 2, 3, 4, 6, 9
"""Log levels of events. Those of texts (MAV_SEVERITY) have the same numbers."""
_AUTOPILOT = 1 << 24  # component whose names the lower 24 bits of an id belong to
_FNV_START, _FNV_PRIME = 0x811C9DC5, 0x1000193
_CODES = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "float": "f"}

ENUMS: dict[str, dict[int, tuple[str, str]]] = {
    "arm_disarm_reason_t": {
        1: ("stick_gesture", "stick gesture"),
        3: ("command_internal", "the autopilot"),
        4: ("command_external", "external command"),
        5: ("mission_start", "start of the mission"),
        6: ("auto_disarm_land", "landing"),
        7: ("auto_disarm_preflight", "no take-off after arming"),
        14: ("failsafe", "failsafe"),
    },
    "failsafe_action_t": {
        0: ("none", "none"),
        1: ("warn", "warning"),
        2: ("fallback_posctrl", "POSCTL"),
        3: ("fallback_altctrl", "ALTCTL"),
        4: ("fallback_stabilized", "STABILIZED"),
        5: ("hold", "AUTO.LOITER"),
        6: ("rtl", "AUTO.RTL"),
        7: ("land", "AUTO.LAND"),
        8: ("descend", "DESCEND"),
        9: ("disarm", "disarming"),
        10: ("terminate", "TERMINATION"),
    },
    "failsafe_cause_t": {
        0: ("generic", "failsafe"),
        1: ("manual_control_loss", "manual control lost"),
        2: ("gcs_connection_loss", "data link lost"),
        3: ("low_battery_level", "low battery"),
        4: ("critical_battery_level", "critical battery"),
        5: ("emergency_battery_level", "emergency battery"),
    },
    "navigation_mode_t": {
        0: ("manual", "MANUAL"),
        1: ("altctl", "ALTCTL"),
        2: ("posctl", "POSCTL"),
        3: ("auto_mission", "AUTO.MISSION"),
        4: ("auto_loiter", "AUTO.LOITER"),
        5: ("auto_rtl", "AUTO.RTL"),
        6: ("acro", "ACRO"),
        7: ("offboard", "OFFBOARD"),
        8: ("stab", "STABILIZED"),
        10: ("auto_takeoff", "AUTO.TAKEOFF"),
        11: ("auto_land", "AUTO.LAND"),
        255: ("unknown", "unknown"),
    },
}
"""Type of an argument -> value -> (PX4's name, text for people). Each value is one byte."""


class Event(NamedTuple):
    """Event of the MAVLink event protocol, before `EventServer` gives it a sequence number.

    levels: log level in logs (upper 4 bits) and for ground stations (lower 4 bits)
    arguments: the encoded arguments, at most 40 bytes
    says_all: True if the text that is sent with the event says no more than the event
    text: that text if `says_all`, else ""
    """

    id: int
    levels: int
    arguments: bytes = b""
    says_all: bool = False
    text: str = ""

    def with_text(self, text: str) -> Event:
        """Attach a text (STATUSTEXT) to the event if the text only repeats the event. Return the event.

        Ground stations that show the event can then drop the text. For other event types, return the event unchanged.
        """
        return self._replace(text=text) if self.says_all else self


@dataclass(frozen=True, slots=True)
class EventType:
    """Type of MAVLink event, such as arming. Call it with the values of its arguments to create an `Event`.

    external, internal: log levels for ground stations and in logs
    arguments: type of each argument: a number or a name in ENUMS
    message: text for people; {1} is the first argument
    says_all: True if the text that is sent with the event says no more than the event
    """

    name: str
    message: str
    external: int
    internal: int
    arguments: tuple[str, ...] = ()
    says_all: bool = False

    @property
    def id(self) -> int:
        return _AUTOPILOT | event_number(self.name)

    def __call__(self, *values: float) -> Event:
        layout = "<" + "".join(_CODES.get(kind, "B") for kind in self.arguments)
        return Event(self.id, self.internal << 4 | self.external, struct.pack(layout, *values), self.says_all)


def event_number(name: str) -> int:
    """Return the lower 24 bits of an event's id: the FNV-1a hash of its name."""
    value = _FNV_START
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return value & 0xFFFFFF


TYPES: dict[str, EventType] = {}
"""Kinds of events by name."""


def _define(
    name: str,
    message: str,
    external: int,
    arguments: tuple[str, ...] = (),
    *,
    internal: int | None = None,
    says_all: bool = False,
) -> EventType:
    level = external if internal is None else internal
    TYPES[name] = EventType(name, message, external, level, arguments, says_all)
    return TYPES[name]


_MODE, _ACTION, _CAUSE, _REASON = "uint32_t", "failsafe_action_t", "failsafe_cause_t", "arm_disarm_reason_t"

ARMED = _define("commander_armed_by", "Armed: {1}", INFO, (_REASON,), says_all=True)
DISARMED = _define("commander_disarmed_by", "Disarmed: {1}", INFO, (_REASON,), says_all=True)
ARMING_DENIED = _define(
    "commander_arm_denied_resolve_failures",
    "Arming denied: an arming check fails",
    CRITICAL,
    internal=INFO,
)
NOT_MANUAL = _define(
    "commander_arm_denied_not_manual",
    "Arming denied: switch to manual mode first",
    CRITICAL,
    internal=INFO,
    says_all=True,
)
NOT_LANDED = _define(
    "commander_disarm_denied_not_landed",
    "Disarming denied: not landed",
    CRITICAL,
    internal=INFO,
    says_all=True,
)
MODE_DENIED = _define(
    "commander_modeswitch_not_avail",
    "Mode change denied: {2}",
    CRITICAL,
    (_MODE, "navigation_mode_t"),
    internal=INFO,
)
TAKEOFF = _define("commander_takeoff_detected", "Takeoff detected", INFO, says_all=True)
LANDING = _define("commander_landing_detected", "Landing detected", INFO, says_all=True)
PILOT = _define("commander_rc_override", "Pilot took over using sticks", INFO, says_all=True)
RETURN = _define("commander_rtl", "Returning to launch", INFO, says_all=True)
ARM_PARAMETER = _define(
    "commander_unsupported_arm_disarm_param", "Unsupported ARM_DISARM param: {1:.3}", ERROR, ("float",)
)
NO_MISSION = _define(
    "commander_mission_start_denied_no_mission",
    "Mission start denied: no valid mission",
    CRITICAL,
    internal=INFO,
    says_all=True,
)
MISSION = _define("mission_execute", "Executing Mission", INFO, says_all=True)
MISSION_LANDED = _define("mission_finished", "Mission finished, landed", INFO, says_all=True)
MISSION_LOITERS = _define("mission_finished_loiter", "Mission finished, loitering", INFO, says_all=True)
MISSION_REFUSED = _define(
    "mission_not_valid_refuse", "No valid mission available, refusing takeoff", ERROR, internal=DISABLED
)
MISSION_INVALID = _define(
    "mission_not_valid_loiter", "No valid mission available, loitering", ERROR, internal=DISABLED
)
RETURNED = _define("rtl_completed_loiter", "RTL: completed, loitering", INFO, says_all=True)
RETURN_LANDS = _define("rtl_land_at_destination", "RTL: land at destination", INFO, says_all=True)
OUTSIDE_FENCE = _define(
    "navigator_reposition_outside_geofence", "Reposition is outside geofence", ERROR, internal=INFO
)
LOW_BATTERY = (
    _define("commander_failsafe_enter_low_bat", "Low battery", WARNING, internal=INFO),
    _define("commander_failsafe_enter_crit_bat_warn", "Critical battery", CRITICAL, internal=INFO),
    _define("commander_failsafe_enter_crit_low_bat_warn", "Emergency battery", EMERGENCY, internal=INFO),
)
"""Low, critical and emergency level of the battery."""
_FAILSAFE = _define(
    "commander_failsafe_enter", "{3}: {2}", CRITICAL, (_MODE, _ACTION, _CAUSE), internal=WARNING
)
_FAILSAFE_HOLD = _define(
    "commander_failsafe_enter_hold",
    "{4}: {2} in {3} s",
    CRITICAL,
    (_MODE, _ACTION, "uint16_t", _CAUSE),
    internal=WARNING,
)
_GENERIC = _define(
    "commander_failsafe_enter_generic",
    "Failsafe activated: {2}",
    CRITICAL,
    (_MODE, _ACTION),
    internal=WARNING,
)
_GENERIC_HOLD = _define(
    "commander_failsafe_enter_generic_hold",
    "Failsafe activated: {2} in {3} s",
    CRITICAL,
    (_MODE, _ACTION, "uint16_t"),
    internal=WARNING,
)
_DISENGAGED = _define(
    "commander_failsafe_enter_autopilot_disengaged",
    "Failsafe activated: no position control, {2}",
    CRITICAL,
    (_MODE, _ACTION),
    internal=WARNING,
)

_REASONS = {
    "by stick gesture": 1,
    "by external command": 4,
    "by mission start": 5,
    "by landing": 6,
    "by auto preflight disarming": 7,
    "by failsafe": 14,
}
_OTHER_REASON = 3
_ACTIONS = {
    Mode.POSCTL: 2,
    Mode.ALTCTL: 3,
    Mode.STABILIZED: 4,
    Mode.HOLD: 5,
    Mode.RTL: 6,
    Mode.LAND: 7,
    Mode.DESCEND: 8,
    Mode.TERMINATE: 10,
}
_DISARM = 9
_WITHOUT_POSITION = (Mode.DESCEND, Mode.ALTCTL, Mode.STABILIZED)
_CAUSES: Mapping[str, int] = {"manual control lost": 1, "data link lost": 2}
_CRITICAL_BATTERY = 4
_NAVIGATION_MODES = {
    Mode.MANUAL: 0,
    Mode.ALTCTL: 1,
    Mode.POSCTL: 2,
    Mode.MISSION: 3,
    Mode.HOLD: 4,
    Mode.RTL: 5,
    Mode.ACRO: 6,
    Mode.OFFBOARD: 7,
    Mode.STABILIZED: 8,
    Mode.TAKEOFF: 10,
    Mode.LAND: 11,
}
_UNKNOWN_MODE = 255


def armed(why: str) -> Event:
    """Return the event of an arming. why: its reason in words, such as `by external command`."""
    return ARMED(_REASONS.get(why, _OTHER_REASON))


def disarmed(why: str) -> Event:
    """Return the event of a disarming. why: its reason in words, such as `by landing`."""
    return DISARMED(_REASONS.get(why, _OTHER_REASON))


def mode_denied(mode: Mode | None) -> Event:
    """Return the event of a refused change of mode. mode: None if the requested mode does not exist."""
    number = _UNKNOWN_MODE if mode is None else _NAVIGATION_MODES.get(mode, _UNKNOWN_MODE)
    return MODE_DENIED(mode.custom_mode if mode else 0, number)


def failsafe(intended: Mode, action: Mode | None, why: str, hold_s: float | None = None) -> Event:
    """Return the event of a failsafe.

    intended: the mode that was requested last
    action: the mode that the failsafe enters, None if it disarms
    why: its reason in words
    hold_s: time for which the vehicle holds before the action [s]; None if the action is taken at once
    """
    number = _DISARM if action is None else _ACTIONS.get(action, 0)
    cause = _CRITICAL_BATTERY if why == "battery" else _CAUSES.get(why, 0)
    mode = intended.custom_mode
    if hold_s is not None:
        delay = round(min(max(hold_s, 0.0), 65535.0))
        return _FAILSAFE_HOLD(mode, number, delay, cause) if cause else _GENERIC_HOLD(mode, number, delay)
    if cause:
        return _FAILSAFE(mode, number, cause)
    return _DISENGAGED(mode, number) if action in _WITHOUT_POSITION else _GENERIC(mode, number)
