"""Parameters on the wire: our bytes are pymavlink's, and every value survives the float it travels in."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_params
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

INT32, REAL32 = 6, 9


@given(st.integers(-(2**31), 2**31 - 1))
@example(-5_000_001)
def test_every_integer_survives_the_float_it_travels_in(value: int) -> None:
    """Signalling NaNs among them, which a copy as a float would change."""
    number, payload = mavlink_params.set_value(1, "P", value, INT32)
    assert number == 23 and payload[:4] == struct.pack("<i", value)
    raw = struct.pack("<i", value) + struct.pack("<HH16sB", 10, 3, b"P", INT32)
    data = Codec(1, 1).frame(22, raw)
    assert mavlink_params.parse_value(data, parse_frames(data).frames[0]) == ("P", value, INT32, 3, 10)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_every_float_survives(value: float) -> None:
    data = Codec(1, 1).pack(mavlink.MAVLink_param_value_message(b"SIXTEEN_LETTERS_", value, REAL32, 10, 3))
    assert mavlink_params.parse_value(data, parse_frames(data).frames[0]) == (
        "SIXTEEN_LETTERS_",
        value,
        REAL32,
        3,
        10,
    )
    assert mavlink_params.fitted(value, REAL32) == value


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (mavlink_params.request_list(7), mavlink.MAVLink_param_request_list_message(7, 1)),
        (mavlink_params.request_read(7, "ABC"), mavlink.MAVLink_param_request_read_message(7, 1, b"ABC", -1)),
        (mavlink_params.request_read(7, 300), mavlink.MAVLink_param_request_read_message(7, 1, b"", 300)),
        (
            mavlink_params.set_value(7, "ABC", 0.25, REAL32),
            mavlink.MAVLink_param_set_message(7, 1, b"ABC", 0.25, REAL32),
        ),
        (mavlink_params.reboot(7), mavlink.MAVLink_command_long_message(7, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0)),
    ],
)
def test_our_frames_are_pymavlinks(message: mavlink_params.Message, expected: Any) -> None:
    assert Codec(252, 200).frame(*message) == Codec(252, 200).pack(expected)


@pytest.mark.parametrize(
    ("kind", "bits", "signed"),
    [(1, 8, False), (2, 8, True), (3, 16, False), (4, 16, True), (5, 32, False), (6, 32, True)],
)
def test_an_integer_type_holds_exactly_its_range(kind: int, bits: int, signed: bool) -> None:
    lowest, highest = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    assert [mavlink_params.fitted(x, kind) for x in (lowest, highest)] == [lowest, highest]
    for beyond in (lowest - 1, highest + 1):
        with pytest.raises(ValueError, match="too large"):
            mavlink_params.fitted(beyond, kind)


def test_a_param_error_without_its_zeros_is_decoded() -> None:
    codec = Codec(1, 1)
    for error, words in ((1, "it does not exist"), (5, "it is read-only"), (0, "error 0"), (99, "error 99")):
        data = codec.pack(mavlink.MAVLink_param_error_message(252, 200, b"ABC", -1, error))
        assert mavlink_params.parse_error(data, parse_frames(data).frames[0]) == ("ABC", error, words)
    data = codec.pack(mavlink.MAVLink_param_value_message(b"ZERO", 0.0, 0, 0, 0))
    assert mavlink_params.parse_value(data, parse_frames(data).frames[0]) == ("ZERO", 0.0, 0, 0, 0)
