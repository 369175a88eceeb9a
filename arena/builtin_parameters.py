"""Parameters of the built-in autopilot: types, defaults, ranges, and parameters without effect.

Names, types, ranges and defaults are those of the PX4 v1.16 parameter reference. The autopilot, `arena check` and
the messages to the user read these tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from arena.constants import INT32_MAX, INT32_MIN

Type = Literal["int32", "float"]


@dataclass(frozen=True, kw_only=True)
class Spec:
    """Type, default and inclusive range of a parameter of the built-in autopilot."""

    type: Type
    default: float
    low: float = -math.inf
    high: float = math.inf


def _f(default: float, low: float = -math.inf, high: float = math.inf) -> Spec:
    return Spec(type="float", default=default, low=low, high=high)


def _i(default: int, low: int = INT32_MIN, high: int = INT32_MAX) -> Spec:
    return Spec(type="int32", default=default, low=low, high=high)


SPECS: dict[str, Spec] = {
    # identity and arming
    "MAV_SYS_ID": _i(1, 1, 250),
    "MAV_COMP_ID": _i(1, 1, 250),
    "SYS_AUTOSTART": _i(10016),
    "SYS_HAS_GPS": _i(1, 0, 1),
    "SYS_FAILURE_EN": _i(1, 0, 1),  # PX4's default in simulation; 0 on hardware
    "COM_ARM_WO_GPS": _i(1, 0, 2),
    "COM_DISARM_LAND": _f(2.0),
    "COM_DISARM_PRFLT": _f(10.0),
    "COM_SPOOLUP_TIME": _f(1.0, 0, 30),
    "COM_ARM_BAT_MIN": _f(-1.0),
    "COM_LKDOWN_TKO": _f(3.0),
    "CBRK_FLIGHTTERM": _i(121212),
    # failsafes
    "COM_OF_LOSS_T": _f(1.0, 0, 60),
    "COM_OBL_RC_ACT": _i(0, 0, 7),
    "COM_FAIL_ACT_T": _f(5.0, 0, 25),
    "COM_DL_LOSS_T": _i(10, 5, 300),
    "NAV_DLL_ACT": _i(0, 0, 6),
    "COM_DLL_EXCEPT": _i(0, 0, 7),
    "NAV_RCL_ACT": _i(2, 1, 6),
    "COM_RCL_EXCEPT": _i(0, 0, 31),
    "COM_RC_IN_MODE": _i(3, 0, 8),
    "COM_RC_LOSS_T": _f(0.5, 0, 35),
    "COM_POSCTL_NAVL": _i(0, 0, 1),
    "COM_RC_OVERRIDE": _i(1, 0, 3),
    "COM_RC_STICK_OV": _f(30.0, 5, 80),
    "COM_RC_ARM_HYST": _i(1000, 100, 1500),
    "COM_DISARM_MAN": _i(1, 0, 1),
    "MAN_ARM_GESTURE": _i(1, 0, 1),
    "COM_LOW_BAT_ACT": _i(0, 0, 3),
    "BAT_LOW_THR": _f(0.15, 0.05, 0.5),
    "BAT_CRIT_THR": _f(0.07, 0.03, 0.5),
    "BAT_EMERGEN_THR": _f(0.05, 0.03, 0.5),
    "FD_FAIL_R": _i(60, 0, 180),
    "FD_FAIL_P": _i(60, 0, 180),
    "FD_FAIL_R_TTRI": _f(0.3),
    # estimator
    "EKF2_EN": _i(1, 0, 1),
    "EKF2_EV_CTRL": _i(0, 0, 15),
    "EKF2_EV_DELAY": _f(0.0, 0, 300),
    "EKF2_EVP_NOISE": _f(0.1, 0.01),
    "EKF2_EVA_NOISE": _f(0.1, 0.05),
    "EKF2_EVP_GATE": _f(5.0, 1),
    "EKF2_HDG_GATE": _f(2.6, 1),
    "EKF2_EV_NOISE_MD": _i(0, 0, 1),
    "EKF2_HGT_REF": _i(1, 0, 3),
    "EKF2_GPS_CTRL": _i(7, 0, 15),
    "EKF2_BARO_CTRL": _i(1, 0, 1),
    "EKF2_BARO_NOISE": _f(3.5, 0.01),
    "EKF2_MAG_TYPE": _i(0, 0, 6),
    "EKF2_NOAID_TOUT": _i(5_000_000, 500_000, 10_000_000),
    "EKF2_ACC_NOISE": _f(0.35, 0.01),
    "EKF2_GYR_NOISE": _f(0.015, 0.0001),
    "EKF2_ACC_B_NOISE": _f(0.003, 0),
    "EKF2_GYR_B_NOISE": _f(0.001, 0),
    "EKF2_ABL_LIM": _f(0.4, 0, 0.8),
    # PX4 has no limit here; a length that no vehicle has would make the estimate overflow [m]
    "EKF2_EV_POS_X": _f(0.0, -10, 10),
    "EKF2_EV_POS_Y": _f(0.0, -10, 10),
    "EKF2_EV_POS_Z": _f(0.0, -10, 10),
    # position and velocity control
    "MPC_XY_P": _f(0.95, 0, 2),
    "MPC_Z_P": _f(1.0, 0.1, 1.5),
    "MPC_XY_VEL_P_ACC": _f(1.8, 1.2, 5),
    "MPC_XY_VEL_I_ACC": _f(0.4, 0, 60),
    "MPC_XY_VEL_D_ACC": _f(0.2, 0.1, 2),
    "MPC_Z_VEL_P_ACC": _f(4.0, 2, 15),
    "MPC_Z_VEL_I_ACC": _f(2.0, 0.2, 3),
    "MPC_Z_VEL_D_ACC": _f(0.0, 0, 2),
    "MPC_XY_VEL_MAX": _f(12.0, 0, 20),
    "MPC_Z_VEL_MAX_UP": _f(3.0, 0.5, 8),
    "MPC_Z_VEL_MAX_DN": _f(1.5, 0.5, 4),
    "MPC_XY_CRUISE": _f(5.0, 3, 20),
    "MPC_ACC_HOR": _f(3.0, 2, 15),
    "MPC_ACC_HOR_MAX": _f(5.0, 2, 15),
    "MPC_ACC_UP_MAX": _f(4.0, 2, 15),
    "MPC_ACC_DOWN_MAX": _f(3.0, 2, 15),
    "MPC_JERK_AUTO": _f(4.0, 1, 80),
    "MPC_JERK_MAX": _f(8.0, 0.5, 500),
    "MPC_TILTMAX_AIR": _f(45.0, 20, 89),
    "MPC_TILTMAX_LND": _f(12.0, 5, 89),
    "MPC_THR_HOVER": _f(0.5, 0.1, 0.8),
    "MPC_THR_MIN": _f(0.12, 0.05, 0.5),
    "MPC_THR_MAX": _f(1.0, 0, 1),
    "MPC_THR_XY_MARG": _f(0.3, 0, 0.5),
    "MPC_USE_HTE": _i(1, 0, 1),
    "MPC_VELD_LP": _f(5.0, 0, 50),
    "MPC_TKO_SPEED": _f(1.5, 1, 5),
    "MPC_TKO_RAMP_T": _f(3.0, 0, 5),
    "MPC_LAND_SPEED": _f(0.7, 0.6),
    "MPC_LAND_ALT1": _f(10.0, 0, 122),
    "MPC_LAND_ALT2": _f(5.0, 0, 122),
    "MPC_YAWRAUTO_MAX": _f(45.0, 5, 360),
    "MIS_TAKEOFF_ALT": _f(2.5, 0),
    "MPC_HOLD_MAX_XY": _f(0.8, 0, 3),
    "MPC_Z_V_AUTO_UP": _f(3.0, 0.5, 8),
    "MPC_Z_V_AUTO_DN": _f(1.5, 0.5, 4),
    "MPC_XY_ERR_MAX": _f(2.0, 0.1, 10),
    # manual flight
    "MPC_POS_MODE": _i(4, 0, 4),
    "MPC_HOLD_DZ": _f(0.1, 0, 1),
    "MPC_XY_MAN_EXPO": _f(0.6, 0, 1),
    "MPC_Z_MAN_EXPO": _f(0.6, 0, 1),
    "MPC_YAW_EXPO": _f(0.6, 0, 1),
    "MPC_VEL_MANUAL": _f(10.0, 3, 20),
    "MPC_VEL_MAN_SIDE": _f(-1.0, -1, 20),
    "MPC_VEL_MAN_BACK": _f(-1.0, -1, 20),
    "MPC_MAN_TILT_MAX": _f(35.0, 1, 70),
    "MPC_MAN_Y_MAX": _f(150.0, 0, 400),
    "MPC_MAN_Y_TAU": _f(0.08, 0, 5),
    "MPC_MANTHR_MIN": _f(0.08, 0, 1),
    "MPC_THR_CURVE": _i(0, 0, 2),
    "MC_ACRO_R_MAX": _f(100.0, 0, 1800),
    "MC_ACRO_P_MAX": _f(100.0, 0, 1800),
    "MC_ACRO_Y_MAX": _f(100.0, 0, 1800),
    "MC_ACRO_EXPO": _f(0.0, 0, 1),
    "MC_ACRO_EXPO_Y": _f(0.0, 0, 1),
    "MC_ACRO_SUPEXPO": _f(0.0, 0, 0.95),
    "MC_ACRO_SUPEXPOY": _f(0.0, 0, 0.95),
    # missions, return and geofence; PX4's defaults for a multirotor
    "NAV_ACC_RAD": _f(2.0, 0.05, 200),
    "NAV_MC_ALT_RAD": _f(0.8, 0.05, 200),
    "MIS_YAW_ERR": _f(12.0, 0, 90),
    "MIS_YAW_TMT": _f(-1.0, -1, 20),
    "MIS_DIST_1WP": _f(10_000.0, -1, 100_000),
    "MIS_TKO_LAND_REQ": _i(0, 0, 5),
    "RTL_TYPE": _i(0, 0, 5),
    "RTL_RETURN_ALT": _f(30.0, 0),
    "RTL_DESCEND_ALT": _f(10.0, 0),
    "RTL_LAND_DELAY": _f(0.0, -1),
    "RTL_MIN_DIST": _f(10.0, 0.5),
    "RTL_CONE_ANG": _i(45, 0, 90),
    "GF_ACTION": _i(2, 0, 5),
    "GF_SOURCE": _i(0, 0, 1),
    "GF_PREDICT": _i(0, 0, 1),
    "GF_MAX_HOR_DIST": _f(0.0, 0, 10_000),
    "GF_MAX_VER_DIST": _f(0.0, 0, 10_000),
    # attitude and rate control
    "MC_ROLL_P": _f(6.5, 0, 12),
    "MC_PITCH_P": _f(6.5, 0, 12),
    "MC_YAW_P": _f(2.8, 0, 5),
    "MC_YAW_WEIGHT": _f(0.4, 0, 1),
    "MC_ROLLRATE_P": _f(0.15, 0.01, 0.5),
    "MC_ROLLRATE_I": _f(0.2, 0),
    "MC_ROLLRATE_D": _f(0.003, 0, 0.01),
    "MC_RR_INT_LIM": _f(0.3, 0),
    "MC_PITCHRATE_P": _f(0.15, 0.01, 0.6),
    "MC_PITCHRATE_I": _f(0.2, 0),
    "MC_PITCHRATE_D": _f(0.003, 0),
    "MC_PR_INT_LIM": _f(0.3, 0),
    "MC_YAWRATE_P": _f(0.2, 0, 0.6),
    "MC_YAWRATE_I": _f(0.1, 0),
    "MC_YAWRATE_D": _f(0.0, 0),
    "MC_YR_INT_LIM": _f(0.3, 0),
    "MC_ROLLRATE_MAX": _f(220.0, 0, 1800),
    "MC_PITCHRATE_MAX": _f(220.0, 0, 1800),
    "MC_YAWRATE_MAX": _f(200.0, 0, 1800),
    "MC_ROLLRATE_K": _f(1.0, 0.01, 5),
    "MC_PITCHRATE_K": _f(1.0, 0.01, 5),
    "MC_YAWRATE_K": _f(1.0, 0.01, 5),
    "MC_YAW_TQ_CUTOFF": _f(2.0, 0, 10),
    "MC_AIRMODE": _i(0, 0, 2),
    "IMU_GYRO_CUTOFF": _f(40.0, 0, 1000),
    "IMU_DGYRO_CUTOFF": _f(30.0, 0, 1000),
    "IMU_INTEG_RATE": _i(250, 100, 1000),
    # logging
    "SDLOG_MODE": _i(0, -1, 4),
    # orbit and follow-me
    "MC_ORBIT_RAD_MAX": _f(1000.0, 1, 10000),
    "MC_ORBIT_YAW_MOD": _i(0, 0, 4),
    "FLW_TGT_RS": _f(0.1, 0, 1),
    "FLW_TGT_HT": _f(8.0, 8),
    "FLW_TGT_DST": _f(8.0, 1),
    "FLW_TGT_FA": _f(180.0, -180, 180),
    "FLW_TGT_ALT_M": _i(0, 0, 2),
    "FLW_TGT_MAX_VEL": _f(5.0, 0, 20),
    # landing
    "LNDMC_Z_VEL_MAX": _f(0.25, 0.05),
    "LNDMC_XY_VEL_MAX": _f(1.5, 0),
    "LNDMC_ROT_MAX": _f(20.0, 0),
    "LNDMC_TRIG_TIME": _f(1.0, 0.1),
}


_NO_GPS = "it has no GPS receiver"
_NO_FOLLOWING = "it has no mode AUTO.FOLLOW_TARGET"
_HEIGHT = "it takes its height from external vision, and from the barometer after a loss of vision"

WITHOUT_EFFECT: dict[str, str] = {
    "MAV_COMP_ID": "its component id is always 1",
    "SYS_AUTOSTART": "the profile replaces the airframe",
    "SYS_HAS_GPS": _NO_GPS,
    "COM_ARM_WO_GPS": _NO_GPS,
    "EKF2_EN": "its estimator always runs",
    "EKF2_HGT_REF": _HEIGHT,
    "EKF2_GPS_CTRL": _NO_GPS,
    "EKF2_BARO_NOISE": "it assumes 0.5 m",
    "EKF2_MAG_TYPE": "it has no magnetometer and takes its heading from external vision",
    "MPC_ACC_HOR_MAX": "POSCTL accelerates by MPC_ACC_HOR, as PX4 with MPC_POS_MODE 4",
    "MPC_HOLD_MAX_XY": "POSCTL holds the position when its trajectory has stopped",
    "MPC_POS_MODE": "POSCTL and ALTCTL are those of MPC_POS_MODE 4",
    "MPC_USE_HTE": "it does not estimate the hover thrust and uses MPC_THR_HOVER",
    "RTL_TYPE": "AUTO.RTL always flies to home or a nearer rally point",
    "GF_SOURCE": _NO_GPS,
    "GF_PREDICT": "a geofence is violated when the vehicle crosses it",
    "MC_AIRMODE": "it never raises the thrust for roll, pitch or yaw",
    "MC_ORBIT_YAW_MOD": "the nose points to the centre if the command does not say otherwise",
    **dict.fromkeys(
        ("FLW_TGT_RS", "FLW_TGT_HT", "FLW_TGT_DST", "FLW_TGT_FA", "FLW_TGT_ALT_M", "FLW_TGT_MAX_VEL"),
        _NO_FOLLOWING,
    ),
    "IMU_INTEG_RATE": "its rate is `sim.sensor_hz`",
}
"""Parameters that can be set and read, but change nothing in the built-in autopilot. Name -> reason."""


def effect_problem(name: str, value: float) -> str:
    """Return why the built-in autopilot ignores a parameter value; "" if there is no problem.

    The default value of a known parameter is never a problem.
    """
    if name not in SPECS:
        return f"the built-in autopilot has no {name}"
    if name in WITHOUT_EFFECT and value != SPECS[name].default:
        return f"the built-in autopilot does not use {name}: {WITHOUT_EFFECT[name]}"
    return ""
