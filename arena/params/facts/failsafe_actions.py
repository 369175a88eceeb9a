"""What makes a failsafe do what, by version, in words that no version changes: `ways("offboard_loss", "land", "1.13")`.

Read in PX4's commander of v1.9.2, v1.10.2, v1.11.3, v1.12.3, v1.13.3, v1.14.4, v1.15.4, v1.16.0, v1.17.0 and main of 2026-07-08
for 1.18; each row names where. Up to 1.13 that is modules/commander/state_machine_helper.cpp ("helper" below) and Commander.cpp,
from 1.14 on modules/commander/failsafe/failsafe.cpp ("failsafe") and framework.cpp. An action that is missing from a row is one
that the version cannot do: `ways` raises InputError with the row's reason, and nothing is put in its place in silence.

What an action becomes when the vehicle cannot do it then and there is PX4's affair, and differs:
- up to 1.13 hold, return and land after the loss of offboard want a *global* position, and without one it descends blind on its
  barometer (NAVIGATION_STATE_DESCEND); a room needs an origin (SET_GPS_GLOBAL_ORIGIN), where the version takes one;
- from 1.14 on land wants a local position only, hold a global one, return a home too, and what cannot run becomes the next of
  position, altitude, stabilized, hold, return, land, descend, terminate (ModeUtil/mode_requirements.cpp, framework.cpp).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

from arena.errors import InputError
from arena.params.facts.parameter_table import Version

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
"""none: it goes on as it was.  disarm: motors stop (up to 1.13 "lockdown": held at the disarmed value).  terminate: outputs take
their failsafe value.  position, altitude, stabilized: modes that want sticks.  descend: straight down without a position."""

Event = Literal[
    "offboard_loss",  # the stream of setpoints ended; sticks are there
    "offboard_loss_without_sticks",  # the same; no sticks, as in most rooms
    "sticks_loss",  # in the modes flown by sticks, and where `sticks_loss_in_offboard` does not say else
    "sticks_loss_in_offboard",  # the stream goes on
    "data_link_loss",  # no ground station is heard; in missions and hold
    "data_link_loss_in_offboard",
    "position_loss_in_offboard",  # external vision ended; setpoints of position or velocity
    "position_loss_in_position_mode",
    "low_battery",  # below BAT_CRIT_THR; below BAT_LOW_THR it warns only
    "geofence",  # GF_MAX_HOR_DIST, GF_MAX_VER_DIST or a drawn fence; wants a home
    "attitude_failure",  # beyond FD_FAIL_R or FD_FAIL_P
    "motor_failure",
]
Ways = Mapping[Action, Mapping[str, int]]


class Row(NamedTuple):
    """since, until: minor versions, both included.  ways: action -> what is to be set, {} when nothing need be.

    why: what the missing actions fail for, or what else is to be known.  source: PX4's files, below src/modules/commander.
    """

    event: Event
    since: int
    until: int
    ways: Ways
    why: str
    source: str


def _of(parameter: str, **values: int) -> Ways:
    return {_word(name): {parameter: value} for name, value in values.items()}


def _with(ways: Ways, **also: int) -> Ways:
    return {action: {**settings, **also} for action, settings in ways.items()}


def _word(name: str) -> Action:
    word = name.rstrip("_")
    return next(action for action in ACTIONS if action == word)


NEWEST = 18
ACTIONS: tuple[Action, ...] = get_args(Action)
EVENTS: tuple[Event, ...] = get_args(Event)

_RC_9 = _of("COM_OBL_RC_ACT", position=0, altitude=1, stabilized=2, return_=3, land=4, hold=5)
_RC_10 = {**_RC_9, **_of("COM_OBL_RC_ACT", none=-1, terminate=6, disarm=7)}
_RC_14 = {**_RC_9, **_of("COM_OBL_RC_ACT", terminate=6, disarm=7)}
_RC_14_ALONE = {
    action: way for action, way in _RC_14.items() if action not in ("position", "altitude", "stabilized")
}
_NO_RC_9 = _of("COM_OBL_ACT", land=0, hold=1, return_=2)
_NO_RC_10 = {**_NO_RC_9, **_of("COM_OBL_ACT", none=-1, terminate=3, disarm=4)}
_LINK = {"hold": 1, "return_": 2, "land": 3, "terminate": 5, "disarm": 6}
_DLL = _of("NAV_DLL_ACT", none=0, **_LINK)
_RCL = _of("NAV_RCL_ACT", **_LINK)
_BLIND_12: Ways = {
    "descend": {"COM_OBL_RC_ACT": 4, "COM_OBL_ACT": 0},
    "terminate": {"COM_OBL_RC_ACT": 6, "COM_OBL_ACT": 3},
    "disarm": {"COM_OBL_RC_ACT": 7, "COM_OBL_ACT": 4},
}
_BLIND_14: Ways = {
    "descend": {"COM_OBL_RC_ACT": 4},
    **_of("COM_OBL_RC_ACT", altitude=1, stabilized=2, terminate=6, disarm=7),
}

ROWS: tuple[Row, ...] = (
    Row(
        "offboard_loss",
        9,
        9,
        _RC_9,
        "none, disarm and terminate came with 1.10; position wants a global position here",
        "state_machine_helper.cpp (set_nav_state, MAIN_STATE_OFFBOARD)",
    ),
    Row(
        "offboard_loss",
        10,
        13,
        _RC_10,
        "with COM_RCL_EXCEPT 4 v1.13 obeys COM_OBL_ACT instead: set both",
        "state_machine_helper.h (offboard_loss_rc_actions_t), .cpp (set_offboard_loss_rc_nav_state)",
    ),
    Row(
        "offboard_loss",
        14,
        NEWEST,
        _RC_14,
        "-1 went with 1.14, and any unknown value means position; from 1.17 on sticks that"
        " are missing turn position, altitude and stabilized into NAV_RCL_ACT's action",
        "failsafe/failsafe.cpp (fromOffboardLossActParam, checkModeFallback)",
    ),
    Row(
        "offboard_loss_without_sticks",
        9,
        9,
        _NO_RC_9,
        "COM_OBL_ACT knows land, hold and return; any other value holds, or descends",
        "state_machine_helper.cpp (set_nav_state, MAIN_STATE_OFFBOARD)",
    ),
    Row(
        "offboard_loss_without_sticks",
        10,
        13,
        _NO_RC_10,
        "COM_OBL_ACT knows no modes flown by sticks; with COM_RCL_EXCEPT 4 v1.12 obeys COM_OBL_RC_ACT instead: set both",
        "state_machine_helper.h (offboard_loss_actions_t), .cpp (set_offboard_loss_nav_state)",
    ),
    Row(
        "offboard_loss_without_sticks",
        14,
        NEWEST,
        _RC_14_ALONE,
        "one parameter for both cases; a mode flown by sticks has nobody to"
        " fly it: v1.16 measured in position mode without sticks descends",
        "failsafe/failsafe.cpp (fromOffboardLossActParam)",
    ),
    Row(
        "sticks_loss",
        9,
        11,
        _of("NAV_RCL_ACT", none=0, **_LINK),
        "4, the rules of an Australian contest, is read up to 1.10",
        "commander_params.c, state_machine_helper.cpp (set_link_loss_nav_state)",
    ),
    Row(
        "sticks_loss",
        12,
        NEWEST,
        _RCL,
        "0 is outside NAV_RCL_ACT's range; COM_RCL_EXCEPT excepts missions (1), hold (2) and offboard (4);"
        " 1.18 adds 7, a hold that is no failsafe",
        "commander_params.c; failsafe/failsafe.cpp (fromNavDllOrRclActParam)",
    ),
    Row(
        "sticks_loss_in_offboard",
        9,
        11,
        {"none": {}},
        "while setpoints come, offboard looks at no sticks up to 1.12",
        "state_machine_helper.cpp (set_nav_state, MAIN_STATE_OFFBOARD)",
    ),
    Row(
        "sticks_loss_in_offboard",
        12,
        12,
        {"none": {}},
        "while setpoints come, offboard looks at no sticks up to 1.12; COM_RCL_EXCEPT 4"
        " would only change which parameter the loss of setpoints obeys",
        "state_machine_helper.cpp (set_nav_state, MAIN_STATE_OFFBOARD)",
    ),
    Row(
        "sticks_loss_in_offboard",
        13,
        NEWEST,
        {"none": {"COM_RCL_EXCEPT": 4}, **_with(_RCL, COM_RCL_EXCEPT=0)},
        "COM_RCL_EXCEPT is a bit mask; from 1.14 on sticks that were missing when it was armed are not missed",
        "state_machine_helper.cpp (1.13); failsafe/failsafe.cpp (rc_loss_ignored_offboard)",
    ),
    Row(
        "data_link_loss",
        9,
        NEWEST,
        _DLL,
        "it takes actions of NAV_DLL_ACT only; any ground station's heartbeat counts",
        "commander_params.c; failsafe/failsafe.cpp (fromNavDllOrRclActParam)",
    ),
    Row(
        "data_link_loss_in_offboard",
        9,
        13,
        {"none": {}},
        "offboard does not look at the data link up to 1.13",
        "state_machine_helper.cpp (set_nav_state, MAIN_STATE_OFFBOARD)",
    ),
    Row(
        "data_link_loss_in_offboard",
        14,
        15,
        _DLL,
        "there is no exception for offboard before 1.16: none is none in every mode",
        "failsafe/failsafe.cpp (gcs_connection_loss_ignored)",
    ),
    Row(
        "data_link_loss_in_offboard",
        16,
        NEWEST,
        {
            "none": {"COM_DLL_EXCEPT": 4},
            **_with({a: w for a, w in _DLL.items() if a != "none"}, COM_DLL_EXCEPT=0),
        },
        "COM_DLL_EXCEPT is a bit mask",
        "failsafe/failsafe.cpp (dll_loss_ignored_offboard)",
    ),
    Row(
        "position_loss_in_offboard",
        9,
        11,
        {"descend": {}},
        "the commander does not leave offboard; without a valid state the position"
        " controller descends with MPC_LAND_SPEED, and no parameter chooses",
        "../mc_pos_control/mc_pos_control_main.cpp (failsafe)",
    ),
    Row(
        "position_loss_in_offboard",
        12,
        13,
        _BLIND_12,
        "it counts as the loss of offboard; hold, return and land want a global position and become descend",
        "Commander.cpp (offboard_control_update), state_machine_helper.cpp (set_offboard_loss_nav_state)",
    ),
    Row(
        "position_loss_in_offboard",
        14,
        NEWEST,
        _BLIND_14,
        "it counts as the loss of offboard; hold, return and land want a position"
        " and become descend; altitude and stabilized want sticks",
        "HealthAndArmingChecks/checks/offboardCheck.cpp, failsafe/framework.cpp (getSelectedAction)",
    ),
    Row(
        "position_loss_in_position_mode",
        9,
        16,
        {"altitude": {"COM_POSCTL_NAVL": 0}, "descend": {"COM_POSCTL_NAVL": 1}},
        "COM_POSCTL_NAVL knows these two; they become stabilized and terminate when the height is lost as well",
        "state_machine_helper.cpp (check_invalid_pos_nav_state); failsafe/failsafe.cpp (checkModeFallback)",
    ),
    Row(
        "position_loss_in_position_mode",
        17,
        NEWEST,
        {"altitude": {}},
        "COM_POSCTL_NAVL went with 1.17: altitude, then stabilized",
        "failsafe/failsafe.cpp (checkModeFallback)",
    ),
    Row(
        "low_battery",
        9,
        NEWEST,
        {"warn": {"COM_LOW_BAT_ACT": 0}, "land": {"COM_LOW_BAT_ACT": 2}, "return": {"COM_LOW_BAT_ACT": 3}},
        "3 returns, and lands below BAT_EMERGEN_THR; 1, which returns to the end, is not offered since 1.11 but still obeyed",
        "state_machine_helper.cpp (battery_failsafe); failsafe/failsafe.cpp (fromBatteryWarningActParam)",
    ),
    Row(
        "geofence",
        9,
        10,
        _of("GF_ACTION", none=0, warn=1, hold=2, return_=3, terminate=4),
        "land came with 1.11",
        "../navigator/geofence_params.c, Commander.cpp",
    ),
    Row(
        "geofence",
        11,
        NEWEST,
        _of("GF_ACTION", none=0, warn=1, hold=2, return_=3, terminate=4, land=5),
        "GF_ACTION knows none, warn, hold, return, terminate and land",
        "../navigator/geofence_params.c, Commander.cpp; failsafe/failsafe.cpp (fromGfActParam)",
    ),
    Row(
        "attitude_failure",
        9,
        9,
        {"none": {"CBRK_FLIGHTTERM": 121212}, "warn": {"CBRK_FLIGHTTERM": 0}},
        "v1.9 says that it enforces a failsafe, and does not",
        "Commander.cpp (_failure_detector)",
    ),
    Row(
        "attitude_failure",
        10,
        13,
        {"none": {"CBRK_FLIGHTTERM": 121212}, "terminate": {"CBRK_FLIGHTTERM": 0}},
        "the breaker is all there is; from 1.11 on the motors stop in the first COM_LKDOWN_TKO seconds in any case",
        "Commander.cpp (_failure_detector)",
    ),
    Row(
        "attitude_failure",
        14,
        NEWEST,
        {"warn": {"CBRK_FLIGHTTERM": 121212}, "terminate": {"CBRK_FLIGHTTERM": 0}},
        "the breaker is all there is; it is disarmed in the first COM_LKDOWN_TKO seconds (3 s since 1.18) in any case",
        "failsafe/failsafe.cpp (fd_critical_failure)",
    ),
    Row("motor_failure", 9, 13, {"none": {}}, "COM_ACT_FAIL_ACT came with 1.14", "commander_params.c"),
    Row(
        "motor_failure",
        14,
        NEWEST,
        _of("COM_ACT_FAIL_ACT", warn=0, hold=1, land=2, return_=3, terminate=4),
        "COM_ACT_FAIL_ACT knows warn, hold, land, return and terminate; FD_ACT_EN must be on",
        "failsafe/failsafe.cpp (fromActuatorFailureActParam)",
    ),
)

STICKS: Mapping[str, tuple[tuple[int, int, int], ...]] = {
    "radio": ((9, NEWEST, 0),),
    "joystick": ((9, NEWEST, 1),),
    "both": ((13, NEWEST, 2),),
    "first": ((13, NEWEST, 3),),
    "none": ((9, 12, 1), (13, NEWEST, 4)),
}
"""COM_RC_IN_MODE by where sticks come from, as (since, until, value). "none" up to 1.12 is 1: no sticks are *required*.
Up to 1.12 2 is a joystick made into radio channels, which nobody here has a word for."""


def row(event: Event, version: Version | str) -> Row:
    """What the version can do about the event."""
    minor = Version.of(version).minor
    return next(r for r in ROWS if r.event == event and r.since <= minor <= r.until)


def actions(event: Event, version: Version | str) -> tuple[Action, ...]:
    """Those that the version can do, the mildest first."""
    able = row(event, version).ways
    return tuple(action for action in ACTIONS if action in able)


def ways(event: Event, action: Action, version: Version | str) -> Mapping[str, int]:
    """{parameter: value} that makes the event lead to the action. Raises InputError where the version cannot, with the reason."""
    found = row(event, version)
    if action not in found.ways:
        able, minor = ", ".join(actions(event, version)), Version.of(version).minor
        raise InputError(
            f"PX4 1.{minor} cannot answer {event} with {action}; it can with {able}: {found.why}"
        )
    return found.ways[action]


def action_of(event: Event, values: Mapping[str, float], version: Version | str) -> Action | None:
    """What the event leads to on a vehicle with these values; None when they say too little, or something no version calls so."""
    able = row(event, version).ways
    fits = [
        a for a in ACTIONS if a in able and all(values.get(name) == value for name, value in able[a].items())
    ]
    return fits[0] if fits else None


def sticks(source: str, version: Version | str) -> int:
    """COM_RC_IN_MODE for sticks from there. Raises InputError where the version does not know it."""
    minor = Version.of(version).minor
    for since, until, value in STICKS.get(source, ()):
        if since <= minor <= until:
            return value
    known = ", ".join(name for name, spans in STICKS.items() if any(a <= minor <= b for a, b, _ in spans))
    raise InputError(f"PX4 1.{minor} takes no sticks from {source!r}; expected one of {known}")
