"""Rules for PX4's reactions to a loss of setpoints, RC or ground station. Pure.

They also find failsafe actions that are wrong indoors. `facts.failsafe_table` has the action of each
parameter value. These rules assume a room of about 5 m by 5 m by 3 m.
"""

from __future__ import annotations

from collections.abc import Iterator

from arena.params.checks.findings import CheckContext, Finding
from arena.params.facts.failsafe_table import (
    EVENTS,
    Action,
    Event,
    delays,
    failsafe_actions,
    rc_input_mode,
    selected_action,
    settings_for,
)

_MAX_LOSS_S = 1.5  # from the last setpoint to the failsafe
_MIN_LOSS_S = 0.25  # busy computers and radios can pause for this time
_LOW_ROOM_M = 3.0
_MAX_HOLD_S = 2.0
_NEEDS_RC: tuple[Action, ...] = ("position", "altitude", "stabilized")
_STOPS_MOTORS: tuple[Action, ...] = ("disarm", "terminate")


def settings_text(ctx: CheckContext, event: Event, action: Action) -> str:
    """Return the parameters that make PX4 take an action after an event, as a text such as "NAV_RCL_ACT 4".

    Returns "" if the PX4 version cannot take the action.
    """
    if action not in failsafe_actions(event, ctx.version).settings:
        return ""
    return ", ".join(f"{name} {value}" for name, value in settings_for(event, action, ctx.version).items())


def expected_text(settings: str, name: str, action: Action) -> str:
    """Return the expected value of a parameter as text, such as "4 (land)".

    If `settings` is empty, because no value gives the wanted action, return "".

    settings: result of `settings_text`, such as "NAV_RCL_ACT 4".
    """
    return f"{settings.removeprefix(name + ' ')} ({action})" if settings else ""


def current_action(ctx: CheckContext, event: Event) -> Action | None:
    """Return the action that PX4 takes after an event with the present parameters of the vehicle.

    Returns None if the failsafe table does not list these parameter values.
    """
    return selected_action(event, ctx.values, ctx.version)


def _parameter(ctx: CheckContext, event: Event) -> str:
    """Return the name of the parameter that selects PX4's action after an event.

    Returns "" if this PX4 version has a fixed action.
    """
    return next(
        (name for settings in failsafe_actions(event, ctx.version).settings.values() for name in settings), ""
    )


# --- setpoints


def offboard_loss_action(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4's action after a loss of setpoints is unsafe indoors."""
    name, action = "COM_OBL_RC_ACT", current_action(ctx, "offboard_loss")
    land = settings_text(ctx, "offboard_loss", "land")
    expected, fix = expected_text(land, name, "land"), f"set {land} (land)"
    # up to 1.13 COM_OBL_ACT selects the action without RC
    without_rc = ctx.minor >= 14 and not ctx.environment.rc
    if action is None:
        problem = f"PX4 {ctx.version} has no such action for lost setpoints"
        why = failsafe_actions("offboard_loss", ctx.version).note
        yield ctx.finding("error", name, problem, expected=expected, why=why, fix=fix)
    elif action == "none":
        problem = "lost setpoints cause no reaction"
        why = "the vehicle keeps its last setpoint and flies into the wall"
        yield ctx.finding("error", name, problem, expected=expected, why=why, fix=fix)
    elif action in _NEEDS_RC:
        why = (
            "this mode needs a pilot with RC; without RC the vehicle descends without a position"
            if without_rc
            else "the pilot must take over at once; after a program failure a landing is safer"
        )
        problem = f"lost setpoints lead to {action} mode"
        yield ctx.finding(
            "error" if without_rc else "warning", name, problem, expected=expected, why=why, fix=fix
        )


def offboard_loss_action_without_rc(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4 does not react to a loss of setpoints in a flight without RC.

    PX4 1.13 and older have a separate parameter for this case.
    """
    if ctx.minor >= 14:
        return
    action = current_action(ctx, "offboard_loss_without_rc")
    if action in (None, "none"):
        land = settings_text(ctx, "offboard_loss_without_rc", "land")
        yield ctx.finding(
            "error",
            "COM_OBL_ACT",
            "without RC, lost setpoints cause no reaction" if action else "no action for lost setpoints",
            expected=expected_text(land, "COM_OBL_ACT", "land"),
            why="the vehicle keeps its last setpoint, or holds its position",
            fix=f"set {land} (land)",
        )


def offboard_loss_time(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if the time-out for the loss of setpoints is too short or too long."""
    name, value = "COM_OF_LOSS_T", ctx.value("COM_OF_LOSS_T")
    if value is None:
        return
    fixed = sum(d.fixed_s for d in delays("offboard_loss", ctx.version))
    total = value + fixed
    expected = f"{max(_MIN_LOSS_S - fixed, 0):g} to {_MAX_LOSS_S - fixed:g} s"
    if value <= 0 and not fixed:
        problem = "every setpoint counts as lost as soon as it arrives"
        why = "the vehicle cannot enter or stay in OFFBOARD"
        yield ctx.finding("error", name, problem, expected=expected, why=why, fix=f"set {name} 0.5")
    elif value <= 0:
        problem = f"the failsafe acts {fixed:g} s after the last setpoint, the shortest time possible"
        why = "a short pause of the program or of the radio ends the flight"
        fix = f"set {name} 0.5, which makes {fixed + 0.5:g} s"
        yield ctx.finding("warning", name, problem, expected=expected, why=why, fix=fix)
    elif total < _MIN_LOSS_S:
        problem = f"setpoints may pause for {total:g} s only"
        why = "a busy computer or a radio can pause for longer"
        yield ctx.finding("warning", name, problem, expected=expected, why=why, fix=f"set {name} 0.5")
    elif total > _MAX_LOSS_S:
        problem = f"the failsafe acts {total:g} s after the last setpoint"
        why = "until then the vehicle follows its last setpoint, and can cross the room"
        fix = f"set {name} {max(1.0 - fixed, 0.5):g}"
        yield ctx.finding("warning", name, problem, expected=expected, why=why, fix=fix)


# --- RC and ground station


def rc_input(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4 requires RC in an arena without RC, or ignores the RC of an arena with RC."""
    name, value = "COM_RC_IN_MODE", ctx.value("COM_RC_IN_MODE")
    none = rc_input_mode("none", ctx.version)
    if value is None:
        return
    if ctx.environment.rc and ctx.minor >= 13 and value == none:
        yield ctx.finding(
            "error",
            name,
            "RC is ignored",
            expected="0 (RC transmitter)",
            why="the pilot cannot take over",
            fix=f"set {name} 0 (RC transmitter)",
        )
    elif not ctx.environment.rc and value != none and ctx.minor < 13:
        yield ctx.finding(
            "error" if value == 0 else "warning",
            name,
            "an RC transmitter is expected, but the arena has none",
            expected=f"{none} (RC not required)",
            why="the vehicle does not arm without RC",
            fix=f"set {name} {none} (RC not required)",
        )
    elif ctx.environment.joystick and value == rc_input_mode("joystick", ctx.version):
        return
    elif not ctx.environment.rc and value != none:
        yield ctx.finding(
            "warning",
            name,
            "RC or a joystick is expected, but the arena has none",
            expected=f"{none} (no manual control)",
            why="RC or a joystick that connects and disconnects triggers a failsafe in flight",
            fix=f"set {name} {none} (no manual control)",
        )


def rc_loss(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4 does not react to a loss of RC. Yields nothing in an arena without RC."""
    if not ctx.environment.rc:
        return
    action = current_action(ctx, "rc_loss")
    land = settings_text(ctx, "rc_loss", "land")
    if action is None or action == "none":
        yield ctx.finding(
            "error",
            "NAV_RCL_ACT",
            "the loss of RC causes no reaction" if action else "no action for the loss of RC",
            expected=expected_text(land, "NAV_RCL_ACT", "land"),
            why="the vehicle flies on, and the pilot has no means to end the flight",
            fix=f"set {land} (land)",
        )
    if ctx.minor >= 13 and ctx.bits("COM_RCL_EXCEPT") & 4:
        wanted = ctx.bits("COM_RCL_EXCEPT") & ~4
        yield ctx.finding(
            "warning",
            "COM_RCL_EXCEPT",
            "the loss of RC is ignored in OFFBOARD (bit 4)",
            expected=f"{wanted}",
            why="RC is the pilot's last means to end a flight",
            fix=f"set COM_RCL_EXCEPT {wanted}",
        )


def data_link_loss(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if the loss of the ground station triggers a failsafe in OFFBOARD."""
    name, value = "NAV_DLL_ACT", ctx.value("NAV_DLL_ACT")
    in_offboard = current_action(ctx, "data_link_loss_in_offboard")
    if ctx.minor >= 14 and value and in_offboard not in ("none", None):
        none = settings_text(ctx, "data_link_loss_in_offboard", "none")
        yield ctx.finding(
            "note",
            name,
            "the loss of the ground station causes a failsafe in OFFBOARD, too",
            expected=f"{none}, or a ground station that stays connected",
            why="without a ground station the vehicle does not arm; closing it in flight ends the flight",
            fix=f"keep a ground station connected, or set {none}",
        )


# --- actions that are wrong indoors after any event


_JUDGED_ELSEWHERE: tuple[Event, ...] = (
    "rc_loss_in_offboard",
    "data_link_loss_in_offboard",
    "position_loss_in_offboard",
    "position_loss_in_position_mode",
    "attitude_failure",  # terminate is the right action for an overturned vehicle
)


def _events_leading_to(ctx: CheckContext, *actions: Action) -> Iterator[tuple[str, Event, Action]]:
    """Yield (parameter, event, action) for every event after which PX4 takes one of `actions`.

    A parameter that selects the action for several events is yielded once.
    """
    seen = set()
    for event in EVENTS:
        if event in _JUDGED_ELSEWHERE or (event == "rc_loss" and not ctx.environment.rc):
            continue
        name, action = _parameter(ctx, event), current_action(ctx, event)
        if action is not None and action in actions and name not in seen:
            seen.add(name)
            yield name, event, action


def motors_stop_in_flight(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each failsafe whose action stops the motors in the air."""
    for name, event, action in _events_leading_to(ctx, *_STOPS_MOTORS):
        land = settings_text(ctx, event, "land")
        yield ctx.finding(
            "warning",
            name,
            f"leads to {action} when {EVENTS[event]}",
            expected=expected_text(land, name, "land") or "another action",
            why="the motors stop in the air and the vehicle falls",
            fix=f"set {land} (land)" if land else "choose another action",
        )


def return_climbs_into_ceiling(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each failsafe whose return to home first climbs to the ceiling or higher."""
    altitude = ctx.value("RTL_RETURN_ALT")
    ceiling = ctx.environment.height_m or _LOW_ROOM_M
    if altitude is None or altitude < ceiling:
        return
    for name, event, _ in _events_leading_to(ctx, "return"):
        land = settings_text(ctx, event, "land")
        room = "the room is" if ctx.environment.height_m else "a low room is"
        yield ctx.finding(
            "warning",
            name,
            f"leads to a return when {EVENTS[event]}, and a return first climbs to RTL_RETURN_ALT {altitude:g} m",
            expected=expected_text(land, name, "land") or f"RTL_RETURN_ALT below {ceiling:g}",
            why=f"the vehicle hits the ceiling: {room} {ceiling:g} m high",
            fix=f"set {land} (land), or RTL_RETURN_ALT below {ceiling:g}"
            if land
            else f"choose RTL_RETURN_ALT below {ceiling:g}",
            related=("RTL_RETURN_ALT",),
        )


def hold_before_failsafe(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if PX4 waits too long (COM_FAIL_ACT_T) before a failsafe acts.

    Meanwhile the vehicle only holds its position.
    """
    name, value = "COM_FAIL_ACT_T", ctx.value("COM_FAIL_ACT_T")
    if value is not None and value > _MAX_HOLD_S:
        yield ctx.finding(
            "warning",
            name,
            f"the vehicle holds for {value:g} s before most failsafes act",
            expected=f"0 to {_MAX_HOLD_S:g} s",
            why="this time is for a pilot to take over, but an empty battery may not last as long",
            fix=f"set {name} 0",
        )
