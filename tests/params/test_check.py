"""Tests of the check: every rule finds a wrong value, is silent on right ones, and says why and what to do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arena.errors import InputError
from arena.params.checks.check import RULES, check, check_written, finding_line
from arena.params.checks.findings import CheckContext, Environment, Finding
from arena.params.facts.parameter_table import Version, parameters, versions
from arena.params.param_files import read_values
from arena.plan.firmware import firmware
from arena.schema.load import load_arena

EXAMPLE = Path(__file__).parents[2] / "examples" / "01_two_quads" / "arena.yaml"
NO_VISION = Environment(vision=False, gps=True)
WITH_GPS, WITH_RC, LOW = Environment(gps=True), Environment(rc=True), Environment(height_m=3.0)
EVERY_NAME = sorted(
    {name for version in versions() for name in parameters(version)} | {"FOO", "ekf2_ev_ctrl"}
)


def of(name: str, findings: list[Finding]) -> list[Finding]:
    return [f for f in findings if f.name == name]


def found(values, version, environment=None) -> dict[str, str]:
    """Return {name: worst severity} of the errors and warnings."""
    return {
        f.name: f.severity
        for f in reversed(check(values, version, environment=environment))
        if f.severity != "note"
    }


def to_set(fix: str) -> dict[str, float]:
    """Return the values that a fix says to set; {} where it names none."""
    assignments = re.match(r"set ((?:[A-Z0-9_]+ -?[0-9.]+(?:, )?)+)", fix)
    left = re.search(r"leave (\w+) at its default (\S+)", fix)
    pairs = [pair.split() for pair in assignments[1].rstrip(", ").split(", ")] if assignments else []
    return {n: float(v) for n, v in [*pairs, *([left.groups()] if left else [])]}


# --- right values


def test_generated_parameters_have_only_notes():
    arena = load_arena(EXAMPLE)
    environment = Environment(joystick=True, latency_ms=arena.mocap.latency_ms, height_m=arena.world.size[2])
    for vehicle in arena.vehicles:
        findings = check(firmware(arena, vehicle).values, "1.16", environment=environment)
        assert [f for f in findings if f.severity != "note"] == []
        assert {f.name for f in findings} <= {"BAT1_N_CELLS", "CBRK_FLIGHTTERM", "GF_MAX_HOR_DIST"}


GOOD = {
    "1.9.2": {
        "EKF2_AID_MASK": 24,
        "EKF2_HGT_MODE": 3,
        "EKF2_MAG_TYPE": 5,
        "EKF2_EV_DELAY": 20.0,
        "EKF2_EVP_NOISE": 0.02,
        "EKF2_NOAID_TOUT": 1_000_000,
        "COM_OF_LOSS_T": 0.5,
        "COM_OBL_ACT": 0,
        "COM_OBL_RC_ACT": 4,
        "COM_RC_IN_MODE": 1,
        "COM_LOW_BAT_ACT": 2,
        "BAT_N_CELLS": 4,
        "CBRK_FLIGHTTERM": 0,
        "COM_DISARM_LAND": 2.0,
        "MPC_THR_HOVER": 0.4,
        "GF_MAX_HOR_DIST": 4.0,
        "GF_MAX_VER_DIST": 2.5,
        "GF_ACTION": 2,
        "RTL_RETURN_ALT": 1.5,
    },
    "1.13": {
        "EKF2_AID_MASK": 24,
        "EKF2_HGT_MODE": 3,
        "EKF2_MAG_TYPE": 5,
        "EKF2_EV_DELAY": 20.0,
        "EKF2_EVP_NOISE": 0.02,
        "EKF2_NOAID_TOUT": 1_000_000,
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_ACT": 0,
        "COM_OBL_RC_ACT": 4,
        "COM_RC_IN_MODE": 4,
        "COM_RCL_EXCEPT": 4,
        "COM_LOW_BAT_ACT": 2,
        "BAT1_N_CELLS": 4,
        "CBRK_FLIGHTTERM": 0,
        "SYS_HAS_GPS": 0,
        "MPC_THR_HOVER": 0.4,
        "GF_MAX_HOR_DIST": 4.0,
        "GF_MAX_VER_DIST": 2.5,
        "GF_ACTION": 5,
        "RTL_RETURN_ALT": 1.5,
    },
    "1.16": {
        "EKF2_EV_CTRL": 11,
        "EKF2_GPS_CTRL": 0,
        "EKF2_HGT_REF": 3,
        "EKF2_MAG_TYPE": 5,
        "EKF2_EV_DELAY": 20.0,
        "EKF2_EVP_NOISE": 0.02,
        "EKF2_NOAID_TOUT": 1_000_000,
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_RC_ACT": 4,
        "COM_RC_IN_MODE": 4,
        "COM_FAIL_ACT_T": 0.0,
        "COM_LOW_BAT_ACT": 2,
        "BAT1_N_CELLS": 4,
        "CBRK_FLIGHTTERM": 0,
        "SYS_HAS_GPS": 0,
        "MPC_THR_HOVER": 0.4,
        "GF_MAX_HOR_DIST": 4.0,
        "GF_MAX_VER_DIST": 2.5,
        "GF_ACTION": 5,
        "RTL_RETURN_ALT": 1.5,
    },
}


@pytest.mark.parametrize("version", GOOD)
def test_right_parameters_have_no_findings(version):
    assert check(GOOD[version], version, environment=LOW) == []


@pytest.mark.parametrize("version", ["1.14", "1.15", "1.17", "1.18"])
def test_right_parameters_of_1_16_are_right_in_1_14_to_1_18(version):
    assert check(GOOD["1.16"], version, environment=LOW) == []


# --- wrong values: (version, change of the right values, parameter, severity, words of the finding, environment)

WRONG: list[tuple[str, dict[str, float], str, str, str, Environment]] = [
    # external vision
    ("1.16", {"EKF2_EV_CTRL": 0}, "EKF2_EV_CTRL", "error", "not fused", LOW),
    ("1.16", {"EKF2_EV_CTRL": 8}, "EKF2_EV_CTRL", "error", "not fused", LOW),
    ("1.16", {"EKF2_EV_CTRL": 9}, "EKF2_EV_CTRL", "warning", "height", LOW),
    ("1.16", {"EKF2_EV_CTRL": 3}, "EKF2_EV_CTRL", "error", "no heading", LOW),
    ("1.16", {"EKF2_EV_CTRL": 3, "EKF2_MAG_TYPE": 1}, "EKF2_EV_CTRL", "warning", "yaw", LOW),
    ("1.9.2", {"EKF2_AID_MASK": 1}, "EKF2_AID_MASK", "error", "not fused", LOW),
    ("1.13", {"EKF2_AID_MASK": 8}, "EKF2_AID_MASK", "error", "no heading", LOW),
    ("1.16", {"EKF2_EN": 0}, "EKF2_EN", "error", "EKF2 is off", LOW),
    ("1.9.2", {"SYS_MC_EST_GROUP": 1}, "SYS_MC_EST_GROUP", "error", "other than EKF2", LOW),
    ("1.16", {"EKF2_HGT_REF": 1}, "EKF2_HGT_REF", "warning", "GPS", LOW),
    ("1.13", {"EKF2_HGT_MODE": 0}, "EKF2_HGT_MODE", "warning", "barometer", LOW),
    ("1.16", {"EKF2_EV_DELAY": 0.0}, "EKF2_EV_DELAY", "warning", "unset", LOW),
    ("1.9.2", {"EKF2_EV_DELAY": 175.0}, "EKF2_EV_DELAY", "warning", "the default", LOW),
    (
        "1.16",
        {"EKF2_EV_DELAY": 0.0},
        "EKF2_EV_DELAY",
        "warning",
        "set EKF2_EV_DELAY 41",
        Environment(latency_ms=41.0, height_m=3.0),
    ),
    ("1.16", {"EKF2_EVP_NOISE": 0.1}, "EKF2_EVP_NOISE", "note", "0.1 m", LOW),
    ("1.16", {"EKF2_MAG_TYPE": 0}, "EKF2_MAG_TYPE", "warning", "magnetometer", LOW),
    ("1.16", {"EKF2_NOAID_TOUT": 5_000_000}, "EKF2_NOAID_TOUT", "warning", "5 s", LOW),
    # GPS
    ("1.16", {"EKF2_GPS_CTRL": 7}, "EKF2_GPS_CTRL", "warning", "GPS", LOW),
    ("1.13", {"EKF2_AID_MASK": 25}, "EKF2_AID_MASK", "warning", "GPS", LOW),
    ("1.16", {"SYS_HAS_GPS": 1}, "SYS_HAS_GPS", "warning", "GPS receiver", LOW),
    ("1.16", {"COM_ARM_WO_GPS": 0}, "COM_ARM_WO_GPS", "error", "arming", LOW),
    ("1.9.2", {"COM_ARM_WO_GPS": 0}, "COM_ARM_WO_GPS", "error", "arming", LOW),
    # setpoints
    ("1.16", {"COM_OBL_RC_ACT": 0}, "COM_OBL_RC_ACT", "error", "position", LOW),
    ("1.16", {"COM_OBL_RC_ACT": 2}, "COM_OBL_RC_ACT", "error", "stabilized", LOW),
    ("1.16", {"COM_OBL_RC_ACT": -1}, "COM_OBL_RC_ACT", "error", "no such action", LOW),
    ("1.16", {"COM_OBL_RC_ACT": 7}, "COM_OBL_RC_ACT", "warning", "disarm", LOW),
    ("1.13", {"COM_OBL_RC_ACT": -1}, "COM_OBL_RC_ACT", "error", "no reaction", LOW),
    ("1.13", {"COM_OBL_ACT": -1}, "COM_OBL_ACT", "error", "no reaction", LOW),
    ("1.13", {"COM_OBL_ACT": 9}, "COM_OBL_ACT", "error", "no action", LOW),
    ("1.9.2", {"COM_OBL_RC_ACT": 0}, "COM_OBL_RC_ACT", "warning", "position", LOW),
    ("1.16", {"COM_OF_LOSS_T": 0.0}, "COM_OF_LOSS_T", "error", "as soon as it arrives", LOW),
    ("1.16", {"COM_OF_LOSS_T": 0.1}, "COM_OF_LOSS_T", "warning", "pause", LOW),
    ("1.16", {"COM_OF_LOSS_T": 10.0}, "COM_OF_LOSS_T", "warning", "10 s", LOW),
    ("1.9.2", {"COM_OF_LOSS_T": 0.0}, "COM_OF_LOSS_T", "warning", "0.5 s after the last", LOW),
    ("1.9.2", {"COM_OF_LOSS_T": 1.5}, "COM_OF_LOSS_T", "warning", "2 s", LOW),
    # RC and ground station
    ("1.16", {"COM_RC_IN_MODE": 3}, "COM_RC_IN_MODE", "warning", "expected", LOW),
    ("1.9.2", {"COM_RC_IN_MODE": 0}, "COM_RC_IN_MODE", "error", "does not arm", LOW),
    ("1.16", {"COM_RC_IN_MODE": 4}, "COM_RC_IN_MODE", "error", "ignored", WITH_RC),
    ("1.16", {"COM_RCL_EXCEPT": 4}, "COM_RCL_EXCEPT", "warning", "ignored", WITH_RC),
    ("1.16", {"NAV_RCL_ACT": 0}, "NAV_RCL_ACT", "error", "no action", WITH_RC),
    ("1.11", {"NAV_RCL_ACT": 0}, "NAV_RCL_ACT", "error", "no reaction", WITH_RC),
    ("1.16", {"COM_RC_IN_MODE": 0, "NAV_RCL_ACT": 6}, "NAV_RCL_ACT", "warning", "falls", WITH_RC),
    ("1.16", {"NAV_DLL_ACT": 3}, "NAV_DLL_ACT", "note", "ground station", LOW),
    ("1.16", {"NAV_DLL_ACT": 6}, "NAV_DLL_ACT", "warning", "falls", LOW),
    # wrong indoors
    ("1.16", {"COM_LOW_BAT_ACT": 3, "RTL_RETURN_ALT": 30.0}, "COM_LOW_BAT_ACT", "warning", "30 m", LOW),
    ("1.16", {"COM_OBL_RC_ACT": 3, "RTL_RETURN_ALT": 3.0}, "COM_OBL_RC_ACT", "warning", "ceiling", LOW),
    ("1.16", {"GF_ACTION": 4}, "GF_ACTION", "warning", "terminate", LOW),
    ("1.16", {"COM_ACT_FAIL_ACT": 4}, "COM_ACT_FAIL_ACT", "warning", "terminate", LOW),
    # the battery
    ("1.16", {"COM_LOW_BAT_ACT": 0}, "COM_LOW_BAT_ACT", "warning", "no reaction", LOW),
    ("1.16", {"COM_LOW_BAT_ACT": 9}, "COM_LOW_BAT_ACT", "error", "no action", LOW),
    ("1.16", {"BAT_CRIT_THR": 0.0, "BAT_EMERGEN_THR": 0.0}, "BAT_CRIT_THR", "error", "never reached", LOW),
    ("1.16", {"BAT_CRIT_THR": 0.05}, "BAT_EMERGEN_THR", "warning", "critical threshold has no effect", LOW),
    ("1.16", {"BAT_CRIT_THR": 0.2}, "BAT_CRIT_THR", "warning", "not below BAT_LOW_THR", LOW),
    ("1.16", {"BAT1_SOURCE": -1}, "BAT1_SOURCE", "error", "no battery", LOW),
    ("1.16", {"BAT1_N_CELLS": 0}, "BAT1_N_CELLS", "error", "never reached", LOW),
    ("1.9.2", {"BAT_N_CELLS": 0}, "BAT_N_CELLS", "error", "never reached", LOW),
    ("1.16", {"BAT1_V_EMPTY": 3.0}, "BAT1_V_EMPTY", "warning", "too late", LOW),
    ("1.16", {"BAT1_V_EMPTY": 4.2}, "BAT1_V_EMPTY", "error", "not below", LOW),
    # circuit breakers and attitude
    ("1.16", {"CBRK_FLIGHTTERM": 121212}, "CBRK_FLIGHTTERM", "warning", "circuit breaker", LOW),
    ("1.9.2", {"CBRK_FLIGHTTERM": 121212}, "CBRK_FLIGHTTERM", "warning", "only warn", LOW),
    ("1.16", {"CBRK_FLIGHTTERM": 1}, "CBRK_FLIGHTTERM", "warning", "neither 0 nor 121212", LOW),
    ("1.16", {"CBRK_SUPPLY_CHK": 894281}, "CBRK_SUPPLY_CHK", "error", "battery", LOW),
    ("1.13", {"CBRK_SUPPLY_CHK": 894281}, "CBRK_SUPPLY_CHK", "warning", "power supply", LOW),
    ("1.13", {"CBRK_VELPOSERR": 201607}, "CBRK_VELPOSERR", "error", "position", LOW),
    ("1.13", {"CBRK_RATE_CTRL": 140253}, "CBRK_RATE_CTRL", "error", "rate controller", LOW),
    ("1.16", {"FD_FAIL_R": 0}, "FD_FAIL_R", "warning", "not detected", LOW),
    ("1.16", {"MPC_TILTMAX_AIR": 70.0}, "MPC_TILTMAX_AIR", "error", "ends the flight", LOW),
    (
        "1.16",
        {"MPC_TILTMAX_AIR": 70.0, "CBRK_FLIGHTTERM": 121212},
        "MPC_TILTMAX_AIR",
        "warning",
        "would end",
        LOW,
    ),
    ("1.16", {"MPC_MAN_TILT_MAX": 65.0}, "MPC_MAN_TILT_MAX", "error", "65 deg", WITH_RC),
    # landing, hover thrust, geofence
    ("1.16", {"COM_FAIL_ACT_T": 5.0}, "COM_FAIL_ACT_T", "warning", "5 s", LOW),
    ("1.16", {"MPC_LAND_SPEED": 1.5}, "MPC_LAND_SPEED", "warning", "1.5 m/s", LOW),
    ("1.16", {"COM_DISARM_LAND": -1.0}, "COM_DISARM_LAND", "warning", "does not disarm", LOW),
    ("1.16", {"COM_DISARM_LAND": 10.0}, "COM_DISARM_LAND", "note", "10 s", LOW),
    ("1.16", {"MPC_THR_HOVER": 0.5}, "MPC_THR_HOVER", "note", "default", LOW),
    ("1.16", {"GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 0.0}, "GF_MAX_HOR_DIST", "note", "no geofence", LOW),
    ("1.16", {"GF_ACTION": 0}, "GF_ACTION", "warning", "no reaction", LOW),
    ("1.16", {"GF_MAX_VER_DIST": 20.0}, "GF_MAX_VER_DIST", "note", "higher than the room", LOW),
    # names
    ("1.16", {"EKF2_AID_MASK": 24}, "EKF2_AID_MASK", "warning", "EKF2_EV_CTRL 11", LOW),
    ("1.14", {"EKF2_AID_MASK": 24}, "EKF2_AID_MASK", "warning", "no effect since PX4 1.14", LOW),
    ("1.16", {"MPC_XY_VEL_P": 0.1}, "MPC_XY_VEL_P", "error", "set MPC_XY_VEL_P_ACC 2", LOW),
    ("1.16", {"BAT_V_EMPTY": 3.6}, "BAT_V_EMPTY", "error", "set BAT1_V_EMPTY 3.6", LOW),
    ("1.16", {"COM_POS_FS_DELAY": 1}, "COM_POS_FS_DELAY", "warning", "remove COM_POS_FS_DELAY", LOW),
    ("1.18", {"COM_RC_OVERRIDE": 1}, "COM_RC_OVERRIDE", "error", "choose a value for MAN_OVERRIDE_SPD", LOW),
    ("1.13", {"EKF2_EV_CTRL": 11}, "EKF2_EV_CTRL", "error", "use EKF2_AID_MASK", LOW),
    ("1.15", {"COM_DLL_EXCEPT": 4}, "COM_DLL_EXCEPT", "error", "added in PX4 1.16", LOW),
    ("1.16", {"ARSP_TAS_GATE": 3}, "ARSP_TAS_GATE", "warning", "removed after PX4 1.10", LOW),
    ("1.16", {"EKF2_EV_CRTL": 11}, "EKF2_EV_CRTL", "error", "write EKF2_EV_CTRL", LOW),
    ("1.9.2", {"EKF2_EV_CRTL": 11}, "EKF2_EV_CRTL", "error", "write EKF2_EV_CTRL", LOW),
    ("1.16", {"com_of_loss_t": 1.0}, "com_of_loss_t", "error", "write COM_OF_LOSS_T", LOW),
    ("1.16", {"MY_OWN": 1}, "MY_OWN", "warning", "module of your own", LOW),
    # types and ranges
    ("1.16", {"EKF2_HGT_REF": 2.5}, "EKF2_HGT_REF", "error", "not an integer", LOW),
    ("1.16", {"EKF2_HGT_REF": 2.0**31}, "EKF2_HGT_REF", "error", "too large", LOW),
    ("1.16", {"MPC_THR_HOVER": float("nan")}, "MPC_THR_HOVER", "error", "finite", LOW),
    ("1.16", {"MPC_THR_HOVER": float("inf")}, "MPC_THR_HOVER", "error", "finite", LOW),
    ("1.16", {"EKF2_EV_CTRL": float("nan")}, "EKF2_EV_CTRL", "error", "finite", LOW),
    ("1.16", {"MPC_THR_HOVER": 0.05}, "MPC_THR_HOVER", "warning", "0.1 to 0.8", LOW),
    ("1.16", {"MPC_LAND_SPEED": 0.1}, "MPC_LAND_SPEED", "warning", "0.6 m/s or more", LOW),
    ("1.16", {"EKF2_EV_CTRL": 31}, "EKF2_EV_CTRL", "warning", "0 to 15", LOW),
    ("1.12", {"NAV_RCL_ACT": 0}, "NAV_RCL_ACT", "warning", "COM_RCL_EXCEPT", LOW),
]


def right(version: str) -> dict[str, float]:
    base = "1.9.2" if version in ("1.9.2", "1.11") else "1.13" if version in ("1.12", "1.13") else "1.16"
    return {name: value for name, value in GOOD[base].items() if name in parameters(version)}


@pytest.mark.parametrize(
    ("version", "change", "name", "severity", "words", "environment"),
    WRONG,
    ids=[f"{w[0]}-{w[1]}" for w in WRONG],
)
def test_wrong_value_is_found(version, change, name, severity, words, environment):
    before = of(
        name,
        check({n: v for n, v in right(version).items() if n not in change}, version, environment=environment),
    )
    findings = of(name, check({**right(version), **change}, version, environment=environment))
    hits = [f for f in findings if words in " ".join((f.problem, f.why, f.fix)) and f.severity == severity]
    assert len(hits) == 1, findings
    assert hits[0] not in before, "the change causes the finding"
    assert repr(hits[0].value) == repr(change[name] if name in change else parameters(version)[name].default)


def test_every_rule_has_a_wrong_value_in_these_tests():
    """Fail for a rule that no case of WRONG triggers."""
    for rule in RULES:
        assert any(
            list(
                rule(
                    CheckContext(
                        given={**right(version), **change},
                        version=Version.parse(version),
                        environment=environment,
                    )
                )
            )
            for version, change, *_, environment in WRONG
        ), rule.__name__


@pytest.mark.parametrize(
    "change", [{"EKF2_EV_CTRL": 0}, {"EKF2_EV_DELAY": 0.0}, {"EKF2_HGT_REF": 1}, {"EKF2_MAG_TYPE": 0}]
)
def test_without_motion_capture_vision_is_not_checked(change):
    assert not set(change) & set(found({**GOOD["1.16"], **change}, "1.16", NO_VISION))


@pytest.mark.parametrize(
    "change", [{"EKF2_GPS_CTRL": 7}, {"SYS_HAS_GPS": 1}, {"COM_ARM_WO_GPS": 0}, {"EKF2_MAG_TYPE": 0}]
)
def test_with_gps_receiver_gps_may_be_fused(change):
    assert not set(change) & set(found({**GOOD["1.16"], **change}, "1.16", WITH_GPS))


def test_with_rc_position_mode_is_a_warning_only():
    values = {**GOOD["1.16"], "COM_RC_IN_MODE": 0, "COM_RCL_EXCEPT": 0, "NAV_RCL_ACT": 3}
    assert found(values, "1.16", WITH_RC) == {}
    assert found({**values, "COM_OBL_RC_ACT": 0}, "1.16", WITH_RC) == {"COM_OBL_RC_ACT": "warning"}


def test_smart_battery_needs_no_cell_count():
    assert not of("BAT1_N_CELLS", check({**GOOD["1.16"], "BAT1_N_CELLS": 0, "BAT1_SOURCE": 1}, "1.16"))


def test_defaults_alone_are_notes():
    for version in versions():
        findings = check({}, version)
        assert findings
        assert {f.severity for f in findings} == {"note"}
        assert all(f"default of PX4 {version}" in f.problem for f in findings)


def test_deprecated_name_at_its_default_is_not_reported():
    assert not of("BAT_V_EMPTY", check({"BAT_V_EMPTY": 3.5}, "1.12"))
    assert "BAT1_V_EMPTY 3.6" in of("BAT_V_EMPTY", check({"BAT_V_EMPTY": 3.6}, "1.12"))[0].fix


def test_errors_come_first():
    order = [
        f.severity for f in check({"EKF2_EV_CTRL": 0, "MPC_THR_HOVER": 0.5, "COM_FAIL_ACT_T": 5.0}, "1.16")
    ]
    assert order == sorted(order, key=["error", "warning", "note"].index) and len(set(order)) == 3


def test_wrong_type_column_is_an_error():
    values = {**GOOD["1.16"]}
    (finding,) = check(
        values, "1.16", environment=LOW, types={"EKF2_EV_CTRL": "FLOAT", "EKF2_HGT_REF": "INT32"}
    )
    assert (finding.severity, finding.name) == ("error", "EKF2_EV_CTRL") and "6 (INT32)" in finding.fix


def test_unknown_version_is_refused():
    with pytest.raises(InputError, match=r"Known: 1\.9"):
        check({}, "1.8")


# --- real vehicles

LOGS = Path(__file__).parents[3] / "shared" / "data" / "thesis"
"""Flight logs of two real PX4 v1.9.2 vehicles, which are not part of the repository."""
needs_logs = pytest.mark.skipif(not LOGS.is_dir(), reason="the flight logs are missing")


@needs_logs
@pytest.mark.parametrize("vehicle", [2, 3])
def test_wrong_values_of_two_real_vehicles_are_found(vehicle):
    source = read_values(LOGS / f"setpoints_real_uav{vehicle}.ulg")
    assert source.version.startswith("1.9.2")
    findings = check(source.values, source.version, environment=Environment(rc=True), types=source.types)
    assert {f.name: f.severity for f in findings} == {
        "COM_OF_LOSS_T": "warning",
        "COM_OBL_RC_ACT": "warning",
        "CBRK_FLIGHTTERM": "warning",
        "EKF2_NOAID_TOUT": "warning",
        "MPC_XY_VEL_P": "warning",
        "MPC_Z_VEL_P": "warning",
        "MPC_Z_VEL_I": "warning",
        "MPC_THR_HOVER": "note",
        "GF_MAX_HOR_DIST": "note",
    }
    assert "0.5 s after the last" in of("COM_OF_LOSS_T", findings)[0].problem
    assert "position mode" in of("COM_OBL_RC_ACT", findings)[0].problem
    assert of("COM_RC_IN_MODE", check(source.values, "1.9.2"))[0].severity == "error", (
        "without RC it would not arm"
    )


@needs_logs
def test_old_parameters_in_a_newer_version_get_their_new_names():
    findings = check(
        read_values(LOGS / "setpoints_real_uav2.ulg").values, "1.16", environment=Environment(rc=True)
    )
    assert "EKF2_EV_CTRL 11, EKF2_GPS_CTRL 0" in of("EKF2_AID_MASK", findings)[0].fix
    assert "EKF2_HGT_REF 3" in of("EKF2_HGT_MODE", findings)[0].fix
    assert "MPC_XY_VEL_P_ACC 4" in of("MPC_XY_VEL_P", findings)[0].fix
    assert of("COM_OF_LOSS_T", findings)[0].severity == "error", "0 prevents OFFBOARD since 1.11"


def test_old_vehicle_without_offboard_failsafe_is_found():
    old = {
        "EKF2_AID_MASK": 24,
        "EKF2_HGT_MODE": 3,
        "COM_OF_LOSS_T": 0.0,
        "COM_OBL_RC_ACT": 0,
        "CBRK_FLIGHTTERM": 121212,
    }
    findings = check(old, "1.9.2", environment=Environment(rc=True))
    assert of("COM_OF_LOSS_T", findings) and "position mode" in of("COM_OBL_RC_ACT", findings)[0].problem
    assert of("EKF2_AID_MASK", check(old, "1.16"))[0].fix


@pytest.mark.parametrize(
    ("version", "change", "name", "severity", "words", "environment"),
    WRONG,
    ids=[f"{w[0]}-{w[1]}" for w in WRONG],
)
def test_fix_of_a_wrong_value_removes_the_finding(version, change, name, severity, words, environment):
    values = {**right(version), **change}
    (finding,) = [
        f
        for f in of(name, check(values, version, environment=environment))
        if words in " ".join((f.problem, f.why, f.fix)) and f.severity == severity
    ]
    wanted = to_set(finding.fix)
    if wanted and finding.name in parameters(version):
        after = check({**values, **wanted}, version, environment=environment)
        assert (finding.name, finding.problem) not in [(f.name, f.problem) for f in after]


# --- random values


@given(
    st.dictionaries(
        st.sampled_from(EVERY_NAME), st.integers(-(2**33), 2**33) | st.floats() | st.integers(-2, 9)
    ),
    st.sampled_from(versions()),
    st.builds(
        Environment,
        vision=st.booleans(),
        gps=st.booleans(),
        rc=st.booleans(),
        latency_ms=st.none() | st.floats(0, 300),
        height_m=st.none() | st.floats(1, 20),
    ),
)
@settings(max_examples=300)
def test_every_finding_of_random_values_has_all_texts(values, version, environment):
    known = parameters(version)
    for f in check(values, version, environment=environment):
        assert f.name in values or f.name in known
        for text in (f.expected, f.problem, f.why, f.fix):
            assert (
                text and text.isprintable() and not re.search(r"None|nan\b.*nan|\{|\}|  |\bset *$", text)
            ), f


WRONG_VALUES = sorted({(name, value) for w in WRONG for name, value in w[1].items() if value == value})


@given(st.sampled_from(versions()), st.sampled_from([LOW, WITH_RC]), st.sampled_from(WRONG_VALUES))
@settings(max_examples=400)
def test_fix_removes_the_finding_in_every_version(version, environment, wrong):
    """Apply the fix of an error or warning, with one parameter wrong: that finding must be gone."""
    name, value = wrong
    for finding in check({name: value}, version, environment=environment):
        wanted = to_set(finding.fix)
        if finding.severity == "note" or not wanted or finding.name != name:
            continue
        after = check({name: value, **wanted}, version, environment=environment)
        assert (finding.severity, finding.name, finding.problem) not in [
            (f.severity, f.name, f.problem) for f in after
        ]


# --- parameters written in a YAML


def test_written_parameters_are_looked_at_one_by_one():
    assert check_written({"MPC_XY_P": 0.9, "EKF2_EV_CTRL": 0}, "1.16") == [], (
        "a rule that needs more than one"
    )
    found = {f.name: f for f in check_written({"MPC_XY_PP": 1.0, "MPC_LAND_SPEED": 0.1}, "1.16")}
    assert (found["MPC_XY_PP"].severity, found["MPC_XY_PP"].expected) == ("error", "perhaps MPC_XY_P")
    assert (found["MPC_LAND_SPEED"].severity, found["MPC_LAND_SPEED"].expected) == (
        "warning",
        "0.6 m/s or more",
    )


def test_finding_line_has_value_expectation_problem_reason_and_fix():
    (finding,) = check_written({"MPC_LAND_SPEED": 0.1}, "1.16")
    assert finding_line(finding) == (
        "warning: MPC_LAND_SPEED: got 0.1, expected 0.6 m/s or more: outside its range. PX4 accepts the value, but was not"
        " designed for it. Choose MPC_LAND_SPEED 0.6 m/s or more; the default is 0.7."
    )
