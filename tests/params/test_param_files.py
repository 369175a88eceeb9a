"""Tests of the readers of parameter files: values, types, version; one line per wrong place."""

from __future__ import annotations

import io
import re
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyulog import ULog

from arena.errors import InputError
from arena.params.param_files import ParamSource, read_values
from tests.params.ulog_bytes import (
    DATA,
    HEADER,
    SYNC,
    definitions,
    flags,
    keyed,
    logged,
    message,
    parameter,
    ulog,
)

VALUES = {"COM_OF_LOSS_T": 1.0, "EKF2_EV_CTRL": 11, "EKF2_EVP_NOISE": 0.01, "NAV_AH_LON": -1518423250}
SAVED = """# Onboard parameters for Vehicle 3
#
# Stack: PX4 Pro
# Version: 1.16.0 dev
#
# Vehicle-Id Component-Id Name Value Type
3\t1\tEKF2_EV_CTRL\t11\t6
3\t1\tEKF2_EV_DELAY\t20.000000000000000000\t9
3\t154\tCAM_MODE\t2\t6
"""


def read(tmp_path, data: bytes, name: str = "given.params") -> ParamSource:
    (tmp_path / name).write_bytes(data)
    return read_values(tmp_path / name)


def refused(tmp_path, data: bytes, name: str = "given.params") -> list[str]:
    """Return the lines of the error message."""
    with pytest.raises(InputError) as error:
        read(tmp_path, data, name)
    assert error.value.exit_code == 2
    assert error.value.problems, "every problem has its place"
    lines = str(error.value).split("\n")
    assert len(lines) == len(error.value.problems) <= 21
    for line in lines:
        assert re.fullmatch(r".*given\.\w+(:\d+)?: .+", line) and line.isprintable() and len(line) < 600, line
        assert not re.search(r"Traceback|Error\(|Errno|codec|struct", line), line
    return lines


# --- what is read


def test_file_of_qgroundcontrol_has_types_and_a_version(tmp_path):
    source = read(tmp_path, SAVED.encode())
    assert source.values == {"EKF2_EV_CTRL": 11, "EKF2_EV_DELAY": 20.0}
    assert source.types == {"EKF2_EV_CTRL": "INT32", "EKF2_EV_DELAY": "FLOAT"}
    assert (source.version, source.origin) == ("1.16.0", str(tmp_path / "given.params"))


@pytest.mark.parametrize(
    "data",
    [
        SAVED.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + SAVED.encode(),
        SAVED.replace("\t", "   ").encode(),
        SAVED.rstrip("\n").encode(),
        SAVED.replace("3\t1", "\n\n  3\t1").encode(),
    ],
)
def test_line_ends_byte_order_mark_and_blanks_are_accepted(tmp_path, data):
    assert read(tmp_path, data).values == {"EKF2_EV_CTRL": 11, "EKF2_EV_DELAY": 20.0}


def test_plain_lines_have_no_types_and_no_version(tmp_path):
    source = read(tmp_path, b"COM_OF_LOSS_T 1\nEKF2_EVP_NOISE 1e-2\n# Version: new\n")
    assert (source.values, source.types, source.version) == (
        {"COM_OF_LOSS_T": 1, "EKF2_EVP_NOISE": 0.01},
        {},
        "",
    )


def test_ulog_has_values_types_version_and_hardware(tmp_path):
    source = read(tmp_path, ulog(**VALUES), "given.ulg")
    assert source.values == pytest.approx(VALUES)
    assert {name for name, kind in source.types.items() if kind == "INT32"} == {"EKF2_EV_CTRL", "NAV_AH_LON"}
    assert source.version == "1.16.0" and "PX4_FMU" in source.origin and source.notes == ()


def test_ulog_is_recognised_by_its_first_bytes(tmp_path):
    assert read(tmp_path, ulog(**VALUES), "given.params").values == pytest.approx(VALUES)


def test_change_in_flight_is_used_and_noted(tmp_path):
    data = ulog(**VALUES) + parameter("EKF2_EV_CTRL", 0) + DATA + parameter("EKF2_EV_CTRL", 3) + DATA
    source = read(tmp_path, data)
    assert source.values["EKF2_EV_CTRL"] == 3
    assert source.notes == ("EKF2_EV_CTRL changed in flight from 11 to 3",)


def test_log_that_ends_in_flight_is_read(tmp_path):
    whole = ulog(**VALUES) + DATA
    for end in range(len(definitions(**VALUES) + logged()), len(whole)):
        assert read(tmp_path, whole[:end]).values == pytest.approx(VALUES)


def test_damaged_part_is_skipped_and_noted(tmp_path):
    source = read(tmp_path, ulog(**VALUES) + b"\0" * 40 + SYNC + parameter("EKF2_EV_CTRL", 3))
    assert source.values["EKF2_EV_CTRL"] == 3 and any("damaged" in note for note in source.notes)
    source = read(tmp_path, ulog(**VALUES) + b"\0" * 40)
    assert source.values["EKF2_EV_CTRL"] == 11 and any("damaged" in note for note in source.notes)


def test_appended_data_is_read_from_its_offset(tmp_path):
    head = HEADER + flags(incompatible=1, appended=1) + parameter("EKF2_EV_CTRL", 11) + logged()
    cut = struct.pack("<HB", 500, ord("D")) + bytes(3)
    offset = len(head) + len(cut)
    data = head.replace(flags(incompatible=1, appended=1), flags(incompatible=1, appended=offset)) + cut
    assert read(tmp_path, data + parameter("EKF2_EV_CTRL", 8)).values == {"EKF2_EV_CTRL": 8}


@given(
    st.dictionaries(
        st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True),
        st.integers(-(2**31), 2**31 - 1) | st.floats(width=32, allow_nan=False, allow_infinity=False),
        min_size=1,
    )
)
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_ulog_values_equal_those_of_pyulog(tmp_path, values):
    data = ulog(**values)
    theirs = ULog(io.BytesIO(data))
    ours = read(tmp_path, data)
    assert ours.values == theirs.initial_parameters
    assert "v" + ours.version == theirs.get_version_info_str()


# --- what is refused: text

NAMES = ["MPC-XY", "A.B", "EKF2_EV_CTRL_LONG", "É", "A/B", "A:", "=", "'A'", '"B"', "A,1,", "(A)", "A;"]
NUMBERS = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "Infinity",
    "x",
    "1,5",
    "0x10",
    "1_000",
    "1e",
    "--1",
    "1.2.3",
    "true",
    "None",
    "½",
    "٣",
    "1f",
    "1e400",
    "5e38",
    "-4e38",
    "+-1",
    ".",
    "e5",
    "1/2",
    "10%",
]
TYPES = ["0", "11", "77", "-6", "INT32", "6.0", "x", "\uff16"]
COLUMNS = [
    "A",
    "1 1 A",
    "1 1 A 2",
    "1 1 A 2 6 7",
    "1 x A 2 6",
    "x 1 A 2 6",
    "-1 1 A 2 6",
    "1 1.0 A 2 6",
    "1234 1 A 2 6",
    "A = 1",
    "A,1",
    "A=1",
    "<parameter name='A'>",
    "{",
    '{"A": 1}',
    "- A: 1",
    "A\t1\t# ok",
    "1,1,A,2,6",
]
WHOLE = ["2.5", "2.0", "1e3", "2147483648", "-2147483649", "99999999999999999999", "nan"]

BAD_LINES = [
    *(f"{name} 1" for name in NAMES),
    *(f"1\t1\t{name}\t1\t6" for name in NAMES),
    *(f"A {number}" for number in NUMBERS),
    *(f"1\t1\tA\t{number}\t9" for number in NUMBERS),
    *(f"1\t1\tA\t1\t{kind}" for kind in TYPES),
    *COLUMNS,
    *(f"1\t1\tA\t{number}\t6" for number in WHOLE),
    "GOOD 2",
    "1\t1\tGOOD\t1\t6",
]


@pytest.mark.parametrize("line", BAD_LINES)
def test_wrong_line_is_reported_with_its_number(tmp_path, line):
    (line_text,) = refused(tmp_path, f"# a comment\nGOOD 1\n{line}\nFINE 2\n".encode())
    assert f"{tmp_path / 'given.params'}:3: " in line_text


def test_up_to_twenty_wrong_lines_are_reported(tmp_path):
    lines = refused(tmp_path, b"A 1\nB x\nC y\n1\t1\tD\t3000000000\t6\nE z\n")
    assert [int(re.findall(r":(\d+): ", line)[0]) for line in lines] == [2, 3, 4, 5]
    assert all(field in line for field, line in zip("BCDE", lines, strict=True))
    lines = refused(tmp_path, b"A x\n" * 300)
    assert len(lines) == 21 and "280 more" in lines[-1]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no parameters"),
        (b"\n\n", "no parameters"),
        (b"# only a comment\n", "no parameters"),
        (b"1\t154\tCAM_MODE\t2\t6\n", "no parameters"),
        (b"A 1\nB \xff\n", ":2: got the byte 0xff"),
        (b"\x89PNG\r\n\x1a\n", "0x89"),
        (b"A 1\n\0\0\0", ":2: got a zero byte"),
        ("A 1".encode("utf-16"), "0xff"),
        (b"PK\x03\x04" + bytes(20), "zero"),
        (b"A 1\n" * 1_500_000, "6000000 bytes"),
    ],
)
def test_file_without_parameters_is_refused(tmp_path, data, words):
    assert words in refused(tmp_path, data)[0]


def test_missing_file_and_folder_are_refused(tmp_path):
    (tmp_path / "folder").mkdir()
    for name, words in (
        ("folder", "this is not a file"),
        ("absent", "does not exist"),
        ("a\0b", "cannot be read"),
        ("n" * 300, ""),
    ):
        with pytest.raises(InputError) as error:
            read_values(tmp_path / name)
        assert words in str(error.value) and "\n" not in str(error.value)


# --- what is refused: logs

WHOLE_HEAD = definitions(EKF2_EV_CTRL=11, COM_OF_LOSS_T=1.0)
BAD_LOGS = {
    "empty": b"",
    "text": b"EKF2_EV_CTRL 11\n",
    "half a header": HEADER[:9],
    "another format": b"ULog\x01\x12\x36" + bytes(20),
    "no parameters": HEADER + flags() + logged(),
    "header only": HEADER,
    "a newer kind": HEADER + flags(incompatible=2) + parameter("A", 1) + logged(),
    "short flags": HEADER + message("B", bytes(10)) + parameter("A", 1) + logged(),
    "no message": HEADER + flags() + b"\0" * 30,
    "unknown message": HEADER + flags() + message("z", b"1234") + logged(),
    "long message": HEADER + flags() + struct.pack("<HB", 60_000, ord("P")) + b"abc",
    "name too long": HEADER + parameter("A_NAME_OF_SEVENTE", 1) + logged(),
    "name of another script": HEADER + parameter("É", 1) + logged(),
    "no name": HEADER + keyed("P", "float ", bytes(4)) + logged(),
    "no type": HEADER + keyed("P", "A", bytes(4)) + logged(),
    "double": HEADER + keyed("P", "double A", bytes(8)) + logged(),
    "text value": HEADER + keyed("P", "char[4] A", b"1234") + logged(),
    "unsigned": HEADER + keyed("P", "uint32_t A", bytes(4)) + logged(),
    "short value": HEADER + keyed("P", "float A", b"123") + logged(),
    "long value": HEADER + keyed("P", "int32_t A", bytes(5)) + logged(),
    "long key": HEADER + message("P", b"\xf0float A") + logged(),
    **{f"cut at byte {end}": WHOLE_HEAD[:end] for end in range(len(HEADER) + 1, len(WHOLE_HEAD), 4)},
}


@pytest.mark.parametrize("data", BAD_LOGS.values(), ids=BAD_LOGS)
def test_log_without_all_parameters_is_refused(tmp_path, data):
    (line_text,) = refused(tmp_path, data, "given.ulg")
    assert re.search(r"byte \d+|ULog|no parameters|header", line_text)


# --- random files


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_random_file_is_read_or_refused(tmp_path, data):
    try:
        assert read(tmp_path, data).values
    except InputError:
        refused(tmp_path, data)


@given(
    st.lists(st.tuples(st.integers(16, len(ulog(**VALUES)) - 1), st.integers(0, 255)), max_size=4),
    st.integers(0, 60),
)
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_log_with_wrong_bytes_is_read_or_refused(tmp_path, flips, cut):
    data = bytearray(ulog(**VALUES))
    for place, byte in flips:
        data[place] = byte
    try:
        assert read(tmp_path, bytes(data[: len(data) - cut]), "given.ulg").values
    except InputError:
        refused(tmp_path, bytes(data[: len(data) - cut]), "given.ulg")
