"""Inputs of the commander: the vehicle's measured state and its parameters. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from arena.autopilot.manual_control import ManualInput
from arena.autopilot.param_table import Params

_GCS_HEARTBEAT_TIMEOUT_S = 2.5  # COM_DL_LOSS_T begins this long after the last heartbeat


@dataclass(slots=True, kw_only=True)
class CommanderInputs:
    """State of one vehicle at one step, from which the commander decides about mode, arming and failsafes.

    now: time since boot [s]
    xy_valid, z_valid, yaw_valid: whether the estimated horizontal position, height and heading are good
        enough to fly
    landed: True if the land detector detects the ground
    flying: True if the take-off is complete
    tilt_rad: angle between body z and down [rad]
    battery: remaining charge 0..1
    offboard_age: time since the last offboard setpoint [s]
    offboard_needs_position: True if the last offboard setpoint contains a position or velocity
    gcs_age: time since the last heartbeat of a ground station [s]
    aligned: True if the estimator has its initial attitude
    global_ok: True if position and origin are valid
    home_ok: True if the home position is set
    mission_ok: True if a feasible mission is stored
    has_fence: True if the vehicle has a geofence
    fence: PX4's text for the violated geofence rule, "" if no rule is violated
    poses_rejected: True if the newest pose contradicts the estimate
    manual: stick positions that are received, their motion and gestures
    """

    now: float = 0.0
    xy_valid: bool = False
    z_valid: bool = False
    yaw_valid: bool = False
    landed: bool = True
    flying: bool = False
    tilt_rad: float = 0.0
    battery: float = 1.0
    offboard_age: float = math.inf
    offboard_needs_position: bool = False
    gcs_age: float = math.inf
    aligned: bool = False
    global_ok: bool = True
    home_ok: bool = True
    mission_ok: bool = False
    has_fence: bool = False
    fence: str = ""
    poses_rejected: bool = False
    manual: ManualInput = field(default_factory=ManualInput)

    @property
    def manual_control(self) -> bool:
        """True if the pilot's sticks are received."""
        return self.manual.sticks is not None

    @property
    def position_ok(self) -> bool:
        """True if horizontal position, height and heading are valid."""
        return self.xy_valid and self.z_valid and self.yaw_valid


@dataclass(slots=True, kw_only=True)
class CommanderParams:
    """Parameters of arming checks and failsafes, named as in PX4 but in lower case.

    fd_fail_rad: the smaller of FD_FAIL_R and FD_FAIL_P that is not 0 [rad], infinite if both are 0
    fd_fail_s: FD_FAIL_R_TTRI [s]
    stick_speed: speed of the sticks above which a pilot takes over, COM_RC_STICK_OV / 100 [1/s]
    gesture_s: COM_RC_ARM_HYST [s]
    lockdown_s: time after arming in which an attitude failure disarms, COM_LKDOWN_TKO + COM_SPOOLUP_TIME [s]
    """

    com_of_loss_t: float
    com_obl_rc_act: int
    com_fail_act_t: float
    com_disarm_land: float
    com_disarm_prflt: float
    com_low_bat_act: int
    bat_low_thr: float
    bat_crit_thr: float
    bat_emergen_thr: float
    nav_dll_act: int
    com_dl_loss_t: float
    cbrk_flightterm: int
    fd_fail_rad: float
    fd_fail_s: float = 0.3
    gf_action: int = 2
    com_dll_except: int = 0
    nav_rcl_act: int = 2
    com_rcl_except: int = 0
    com_rc_in_mode: int = 3
    com_rc_loss_t: float = 0.5
    com_rc_override: int = 1
    stick_speed: float = 0.3
    gesture_s: float = 1.0
    man_arm_gesture: int = 1
    com_disarm_man: int = 1
    com_posctl_navl: int = 0
    com_arm_bat_min: float = -1.0
    lockdown_s: float = 0.0

    @classmethod
    def read(cls, params: Params, row: int) -> CommanderParams:
        """Read the parameters of one vehicle from the table. row: index of the vehicle in `params`."""

        def get(name: str) -> float:
            return float(params[name][row])

        tilt_limits = [math.radians(get(name)) for name in ("FD_FAIL_R", "FD_FAIL_P") if get(name) > 0]
        return cls(
            com_of_loss_t=get("COM_OF_LOSS_T"),
            com_obl_rc_act=int(get("COM_OBL_RC_ACT")),
            com_fail_act_t=get("COM_FAIL_ACT_T"),
            com_disarm_land=get("COM_DISARM_LAND"),
            com_disarm_prflt=get("COM_DISARM_PRFLT"),
            com_low_bat_act=int(get("COM_LOW_BAT_ACT")),
            bat_low_thr=get("BAT_LOW_THR"),
            bat_crit_thr=get("BAT_CRIT_THR"),
            bat_emergen_thr=get("BAT_EMERGEN_THR"),
            nav_dll_act=int(get("NAV_DLL_ACT")),
            com_dl_loss_t=get("COM_DL_LOSS_T"),
            cbrk_flightterm=int(get("CBRK_FLIGHTTERM")),
            fd_fail_rad=min(tilt_limits, default=math.inf),
            fd_fail_s=get("FD_FAIL_R_TTRI"),
            gf_action=int(get("GF_ACTION")),
            com_dll_except=int(get("COM_DLL_EXCEPT")),
            nav_rcl_act=int(get("NAV_RCL_ACT")),
            com_rcl_except=int(get("COM_RCL_EXCEPT")),
            com_rc_in_mode=int(get("COM_RC_IN_MODE")),
            com_rc_loss_t=get("COM_RC_LOSS_T"),
            com_rc_override=int(get("COM_RC_OVERRIDE")),
            stick_speed=0.01 * get("COM_RC_STICK_OV"),
            gesture_s=1e-3 * get("COM_RC_ARM_HYST"),
            man_arm_gesture=int(get("MAN_ARM_GESTURE")),
            com_disarm_man=int(get("COM_DISARM_MAN")),
            com_posctl_navl=int(get("COM_POSCTL_NAVL")),
            com_arm_bat_min=get("COM_ARM_BAT_MIN"),
            lockdown_s=get("COM_LKDOWN_TKO") + get("COM_SPOOLUP_TIME"),
        )


def battery_too_low(s: CommanderInputs, params: CommanderParams) -> bool:
    """Return whether the battery charge is too low for arming.

    The limit is COM_ARM_BAT_MIN, or the critical charge BAT_CRIT_THR if COM_ARM_BAT_MIN is negative.
    """
    if params.com_arm_bat_min >= 0.0:
        return s.battery < params.com_arm_bat_min
    return s.battery <= params.bat_crit_thr


def gcs_lost(s: CommanderInputs, params: CommanderParams) -> bool:
    """Return whether the heartbeats of the ground station have been missing for too long (COM_DL_LOSS_T)."""
    return s.gcs_age > _GCS_HEARTBEAT_TIMEOUT_S + params.com_dl_loss_t
