"""Tests of the table of PX4 parameters by version."""

from __future__ import annotations

import csv
import itertools
from importlib.resources import files

import pytest

from arena.errors import InputError
from arena.params.facts import regenerate
from arena.params.facts.parameter_table import (
    Version,
    is_unreleased,
    parameter,
    parameters,
    versions,
)

MINORS = {version.minor: parameters(version) for version in versions()}


def rows() -> list[dict[str, str]]:
    text = files("arena.params.facts").joinpath("px4_parameters.csv").read_text()
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def minor(text: str) -> int:
    return int(text.split(".")[1])


def test_versions_are_1_9_to_1_18() -> None:
    assert [str(v) for v in versions()] == [f"1.{n}" for n in range(9, 19)]


def test_rows_of_a_name_do_not_overlap_and_differ() -> None:
    for name, group in itertools.groupby(rows(), key=lambda row: row["name"]):
        spans = list(group)
        for first, then in itertools.pairwise(spans):
            assert minor(first["until"]) < minor(then["since"]), name
            if minor(first["until"]) + 1 == minor(then["since"]):
                assert [first[c] for c in regenerate.Fact._fields] != [
                    then[c] for c in regenerate.Fact._fields
                ], name
        assert all(minor(row["since"]) <= minor(row["until"]) for row in spans), name


def test_numbers_have_their_type_and_defaults_are_within_limits() -> None:
    for facts in MINORS.values():
        for p in facts.values():
            assert p.type in ("INT32", "FLOAT")
            for number in (p.default, p.min, p.max):
                assert number is None or isinstance(number, int if p.type == "INT32" else float), p
            assert len(p.name) <= 16, "names in MAVLink have 16 bytes"
            assert (p.min is None or p.default >= p.min) and (p.max is None or p.default <= p.max), p


def test_names_and_defaults_follow_the_version() -> None:
    old, new = parameters("v1.9.2"), parameters("1.16")
    for name in ("EKF2_AID_MASK", "EKF2_HGT_MODE", "COM_POSCTL_NAVL", "COM_OBL_ACT", "MPC_XY_VEL_P"):
        assert name in old, name
    for name in ("EKF2_EV_CTRL", "EKF2_HGT_REF", "COM_OBL_RC_ACT", "MPC_XY_VEL_P_ACC", "COM_FAIL_ACT_T"):
        assert name in new, name
    assert not {"EKF2_AID_MASK", "EKF2_HGT_MODE", "COM_OBL_ACT", "MPC_XY_VEL_P"} & set(new)
    assert not {"EKF2_EV_CTRL", "EKF2_HGT_REF", "MPC_XY_VEL_P_ACC", "COM_FAIL_ACT_T"} & set(old)
    assert (old["EKF2_EV_DELAY"].default, new["EKF2_EV_DELAY"].default) == (175, 0)
    assert (parameters("1.15")["EKF2_EV_CTRL"].default, new["EKF2_EV_CTRL"].default) == (15, 0)
    assert [parameters(v)["COM_OF_LOSS_T"].default for v in ("1.10", "1.11", "1.12", "1.16")] == [
        0,
        0.5,
        1,
        1,
    ]
    assert (new["EKF2_NOAID_TOUT"].unit, new["EKF2_NOAID_TOUT"].min, new["EKF2_NOAID_TOUT"].default) == (
        "us",
        500_000,
        5_000_000,
    )
    assert "COM_POSCTL_NAVL" in new and "COM_POSCTL_NAVL" not in parameters("1.17")


def test_only_1_18_is_unreleased() -> None:
    assert is_unreleased("1.18") and not any(is_unreleased(v) for v in versions() if v.minor < 18)


@pytest.mark.parametrize("text", ["1.8", "1.19", "2.0", "1.16x", "", "main"])
def test_error_of_an_unknown_version_lists_known_ones(text: str) -> None:
    with pytest.raises(InputError, match=r"1\.9, 1\.10, .*1\.18"):
        Version.parse(text)


def test_versions_are_ordered_as_numbers() -> None:
    assert (
        Version.parse("1.9") < Version.parse("v1.9.2") < Version.parse("1.10") < Version.parse("1.16.0-rc1")
    )
    assert (str(Version.parse("v1.9.2")), str(Version.parse("1.16"))) == ("1.9.2", "1.16")


def test_the_table_is_read_once() -> None:
    assert parameters("1.16") is parameters(Version(1, 16, 2))
    assert parameters("1.9") is not parameters("1.16")


@pytest.mark.parametrize("version", versions(), ids=str)
def test_one_parameter_equals_that_of_the_whole_table(version: Version) -> None:
    for name, each in list(parameters(version).items())[::40]:
        assert parameter(name, version) == each


def test_one_parameter_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(KeyError):
        parameter("NOT_A_PARAMETER", versions()[0])
    with pytest.raises(InputError):
        parameter("EKF2_EV_DELAY", Version(1, 99))
