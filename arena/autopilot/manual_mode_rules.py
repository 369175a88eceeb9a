"""Rules of the manual modes: when the vehicle may enter them or arm, and when moved sticks change the mode. Pure.

The rules are those of PX4 v1.16.
"""

from __future__ import annotations

from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.flight_modes import MANUAL_MODES, THRUST_MODES, Mode

_THROTTLE_CENTRED, _THROTTLE_LOW = 0.2, -0.8
_OVERRIDES_AUTO, _OVERRIDES_OFFBOARD = 1, 2  # bits of COM_RC_OVERRIDE


def missing_for_manual(mode: Mode, s: CommanderInputs) -> str:
    """Return why the vehicle cannot fly a manual mode now; "" if it can.

    POSCTL also needs a valid position, which is not checked here.
    """
    if mode not in MANUAL_MODES:
        return ""
    if not s.manual_control:
        return "no manual control input"
    return "no valid height" if mode is Mode.ALTCTL and not (s.z_valid and s.yaw_valid) else ""


def stick_problem(mode: Mode, s: CommanderInputs) -> str:
    """Return why the throttle stick prevents arming in a manual mode; "" if arming is allowed."""
    sticks = s.manual.sticks
    if mode not in MANUAL_MODES or sticks is None:
        return ""
    if mode in THRUST_MODES:
        return "high throttle" if sticks.throttle >= _THROTTLE_LOW else ""
    return "throttle above center" if sticks.throttle > _THROTTLE_CENTRED else ""


def possible_mode(intended: Mode, s: CommanderInputs, params: CommanderParams) -> Mode:
    """Return the mode in which the vehicle can fly: the selected mode, or a simpler mode if the estimate is not valid.

    POSCTL without a valid position becomes ALTCTL with COM_POSCTL_NAVL 0, and a descent (DESCEND) with COM_POSCTL_NAVL 1.
    ALTCTL without a valid height or heading becomes STABILIZED.
    """
    if intended is Mode.POSCTL and not s.position_ok:
        if params.com_posctl_navl:
            return Mode.DESCEND
        intended = Mode.ALTCTL
    return Mode.STABILIZED if intended is Mode.ALTCTL and not (s.z_valid and s.yaw_valid) else intended


def sticks_take_over(
    mode: Mode, s: CommanderInputs, params: CommanderParams, *, failsafe: str, in_delay: bool
) -> bool:
    """Return whether moved sticks change the mode to POSCTL.

    COM_RC_OVERRIDE selects the modes in which moved sticks take over. During a failsafe, moved sticks take over only after the
    delay COM_FAIL_ACT_T, and only if this delay is above 0.1 s or offboard setpoints were lost.

    failsafe: reason of the active failsafe, "" for none
    in_delay: the vehicle holds for COM_FAIL_ACT_T before its failsafe acts
    """
    if s.manual.speed <= params.stick_speed or mode in MANUAL_MODES or mode is Mode.TERMINATE:
        return False
    bit = _OVERRIDES_OFFBOARD if mode is Mode.OFFBOARD else _OVERRIDES_AUTO
    waits_for_pilot = params.com_fail_act_t > 0.1 or failsafe.startswith("offboard control lost")
    allowed = not failsafe or (waits_for_pilot and not in_delay)
    return bool(params.com_rc_override & bit) and allowed
