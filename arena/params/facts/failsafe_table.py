"""Table of PX4's failsafes by version: the parameter values of each action, and the delays.

Pure, apart from reading two files. failsafe_actions.csv has one row per event and span of versions. The
column `actions` lists `PARAMETER: action=value ...`, with `;` between parts. An action that needs no
parameter is listed without a value. These versions cannot take an action that is missing in their row; the
column `note` gives the reason. In failsafe_delays.csv, seconds = value * scale_s + fixed_s.

Sources: PX4's commander of v1.9.2, v1.10.2, v1.11.3, v1.12.3, v1.13.3, v1.14.4, v1.15.4, v1.16.0, v1.17.0, and main of 2026-07-08
for 1.18. `source` names the files below src/modules/commander: up to 1.13 state_machine_helper.cpp and Commander.cpp, from 1.14 on
failsafe/failsafe.cpp and failsafe/framework.cpp.

PX4 replaces an action that is not possible when the failsafe starts:
- Up to 1.13, after a loss of setpoints, hold, return and land need a *global* position. Without one the vehicle descends with its
  barometer (NAVIGATION_STATE_DESCEND). Indoors, set an origin (SET_GPS_GLOBAL_ORIGIN) if the version accepts one.
- From 1.14 on, land needs a local position, hold a global position, and return also a home position. PX4 replaces an impossible
  action with the next one in this order: position, altitude, stabilized, hold, return, land, descend, terminate
  (ModeUtil/mode_requirements.cpp, framework.cpp).

Delays:
- COM_FAIL_ACT_T: framework.cpp (checkFailsafe) applies this delay to actions during which a pilot can take over. It does not apply
  when the current mode cannot continue, as after a loss of setpoints or of the position. Measured on 1.16 with COM_FAIL_ACT_T 5:
  position mode 1.03 s after the last setpoint.
- COM_DL_LOSS_T: starts after HEARTBEAT_TIMEOUT_US of msg/telemetry_status.msg. Measured on 1.16 with 10 s: 12.3 s.
- EKF2_NOAID_TOUT: from 1.14 on, if no poses arrive, the delay is 0.4 s shorter, but at least 0.6 s (EKF/ev_control.cpp). If poses
  arrive and are rejected, the whole delay applies. Measured on 1.16 without poses: 0.6 s for 1 s, 2.6 s for 3 s.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, cast, get_args

from arena.errors import InputError
from arena.params.facts.parameter_table import Version, versions

Action = Literal[
    "none",
    "warn",
    "position",
    "altitude",
    "stabilized",
    "hold",
    "return",
    "land",
    "descend",
    "disarm",
    "terminate",
]
"""Actions of a vehicle, mildest first.

none: it continues.  position, altitude, stabilized: modes flown by RC.  descend: straight down without a position.
disarm: the motors stop (up to 1.13 "lockdown": outputs hold the disarmed value).  terminate: outputs take their failsafe value.
"""

Event = Literal[
    "offboard_loss",
    "offboard_loss_without_rc",
    "rc_loss",
    "rc_loss_in_offboard",
    "data_link_loss",
    "data_link_loss_in_offboard",
    "position_loss_in_offboard",
    "position_loss_in_position_mode",
    "low_battery",
    "geofence",
    "attitude_failure",
    "motor_failure",
]
ACTIONS: tuple[Action, ...] = get_args(Action)
EVENTS: Mapping[Event, str] = {
    "offboard_loss": "setpoints stop",
    "offboard_loss_without_rc": "setpoints stop without RC",
    "rc_loss": "RC is lost",
    "rc_loss_in_offboard": "RC is lost in OFFBOARD",
    "data_link_loss": "the ground station is lost",
    "data_link_loss_in_offboard": "the ground station is lost in OFFBOARD",
    "position_loss_in_offboard": "poses stop in OFFBOARD",
    "position_loss_in_position_mode": "poses stop in position mode",
    "low_battery": "the battery is low (BAT_CRIT_THR)",
    "geofence": "the geofence is breached",
    "attitude_failure": "roll or pitch exceeds FD_FAIL_R or FD_FAIL_P",
    "motor_failure": "a motor fails",
}
"""Event -> the end of a sentence that begins "... when"."""


class FailsafeActions(NamedTuple):
    """Table row: the actions that PX4 versions `since` to `until` can take after one event, such as RC loss.

    since, until: first and last minor version.
    settings: action -> {parameter: value} that selects the action; {} if the action needs no parameter.
    note: reason why other actions are missing, or a limitation.
    source: files in PX4's folder src/modules/commander.
    """

    event: Event
    since: int
    until: int
    settings: Mapping[Action, Mapping[str, int]]
    note: str
    source: str


class FailsafeDelay(NamedTuple):
    """A delay of PX4 between an event and its failsafe: parameter value * scale_s + fixed_s [s].

    since, until: first and last minor version.
    """

    event: Event
    parameter: str
    since: int
    until: int
    scale_s: float
    fixed_s: float
    note: str


RC_INPUT_MODES: Mapping[str, tuple[tuple[int, int, int], ...]] = {
    "radio": ((9, 99, 0),),
    "joystick": ((9, 99, 1),),
    "both": ((13, 99, 2),),
    "first": ((13, 99, 3),),
    "none": ((9, 12, 1), (13, 99, 4)),
}
"""Source of manual control -> (since, until, value of COM_RC_IN_MODE), minor versions, both included.

"none" up to 1.12 is 1: RC is not *required*. The value 2 up to 1.12, a joystick as RC channels, has no name here.
"""


_RC_PRIORITY_MODES: tuple[tuple[int, int], ...] = ((9, 0), (16, 3), (17, 5), (17, 7))
"""(since, value of COM_RC_IN_MODE): modes in which a joystick cannot replace an RC transmitter whose kill switch works.

3 (keep the first source) is one of them, because PX4 reacts to the kill switch only if RC was the first source.
"""


def failsafe_actions(event: Event, version: Version | str) -> FailsafeActions:
    """Return the actions that a PX4 version can take after an event, with their parameter values.

    This is a row of failsafe_actions.csv.
    """
    minor = Version.of(version).minor
    return next(row for row in all_actions() if row.event == event and row.since <= minor <= row.until)


def supported_actions(event: Event, version: Version | str) -> tuple[Action, ...]:
    """Return the actions that a PX4 version can take after an event, mildest action first."""
    settings = failsafe_actions(event, version).settings
    return tuple(action for action in ACTIONS if action in settings)


def settings_for(event: Event, action: Action, version: Version | str) -> Mapping[str, int]:
    """Return the parameter values {name: value} that make PX4 take `action` after `event`.

    Raises InputError with the reason if the version cannot take the action.
    """
    row = failsafe_actions(event, version)
    if action not in row.settings:
        supported = ", ".join(supported_actions(event, version))
        raise InputError(
            f"PX4 1.{Version.of(version).minor} has no action `{action}` when {EVENTS[event]} (possible: {supported}): {row.note}"
        )
    return row.settings[action]


def selected_action(event: Event, values: Mapping[str, float], version: Version | str) -> Action | None:
    """Return the action that PX4 takes after an event, for given parameter values.

    Returns None if the table does not list these values.
    """
    settings = failsafe_actions(event, version).settings
    for action in ACTIONS:
        if action in settings and all(values.get(name) == value for name, value in settings[action].items()):
            return action
    return None


def delays(event: Event, version: Version | str) -> tuple[FailsafeDelay, ...]:
    """Return the delays of PX4 between an event and its failsafe action, in order of time."""
    minor = Version.of(version).minor
    return tuple(d for d in _all_delays() if d.event == event and d.since <= minor <= d.until)


def rc_input_mode(source: str, version: Version | str) -> int:
    """Return the value of COM_RC_IN_MODE that selects a source of manual control.

    source: radio, joystick, both, first or none.

    Raises InputError if COM_RC_IN_MODE of this version has no value for the source.
    """
    minor = Version.of(version).minor
    known = {
        name: value
        for name, spans in RC_INPUT_MODES.items()
        for since, until, value in spans
        if since <= minor <= until
    }
    if source not in known:
        raise InputError(
            f"COM_RC_IN_MODE of PX4 1.{minor} has no value for manual control by {source!r}; expected one of {', '.join(known)}"
        )
    return known[source]


def rc_priority_modes(version: Version | str) -> tuple[int, ...]:
    """Return the values of COM_RC_IN_MODE for which PX4 prefers an RC transmitter to a joystick."""
    minor = Version.of(version).minor
    return tuple(value for since, value in _RC_PRIORITY_MODES if minor >= since)


@cache
def all_actions() -> tuple[FailsafeActions, ...]:
    """Return every row of failsafe_actions.csv."""
    return tuple(
        FailsafeActions(
            event=cast(Event, row["event"]),
            since=_minor(row["since"]),
            until=_minor(row["until"]),
            settings=_settings(row["actions"]),
            note=row["note"],
            source=row["source"],
        )
        for row in _rows("failsafe_actions.csv")
    )


@cache
def _all_delays() -> tuple[FailsafeDelay, ...]:
    return tuple(
        FailsafeDelay(
            event=cast(Event, row["event"]),
            parameter=row["parameter"],
            since=_minor(row["since"]),
            until=_minor(row["until"]),
            scale_s=float(row["scale_s"]),
            fixed_s=float(row["fixed_s"]),
            note=row["note"],
        )
        for row in _rows("failsafe_delays.csv")
    )


def _rows(name: str) -> csv.DictReader[str]:
    return csv.DictReader(Path(__file__).with_name(name).read_text(encoding="utf-8").splitlines())


def _minor(text: str) -> int:
    return versions()[-1].minor if text == "newest" else Version.parse(text).minor


def _settings(text: str) -> Mapping[Action, Mapping[str, int]]:
    """Parse a cell of the column `actions` in failsafe_actions.csv: `PARAMETER: action=value ...; ...`.

    If PX4 has no parameter that selects the action, the column contains the action alone.
    """
    found: dict[Action, dict[str, int]] = {}
    for part in text.split("; "):
        parameter, _, pairs = part.rpartition(": ")
        for pair in pairs.split():
            action, _, value = pair.partition("=")
            found.setdefault(cast(Action, action), {}).update({parameter: int(value)} if parameter else {})
    return found
