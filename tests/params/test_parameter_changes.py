"""Tests of parameters that PX4 removed, renamed or gave another meaning."""

from __future__ import annotations

import pytest

from arena.errors import InputError
from arena.params.facts.parameter_changes import CHANGES, Change, convert, successors
from arena.params.facts.parameter_table import parameters, versions

MINORS = {version.minor: parameters(version) for version in versions()}


@pytest.mark.parametrize("change", CHANGES, ids=lambda c: f"{c.old}-{c.since}")
def test_change_matches_the_parameter_table(change: Change) -> None:
    before, after = MINORS[change.since - 1], MINORS[change.since]
    assert change.old in before
    assert (change.old in after) == change.still_defined
    assert set(change.new) <= set(after)
    assert change.note and change.source
    if change.conversion is not None:
        for value in {before[change.old].default, 0, 1, 2, 3}:
            assert set(change.conversion(value)) <= set(change.new)


def test_vision_of_1_9_is_converted_to_1_16() -> None:
    converted = convert({"EKF2_AID_MASK": 24, "EKF2_HGT_MODE": 3, "EKF2_EV_DELAY": 20}, "1.9", "1.16")
    wanted = {
        "EKF2_EV_CTRL": 11,
        "EKF2_GPS_CTRL": 0,
        "EKF2_HGT_REF": 3,
        "EKF2_BARO_CTRL": 0,
        "EKF2_EV_DELAY": 20,
    }
    assert {name: converted.values[name] for name in wanted} == wanted
    assert set(converted.values) <= set(parameters("1.16"))
    assert any("EKF2_AID_MASK 24 becomes EKF2_EV_CTRL 11" in note for note in converted.notes)


def test_dropped_values_have_a_note() -> None:
    converted = convert({"COM_POSCTL_NAVL": 1, "COM_RC_IN_MODE": 1, "SENS_BOARD_ROT": 26}, "1.9", "1.17")
    assert converted.values == {}
    assert len(converted.notes) == 3 and all("is dropped" in note for note in converted.notes)


def test_value_given_under_the_new_name_stays() -> None:
    converted = convert({"COM_OBL_ACT": 0, "COM_OBL_RC_ACT": 5}, "1.13", "1.14")
    assert converted.values == {"COM_OBL_RC_ACT": 5}
    assert any("COM_OBL_RC_ACT stays 5" in note for note in converted.notes)


def test_numbers_change_with_their_meaning() -> None:
    assert convert({"COM_OBL_ACT": 0}, "1.9", "1.16").values == {"COM_OBL_RC_ACT": 4}
    assert convert({"NAV_RCL_ACT": 0}, "1.11", "1.12").values == {"COM_RCL_EXCEPT": 7}
    assert convert({"MPC_XY_VEL_P": 0.09}, "1.10", "1.11").values["MPC_XY_VEL_P_ACC"] == pytest.approx(1.8)
    assert convert({"SENS_BOARD_ROT": 4}, "1.9", "1.16").values == {"SENS_BOARD_ROT": 4}


def test_successors_pass_through_all_versions() -> None:
    assert successors("EKF2_HGT_MODE", "1.9", "1.16") == (
        "EKF2_HGT_REF",
        "EKF2_BARO_CTRL",
        "EKF2_RNG_CTRL",
    )
    assert successors("BAT_N_CELLS", "1.9", "1.12") == ("BAT1_N_CELLS",)
    assert successors("COM_POSCTL_NAVL", "1.16", "1.17") == ()
    assert successors("MPC_XY_P", "1.9", "1.18") == ("MPC_XY_P",)
    with pytest.raises(InputError, match="cannot be converted to the older"):
        convert({}, "1.16", "1.9")
