"""The table of `renames`: what went, or came under another name or with another number, version by version. Data, no more.

"PX4 does so itself" is said where PX4 converts a stored value alike at its first start. Files are paths in PX4's tree, below src.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

Convert = Callable[[float], Mapping[str, float]]


class Change(NamedTuple):
    """From 1.`at` on `old` is not to be used as before.

    new: the names that take its place; () when nothing does.  convert: value -> {new name: value}; None when the number has
    to be chosen anew.  lingers: PX4 still has the old name then, without effect or with another meaning.
    """

    old: str
    at: int
    new: tuple[str, ...]
    convert: Convert | None
    why: str
    source: str
    lingers: bool = False


def _same(*new: str) -> Convert:
    return lambda value: dict.fromkeys(new, value)


def _times(new: str, factor: float) -> Convert:
    return lambda value: {new: value * factor}


def _by(tables: Mapping[str, Mapping[int, float]]) -> Convert:
    """Whole numbers by table: {new name: {old value: new value}}; a value that is missing gives nothing."""
    return lambda value: {name: table[int(value)] for name, table in tables.items() if int(value) in table}


def _aid_mask(value: float) -> Mapping[str, float]:
    """Bits: GNSS 1, flow 2, no accelerometer bias 4, drag 32, GNSS yaw 128; of vision position 8, yaw 16, velocity 256."""
    bits = int(value)
    vision = (3 if bits & 8 else 0) | (4 if bits & 256 else 0) | (8 if bits & 16 else 0)
    gnss = (7 if bits & 1 else 0) | (8 if bits & 128 else 0)
    imu = 3 if bits & 4 else 7
    return {
        "EKF2_EV_CTRL": vision,
        "EKF2_GPS_CTRL": gnss,
        "EKF2_OF_CTRL": 1 if bits & 2 else 0,
        "EKF2_DRAG_CTRL": 1 if bits & 32 else 0,
        "EKF2_IMU_CTRL": imu,
    }


def _height(value: float) -> Mapping[str, float]:
    """One source of height became a reference and switches: what was not the source was not fused."""
    mode = int(value)
    return {
        "EKF2_HGT_REF": mode,
        "EKF2_BARO_CTRL": 1 if mode == 0 else 0,
        **({"EKF2_RNG_CTRL": 2} if mode == 2 else {}),
    }


def _gone(*names: str, at: int, source: str, why: str = "nothing reads it any more") -> tuple[Change, ...]:
    return tuple(Change(name, at, (), None, why, source) for name in names)


def _moved(at: int, why: str, source: str, **names: str) -> tuple[Change, ...]:
    return tuple(Change(old, at, (new,), _same(new), why, source) for old, new in names.items())


_TRANSLATION = "lib/parameters/param_translation.cpp"
_CONTROL = "modules/mc_pos_control/PositionControl/PositionControl.cpp"
_COMMANDER = "modules/commander/commander_params.c"
_EKF2 = "modules/ekf2/EKF2.cpp (VerifyParams)"
_BATTERY = (
    "A_PER_V",
    "CAPACITY",
    "N_CELLS",
    "R_INTERNAL",
    "SOURCE",
    "V_CHARGED",
    "V_DIV",
    "V_EMPTY",
    "V_LOAD_DROP",
)
_GAINS = tuple(f"MPC_{axis}_VEL_{term}" for axis in ("XY", "Z") for term in "PID")

CHANGES: tuple[Change, ...] = (
    # 1.10
    Change(
        "EKF2_EV_GATE",
        10,
        ("EKF2_EVP_GATE", "EKF2_EVV_GATE"),
        _same("EKF2_EVP_GATE", "EKF2_EVV_GATE"),
        "one gate became two: position and velocity",
        "modules/ekf2/ekf2_params.c",
    ),
    *_gone(
        "MC_TPA_BREAK_P",
        "MC_TPA_BREAK_I",
        "MC_TPA_BREAK_D",
        "MC_TPA_RATE_P",
        "MC_TPA_RATE_I",
        "MC_TPA_RATE_D",
        at=10,
        source="modules/mc_att_control/mc_att_control_params.c",
    ),
    *_gone("SYS_COMPANION", at=10, source="lib/systemlib/system_params.c"),
    *_gone("CBRK_NO_VISION", at=10, source="examples/position_estimator_inav/params.c"),
    # 1.11
    *(
        Change(
            old,
            11,
            (f"{old}_ACC",),
            _times(f"{old}_ACC", 20.0),
            "thrust became acceleration: the factor is gravity over hover thrust,"
            " 9.81 / MPC_THR_HOVER, which is 20 at 0.49; PX4 does so itself with 20",
            f"{_TRANSLATION}, {_CONTROL}",
        )
        for old in _GAINS
    ),
    *_moved(11, "PX4 does so itself", _TRANSLATION, MC_DTERM_CUTOFF="IMU_DGYRO_CUTOFF"),
    *_moved(
        11, "the name says which radio", "modules/mavlink/mavlink_params.c", MAV_RADIO_ID="MAV_SIK_RADIO_ID"
    ),
    *(
        Change(
            f"BAT_{name}",
            11,
            (f"BAT1_{name}",),
            _same(f"BAT1_{name}"),
            "batteries are numbered; the old name stays for a while",
            "lib/battery/battery_params_deprecated.c",
            lingers=True,
        )
        for name in _BATTERY
    ),
    Change(
        "NAV_RCL_ACT",
        11,
        ("NAV_RCL_ACT",),
        lambda v: {"NAV_RCL_ACT": 2 if v == 4 else v},
        "4, a contest's rules, went; PX4 takes 2, return",
        "modules/commander/Commander.cpp (2020-03-10)",
        lingers=True,
    ),
    Change(
        "NAV_DLL_ACT",
        11,
        ("NAV_DLL_ACT",),
        lambda v: {"NAV_DLL_ACT": 2 if v == 4 else v},
        "4, a contest's rules, went; PX4 takes 2, return",
        "modules/commander/Commander.cpp (2020-03-10)",
        lingers=True,
    ),
    *_gone("CBRK_GPSFAIL", at=11, source="lib/circuit_breaker/circuit_breaker_params.c"),
    *_gone(
        "MPC_CRUISE_90",
        "MPC_ACC_HOR_ESTM",
        "MPC_Z_TRAJ_P",
        "MPC_AUTO_MODE",
        at=11,
        source="modules/mc_pos_control/mc_pos_control_params.c",
    ),
    # 1.12
    Change(
        "NAV_RCL_ACT",
        12,
        ("NAV_RCL_ACT", "COM_RCL_EXCEPT"),
        lambda v: {"COM_RCL_EXCEPT": 7} if v == 0 else {"NAV_RCL_ACT": v},
        "0 (none) went; missions 1, hold 2 and offboard 4 are excepted by COM_RCL_EXCEPT, modes flown by sticks are not",
        _COMMANDER,
        lingers=True,
    ),
    Change(
        "SENS_BOARD_ROT",
        12,
        ("SENS_BOARD_ROT",),
        lambda v: {"SENS_BOARD_ROT": v} if v <= 25 else {},
        "from 26 on the numbers mean other rotations; up to 25 they are the same",
        "modules/sensors/sensor_params.c",
        lingers=True,
    ),
    *_moved(
        12, "one for each instance of MAVLink", "modules/mavlink/module.yaml", MAV_BROADCAST="MAV_0_BROADCAST"
    ),
    *_moved(
        12, "PX4 does so itself", _TRANSLATION, EKF2_GPS_MASK="SENS_GPS_MASK", EKF2_GPS_TAU="SENS_GPS_TAU"
    ),
    *_gone("COM_ARM_EKF_AB", "COM_ARM_EKF_GB", at=12, source=_COMMANDER),
    # 1.13
    Change(
        "COM_RC_IN_MODE",
        13,
        ("COM_RC_IN_MODE",),
        lambda v: {"COM_RC_IN_MODE": v} if v == 0 else {},
        "1 was a joystick or no sticks at all (now 1 or 4), 2 a joystick made into radio channels (gone): choose anew",
        _COMMANDER,
        lingers=True,
    ),
    *_moved(
        13,
        "PX4 does so itself",
        _TRANSLATION,
        IMU_GYRO_NF_FREQ="IMU_GYRO_NF0_FRQ",
        IMU_GYRO_NF_BW="IMU_GYRO_NF0_BW",
    ),
    *_gone(
        "COM_POS_FS_PROB",
        "COM_POS_FS_GAIN",
        at=13,
        why="a position is valid again after 1 s",
        source="modules/commander/Commander.cpp (check_posvel_validity)",
    ),
    *_gone("EKF2_MIN_OBS_DT", "EKF2_MOVE_TEST", at=13, source="modules/ekf2/ekf2_params.c"),
    # 1.14
    Change(
        "EKF2_AID_MASK",
        14,
        ("EKF2_EV_CTRL", "EKF2_GPS_CTRL", "EKF2_OF_CTRL", "EKF2_DRAG_CTRL", "EKF2_IMU_CTRL"),
        _aid_mask,
        "one mask became one for each source: 24 is EKF2_EV_CTRL 11 and EKF2_GPS_CTRL 0; PX4 does so itself but for GNSS",
        _EKF2,
        lingers=True,
    ),
    Change(
        "EKF2_HGT_MODE",
        14,
        ("EKF2_HGT_REF", "EKF2_BARO_CTRL", "EKF2_RNG_CTRL"),
        _height,
        "the source of height is a reference now, and several are"
        " fused: what was not chosen is switched off here; PX4 itself leaves the barometer on",
        f"{_TRANSLATION}, {_EKF2}",
    ),
    *_moved(14, "PX4 does so itself", _TRANSLATION, EKF2_RNG_AID="EKF2_RNG_CTRL"),
    Change(
        "EKF2_WIND_NOISE",
        14,
        ("EKF2_WIND_NSD",),
        _times("EKF2_WIND_NSD", 0.1),
        "a deviation at 100 Hz became a density; PX4 does so itself",
        _TRANSLATION,
    ),
    Change(
        "COM_OBL_ACT",
        14,
        ("COM_OBL_RC_ACT",),
        _by({"COM_OBL_RC_ACT": {0: 4, 1: 5, 2: 3, 3: 6, 4: 7}}),
        "one action, with sticks and without; its numbers differ (land 0 is 4), and -1 (none) has no successor",
        "modules/commander/failsafe/failsafe.cpp",
    ),
    Change(
        "COM_OBL_RC_ACT",
        14,
        ("COM_OBL_RC_ACT",),
        lambda v: {"COM_OBL_RC_ACT": v} if v >= 0 else {},
        "-1 (none) went, and now means position; it acts without sticks as well",
        "modules/commander/failsafe/failsafe.cpp (fromOffboardLossActParam)",
        lingers=True,
    ),
    *_moved(
        14,
        "one wait before failsafes of links, battery, fence and motors",
        "modules/commander/failsafe/framework.cpp",
        COM_RCL_ACT_T="COM_FAIL_ACT_T",
    ),
    *_gone(
        "COM_BAT_ACT_T",
        at=14,
        why="COM_FAIL_ACT_T is the wait of several failsafes",
        source="modules/commander/failsafe/framework.cpp",
    ),
    *_moved(
        14,
        "the allocator waits now, not the position controller",
        "modules/control_allocator/module.yaml",
        MPC_SPOOLUP_TIME="COM_SPOOLUP_TIME",
    ),
    Change(
        "MIS_TAKEOFF_REQ",
        14,
        ("MIS_TKO_LAND_REQ",),
        _by({"MIS_TKO_LAND_REQ": {0: 0, 1: 1}}),
        "it asks for landings as well now",
        "modules/navigator/mission_params.c",
    ),
    *_moved(
        14,
        "the navigator's, in every mode",
        "modules/navigator/navigator_params.c",
        MIS_LTRMIN_ALT="NAV_MIN_LTR_ALT",
    ),
    *_gone(
        "CBRK_VELPOSERR",
        "CBRK_ENGINEFAIL",
        "CBRK_RATE_CTRL",
        at=14,
        source="lib/circuit_breaker/circuit_breaker_params.c",
    ),
    *_gone("COM_POS_FS_EPV", at=14, why="height is not judged by its error any more", source=_COMMANDER),
    *_gone("MAV_ODOM_LP", at=14, source="modules/mavlink/mavlink_params.c"),
    *_gone(
        "SYS_CTRL_ALLOC",
        at=14,
        why="control allocation (CA_*) is the only way, mixer files went",
        source="lib/systemlib/system_params.c",
    ),
    *_gone(
        "SYS_USE_IO",
        at=14,
        why="outputs are given functions instead: PWM_MAIN_FUNC1 and so on",
        source="drivers/px4io/px4io_params.c",
    ),
    *_gone(
        "MIS_DIST_WPS",
        "NAV_AH_LAT",
        "NAV_AH_LON",
        "NAV_AH_ALT",
        at=14,
        source="modules/navigator/mission_params.c",
    ),
    # 1.15
    Change(
        "SYS_MC_EST_GROUP",
        15,
        ("EKF2_EN", "LPE_EN", "ATT_EN"),
        _by({"EKF2_EN": {1: 0, 2: 1, 3: 0}, "LPE_EN": {1: 1, 2: 0, 3: 0}, "ATT_EN": {1: 1, 2: 0, 3: 1}}),
        "a switch for each estimator; PX4 does so itself",
        _TRANSLATION,
    ),
    Change(
        "CBRK_AIRSPD_CHK",
        15,
        ("SYS_HAS_NUM_ASPD",),
        _by({"SYS_HAS_NUM_ASPD": {162128: 0}}),
        "PX4 does so itself",
        _TRANSLATION,
    ),
    Change(
        "EKF2_MAG_TYPE",
        15,
        ("EKF2_MAG_TYPE",),
        lambda v: {"EKF2_MAG_TYPE": v if v in (0, 1, 5) else 0},
        "2, 3 and 4 went; 0 is automatic",
        "modules/ekf2/ekf2_params.c",
        lingers=True,
    ),
    *_gone("EKF2_MAG_YAWLIM", at=15, source="modules/ekf2/ekf2_params.c"),
    *_gone("GF_ALTMODE", "GF_COUNT", at=15, source="modules/navigator/geofence_params.c"),
    # 1.16
    *_gone("COM_POS_FS_DELAY", at=16, why="EKF2_NOAID_TOUT is how late a loss is noticed", source=_COMMANDER),
    *_gone(
        "COM_ARM_EKF_HGT", "COM_ARM_EKF_POS", "COM_ARM_EKF_VEL", "COM_ARM_EKF_YAW", at=16, source=_COMMANDER
    ),
    *_gone("COM_OBS_AVOID", at=16, source=_COMMANDER),
    *_gone(
        "MOT_SLEW_MAX",
        at=16,
        why="CA_R0_SLEW and so on limit each motor, in seconds",
        source="lib/mixer_module/motor_params.c",
    ),
    *_gone("EKF2_TERR_MASK", at=16, source="modules/ekf2/module.yaml"),
    # 1.17
    *_gone(
        "COM_POSCTL_NAVL",
        at=17,
        why="position mode without a position becomes altitude, then stabilized; from 1.18 on NAV_RCL_ACT acts without sticks",
        source="modules/commander/failsafe/failsafe.cpp (checkModeFallback)",
    ),
    *_moved(
        17,
        "every mode flown by sticks has the same dead zone",
        "modules/manual_control/manual_control_params.yaml",
        MPC_HOLD_DZ="MAN_DEADZONE",
    ),
    *_gone(
        "MPC_XY_MAN_EXPO",
        "MPC_Z_MAN_EXPO",
        "MPC_YAW_EXPO",
        at=17,
        source="modules/mc_pos_control/multicopter_position_mode_params.c",
    ),
    # 1.18
    *_moved(
        18,
        "each receiver has its own; PX4 does so itself",
        _TRANSLATION,
        EKF2_GPS_POS_X="SENS_GPS0_OFFX",
        EKF2_GPS_POS_Y="SENS_GPS0_OFFY",
        EKF2_GPS_POS_Z="SENS_GPS0_OFFZ",
    ),
    Change(
        "EKF2_GPS_DELAY",
        18,
        ("SENS_GPS0_DELAY", "SENS_GPS1_DELAY"),
        lambda v: dict.fromkeys(("SENS_GPS0_DELAY", "SENS_GPS1_DELAY"), int(v)),
        "each receiver has its own, in whole milliseconds; PX4 does so itself",
        _TRANSLATION,
    ),
    Change(
        "COM_RC_OVERRIDE",
        18,
        ("MAN_OVERRIDE_SPD",),
        lambda v: {"MAN_OVERRIDE_SPD": -1.0} if v == 0 else {},
        "the pilot takes over by"
        " moving a stick fast, in every mode: 0 is -1, anything else is to be chosen anew; PX4 does so itself",
        _TRANSLATION,
    ),
    *_gone(
        "COM_RC_STICK_OV",
        at=18,
        why="MAN_OVERRIDE_SPD is a speed of the stick, not a deflection",
        source=_TRANSLATION,
    ),
    Change(
        "MPC_LAND_RC_HELP",
        18,
        ("MPC_AUTO_NUDGING",),
        lambda v: {"MPC_AUTO_NUDGING": 2 if v else 0},
        "a bit mask: landing is bit 1; PX4 does so itself",
        _TRANSLATION,
    ),
    *_moved(
        18,
        "four such sources",
        "modules/ekf2/params_aux_global_position.yaml",
        **{f"EKF2_AGP_{x}": f"EKF2_AGP0_{x}" for x in ("CTRL", "DELAY", "GATE", "MODE", "NOISE")},
    ),
    *_gone(
        "COM_LKDOWN_TKO",
        "COM_KILL_DISARM",
        "COM_FLT_PROFILE",
        "COM_TAKEOFF_ACT",
        "COM_HLDL_REG_T",
        "COM_OBC_LOSS_T",
        "COM_MOT_TEST_EN",
        "COM_ARM_SDCARD",
        "COM_IMB_PROP_ACT",
        at=18,
        why="its default is fixed now",
        source="docs/en/releases/1.18.md",
    ),
    *_gone("MPC_USE_HTE", at=18, source="modules/mc_pos_control/multicopter_position_control_params.c"),
    *_gone("GF_PREDICT", at=18, source="modules/navigator/geofence_params.c"),
)
