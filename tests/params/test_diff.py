"""Tests of the comparison: values as the autopilot holds them, two versions, defaults."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.errors import InputError
from arena.params.checks.diff import (
    NOT_SETTINGS,
    Difference,
    diff,
    exclusion_reason,
    same,
)
from arena.params.facts.parameter_table import parameters, versions

EVERY_NAME = {name for version in versions() for name in parameters(version)}
VALUES = st.dictionaries(
    st.sampled_from(sorted(parameters("1.16"))),
    st.floats(width=32, allow_infinity=False) | st.integers(-(2**31), 2**31 - 1),
)


def as_float(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def test_floats_are_compared_in_32_bits():
    assert not diff({"EKF2_EVP_NOISE": 0.01}, {"EKF2_EVP_NOISE": as_float(0.01)}, "1.16")
    assert not diff({"COM_OF_LOSS_T": 1}, {"COM_OF_LOSS_T": 1.0}, "1.16")
    assert diff({"EKF2_EVP_NOISE": 0.01}, {"EKF2_EVP_NOISE": 0.010001}, "1.16") == [
        Difference("EKF2_EVP_NOISE", 0.01, 0.010001, "")
    ]


def test_whole_numbers_are_compared_exactly():
    a, b = 2**24, 2**24 + 1
    assert as_float(a) == as_float(b)
    assert diff({"EKF2_NOAID_TOUT": a}, {"EKF2_NOAID_TOUT": b}, "1.16")
    assert not diff({"EKF2_NOAID_TOUT": a}, {"EKF2_NOAID_TOUT": float(a)}, "1.16")
    assert same(float(a), float(b)) and not same(a, b), "without a type, two int are compared exactly"


def test_parameter_on_one_side_is_listed_with_its_side():
    rows = diff({"COM_OF_LOSS_T": 1.0}, {"EKF2_EV_CTRL": 11}, "1.16")
    assert rows == [
        Difference("COM_OF_LOSS_T", 1.0, None, "only in the first"),
        Difference("EKF2_EV_CTRL", None, 11, "only in the second"),
    ]
    assert "PX4 1.16 has no such parameter" in diff({"FOO": 1.0}, {}, "1.16")[0].note


def test_same_setting_in_two_versions_is_no_difference():
    old = {"EKF2_AID_MASK": 24, "EKF2_HGT_MODE": 3, "COM_RC_IN_MODE": 0, "BAT_N_CELLS": 4}
    new = {
        "EKF2_EV_CTRL": 11,
        "EKF2_GPS_CTRL": 0,
        "EKF2_OF_CTRL": 0,
        "EKF2_DRAG_CTRL": 0,
        "EKF2_IMU_CTRL": 7,
        "EKF2_HGT_REF": 3,
        "EKF2_BARO_CTRL": 0,
        "COM_RC_IN_MODE": 0,
        "BAT1_N_CELLS": 4,
    }
    assert diff(old, new, "1.9.2", "1.16") == []
    assert diff(new, old, "1.16", "1.9.2") == []


@pytest.mark.parametrize("turned", [False, True])
def test_older_side_is_shown_under_the_newer_name(turned):
    old, new = ({"MPC_XY_VEL_P": 0.1}, "1.10"), ({"MPC_XY_VEL_P_ACC": 1.8}, "1.16")
    (a, first), (b, second) = (new, old) if turned else (old, new)
    (row,) = diff(a, b, first, second)
    assert row[:3] == ("MPC_XY_VEL_P_ACC", *((1.8, 2.0) if turned else (2.0, 1.8)))
    assert "MPC_XY_VEL_P 0.1 becomes MPC_XY_VEL_P_ACC 2" in row.note


def test_removed_parameter_is_shown_under_its_old_name():
    (row,) = diff({"COM_POS_FS_DELAY": 1}, {}, "1.15", "1.16")
    assert row[:3] == ("COM_POS_FS_DELAY", 1, None) and "dropped" in row.note


def test_value_given_under_the_new_name_is_compared():
    old = {"COM_OBL_ACT": 0, "COM_OBL_RC_ACT": 5}
    assert diff(old, {"COM_OBL_RC_ACT": 5}, "1.13", "1.16") == []
    assert diff(old, {"COM_OBL_RC_ACT": 4}, "1.13", "1.16") == [Difference("COM_OBL_RC_ACT", 5, 4, "")]


def test_converted_number_has_its_reason():
    (row,) = diff({"EKF2_MAG_TYPE": 3}, {"EKF2_MAG_TYPE": 5}, "1.13", "1.16")
    assert row[:3] == ("EKF2_MAG_TYPE", 0, 5) and "EKF2_MAG_TYPE 3 becomes EKF2_MAG_TYPE 0" in row.note


def test_without_a_version_nothing_is_converted():
    rows = diff({"EKF2_AID_MASK": 24}, {"EKF2_EV_CTRL": 11})
    assert [row.name for row in rows] == ["EKF2_AID_MASK", "EKF2_EV_CTRL"]
    assert [r.name for r in diff({"EKF2_AID_MASK": 24}, {"EKF2_EV_CTRL": 11}, "", "1.16")] == [
        "EKF2_AID_MASK",
        "EKF2_EV_CTRL",
    ]


def test_unknown_version_is_refused():
    with pytest.raises(InputError, match=r"Known: 1\.9"):
        diff({}, {}, "1.8")


@pytest.mark.parametrize(
    "name",
    [
        "CAL_ACC0_XOFF",
        "CAL_MAG1_ROT",
        "CAL_GYRO0_PRIO",
        "LND_FLIGHT_T_HI",
        "LND_FLIGHT_T_LO",
        "COM_FLIGHT_UUID",
        "MAV_SYS_ID",
        "SYS_AUTOCONFIG",
        "RC1_TRIM",
        "TC_A0_ID",
        "EKF2_MAGBIAS_X",
        "_HASH_CHECK",
    ],
)
def test_parameter_that_is_no_setting_is_left_out(name):
    assert exclusion_reason(name)
    assert diff({name: 1}, {name: 2}, "1.9") == []
    assert [row.name for row in diff({name: 1}, {name: 2}, "1.9", include_excluded=True)] == [name]


@pytest.mark.parametrize(
    "name", ["MAV_TYPE", "SYS_AUTOSTART", "SENS_BOARD_ROT", "RC_MAP_ROLL", "BAT1_V_DIV", "COM_OF_LOSS_T"]
)
def test_setting_is_compared(name):
    assert not exclusion_reason(name)
    assert diff({name: 1}, {name: 2}, "1.16")


def test_each_exclusion_matches_a_name_and_has_a_reason():
    for excluded in NOT_SETTINGS:
        assert excluded.why
        assert any(exclusion_reason(name) == excluded.why for name in [*EVERY_NAME, "_HASH_CHECK"]), excluded


@given(VALUES)
def test_values_do_not_differ_from_themselves(values):
    assert diff(values, values, "1.16", include_excluded=True) == []
    assert diff(values, values, include_excluded=True) == []


@given(VALUES, VALUES)
def test_swapped_sides_give_the_same_names(a, b):
    there, back = diff(a, b, "1.16"), diff(b, a, "1.16")
    assert [(r.name, repr(r.a), repr(r.b)) for r in there] == [(r.name, repr(r.b), repr(r.a)) for r in back]
    assert [r.name for r in there] == sorted(r.name for r in there)


@given(
    st.dictionaries(st.sampled_from(sorted(EVERY_NAME)), st.integers(-5, 300)),
    *2 * [st.sampled_from(versions())],
)
def test_any_two_versions_can_be_compared(values, first, second):
    for row in diff(values, {}, first, second):
        assert row.b is None
