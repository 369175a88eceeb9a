"""Two sets of parameters compared: as the autopilot holds them, across versions, against defaults."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.errors import InputError
from arena.params.checks.diff import NO_SETTINGS, Row, against_defaults, diff, no_setting, same
from arena.params.facts.parameter_table import parameters, versions

EVERY_NAME = {name for version in versions() for name in parameters(version)}
VALUES = st.dictionaries(
    st.sampled_from(sorted(parameters("1.16"))),
    st.floats(width=32, allow_infinity=False) | st.integers(-(2**31), 2**31 - 1),
)


def as_float(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def test_floats_are_the_same_that_a_float_of_32_bits_holds_alike():
    assert not diff({"EKF2_EVP_NOISE": 0.01}, {"EKF2_EVP_NOISE": as_float(0.01)}, "1.16")
    assert not diff({"COM_OF_LOSS_T": 1}, {"COM_OF_LOSS_T": 1.0}, "1.16")
    assert diff({"EKF2_EVP_NOISE": 0.01}, {"EKF2_EVP_NOISE": 0.010001}, "1.16") == [
        Row("EKF2_EVP_NOISE", 0.01, 0.010001, "")
    ]


def test_whole_numbers_are_compared_exactly():
    a, b = 2**24, 2**24 + 1
    assert as_float(a) == as_float(b)
    assert diff({"EKF2_NOAID_TOUT": a}, {"EKF2_NOAID_TOUT": b}, "1.16")
    assert not diff({"EKF2_NOAID_TOUT": a}, {"EKF2_NOAID_TOUT": float(a)}, "1.16")
    assert same(float(a), float(b)) and not same(a, b), "without a type, what is written as whole is"


def test_a_name_on_one_side_only_is_told_with_its_side():
    rows = diff({"COM_OF_LOSS_T": 1.0}, {"EKF2_EV_CTRL": 11}, "1.16")
    assert rows == [
        Row("COM_OF_LOSS_T", 1.0, None, "only the first has it"),
        Row("EKF2_EV_CTRL", None, 11, "only the second has it"),
    ]
    assert "PX4 1.16 has no such name" in diff({"FOO": 1.0}, {}, "1.16")[0].note


def test_the_same_setting_of_two_versions_is_no_difference():
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
def test_of_two_versions_the_older_side_is_told_under_the_newer_name(turned):
    old, new = ({"MPC_XY_VEL_P": 0.1}, "1.10"), ({"MPC_XY_VEL_P_ACC": 1.8}, "1.16")
    (a, first), (b, second) = (new, old) if turned else (old, new)
    (row,) = diff(a, b, first, second)
    assert row[:3] == ("MPC_XY_VEL_P_ACC", *((1.8, 2.0) if turned else (2.0, 1.8)))
    assert "MPC_XY_VEL_P 0.1 becomes MPC_XY_VEL_P_ACC 2" in row.note


def test_what_went_without_a_successor_is_told_under_its_old_name():
    (row,) = diff({"COM_POS_FS_DELAY": 1}, {}, "1.15", "1.16")
    assert row[:3] == ("COM_POS_FS_DELAY", 1, None) and "dropped" in row.note


def test_what_stands_under_the_new_name_already_is_compared_itself():
    old = {"COM_OBL_ACT": 0, "COM_OBL_RC_ACT": 5}
    assert diff(old, {"COM_OBL_RC_ACT": 5}, "1.13", "1.16") == []
    assert diff(old, {"COM_OBL_RC_ACT": 4}, "1.13", "1.16") == [Row("COM_OBL_RC_ACT", 5, 4, "")]


def test_a_number_that_came_to_mean_something_else_is_told_with_its_reason():
    (row,) = diff({"EKF2_MAG_TYPE": 3}, {"EKF2_MAG_TYPE": 5}, "1.13", "1.16")
    assert row[:3] == ("EKF2_MAG_TYPE", 0, 5) and "EKF2_MAG_TYPE 3 becomes EKF2_MAG_TYPE 0" in row.note


def test_without_a_version_names_are_names():
    rows = diff({"EKF2_AID_MASK": 24}, {"EKF2_EV_CTRL": 11})
    assert [row.name for row in rows] == ["EKF2_AID_MASK", "EKF2_EV_CTRL"]
    assert [r.name for r in diff({"EKF2_AID_MASK": 24}, {"EKF2_EV_CTRL": 11}, "", "1.16")] == [
        "EKF2_AID_MASK",
        "EKF2_EV_CTRL",
    ]


def test_a_version_that_is_not_known_is_refused():
    with pytest.raises(InputError, match=r"Known: 1\.9"):
        diff({}, {}, "1.8")
    with pytest.raises(InputError, match=r"Known: 1\.9"):
        against_defaults({}, "2.0")


def test_against_defaults_only_what_is_set_otherwise_is_told():
    values = {"COM_OF_LOSS_T": 1.0, "EKF2_EV_CTRL": 11, "EKF2_EVP_NOISE": as_float(0.1), "FOO": 3.0}
    rows = against_defaults(values, "1.16")
    assert rows == [Row("EKF2_EV_CTRL", 11, 0, ""), Row("FOO", 3.0, None, "PX4 1.16 has no such name")]
    assert [r.name for r in against_defaults(values, "1.15")] == ["EKF2_EV_CTRL", "FOO"]


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
def test_what_nobody_sets_is_left_out_unless_asked_for(name):
    assert no_setting(name)
    assert diff({name: 1}, {name: 2}, "1.9") == []
    assert [row.name for row in diff({name: 1}, {name: 2}, "1.9", every=True)] == [name]
    assert against_defaults({name: 77}, "1.9") == []
    assert [row.name for row in against_defaults({name: 77}, "1.9", every=True)] == [name]


@pytest.mark.parametrize(
    "name", ["MAV_TYPE", "SYS_AUTOSTART", "SENS_BOARD_ROT", "RC_MAP_ROLL", "BAT1_V_DIV", "COM_OF_LOSS_T"]
)
def test_what_people_set_is_shown(name):
    assert not no_setting(name)
    assert diff({name: 1}, {name: 2}, "1.16")


def test_each_pattern_of_no_setting_meets_a_name_and_has_a_reason():
    for kept in NO_SETTINGS:
        assert kept.why
        assert any(no_setting(name) == kept.why for name in [*EVERY_NAME, "_HASH_CHECK"]), kept


@given(VALUES)
def test_nothing_differs_from_itself(values):
    assert diff(values, values, "1.16", every=True) == []
    assert diff(values, values, every=True) == []


@given(VALUES, VALUES)
def test_the_other_way_round_the_same_names_differ(a, b):
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
