"""QGroundControl's parameter files: parsing, refused lines, and writing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.errors import WireError
from arena.wire.qgc_params import INT32, REAL32, format_params, parse_params

SAVED = """# Onboard parameters for Vehicle 1
#
# Vehicle-Id Component-Id Name Value Type
1\t1\tBAT1_N_CELLS\t4\t6
1\t1\tEKF2_EV_DELAY\t20.000000000000000000\t9
1\t154\tCAM_MODE\t2\t6
1\t1\tMPC_XY_P\t0.949999988079071045\t9
"""


def test_a_file_of_qgroundcontrol_is_read_without_other_components():
    found = parse_params(SAVED)
    assert found == {"BAT1_N_CELLS": 4, "EKF2_EV_DELAY": 20.0, "MPC_XY_P": pytest.approx(0.95)}
    assert isinstance(found["BAT1_N_CELLS"], int)
    assert isinstance(found["EKF2_EV_DELAY"], float)


def test_plain_lines_are_read():
    assert parse_params("\nSYS_HITL 1\n  # by hand\nEKF2_EVP_NOISE 0.01\n") == {
        "SYS_HITL": 1,
        "EKF2_EVP_NOISE": 0.01,
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A 1\nB 2\nA 3", ("line 3", "A is already on line 1")),
        ("A 1\nB nan", ("line 2", "nan")),
        ("B inf", ("line 1", "finite")),
        ("B x", ("line 1", "'x' is not a number")),
        ("A 1\n\n1 1 B", ("line 3", "3 columns")),
        ("1\t1\tB\t2.5\t6", ("line 1", "integer")),
        ("1\t1\tB\t2.5\t77", ("line 1", "type")),
        ("1\tx\tB\t2.5\t9", ("line 1", "component")),
        ("MPC-XY 1", ("line 1", "name")),
        ("A_NAME_OF_SEVENTEEN 1", ("line 1", "16")),
        ("A = 1", ("line 1", "3 columns")),
    ],
)
def test_an_invalid_parameter_file_is_refused_with_its_line(text, words):
    with pytest.raises(WireError) as error:
        parse_params(text)
    assert all(w in str(error.value) for w in words)


def test_a_written_file_has_types_and_a_header():
    values = {"SYS_HITL": 1, "MPC_XY_P": 0.95, "MPC_VEL": 2}
    text = format_params(values, 7, header=["How to load it", ""], types={"MPC_VEL": REAL32})
    lines = ["# How to load it", "#", f"7\t1\tSYS_HITL\t1\t{INT32}", f"7\t1\tMPC_XY_P\t0.95\t{REAL32}"]
    assert text == "\n".join([*lines, f"7\t1\tMPC_VEL\t2\t{REAL32}\n"])


@given(
    st.dictionaries(
        st.text("ABCXYZ0189_", min_size=1, max_size=16),
        st.integers(-(2**31), 2**31 - 1) | st.floats(width=32, allow_nan=False, allow_infinity=False),
        max_size=12,
    )
)
def test_written_parameters_are_read_back(values):
    read = parse_params(format_params(values, 3))
    assert read == pytest.approx(values, rel=1e-7)
