"""Arming checks: the reasons for which a vehicle refuses to arm. Pure."""

from __future__ import annotations

from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams, battery_too_low, gcs_lost
from arena.autopilot.failsafe_rules import NOT_ARMABLE
from arena.autopilot.flight_modes import POSITION_MODES, Mode
from arena.autopilot.manual_mode_rules import missing_for_manual


def arming_problems(mode: Mode, s: CommanderInputs, params: CommanderParams) -> list[str]:
    """Return every reason to refuse arming in a mode; an empty list if the vehicle may arm."""
    offboard = mode is Mode.OFFBOARD
    position = mode in POSITION_MODES or (offboard and s.offboard_needs_position)
    manual = missing_for_manual(mode, s)
    checks = [
        (not s.aligned, "Attitude not valid: waiting for external vision"),
        (position and not s.xy_valid, "Horizontal position not valid: no external vision"),
        (s.aligned and s.poses_rejected, "Position not stable: the poses contradict the estimate"),
        (position and not s.z_valid, "Height not valid: no external vision"),
        (s.aligned and not s.yaw_valid, "Heading not valid: vision yaw rejected"),
        (offboard and s.offboard_age > params.com_of_loss_t, "No offboard signal"),
        (mode in NOT_ARMABLE, f"Mode {mode.label} does not allow arming"),
        (battery_too_low(s, params), f"Battery too low: {100 * s.battery:.0f} %"),
        (s.tilt_rad > params.fd_fail_rad, f"Attitude: tilted by {57.3 * s.tilt_rad:.0f} degrees"),
        (params.nav_dll_act > 0 and gcs_lost(s, params), "No connection to the ground control station"),
        (mode is Mode.MISSION and not s.mission_ok, "No valid mission available"),
        (s.fence != "" and params.gf_action > 0, s.fence),
        (manual != "", manual[:1].upper() + manual[1:]),
    ]
    return [reason for failed, reason in checks if failed]
