"""The messages of PX4's simulator API, against bytes written down and against pymavlink."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import hil
from arena.wire.mavlink_frame import parse_frames

floats = st.floats(width=32, allow_nan=False)
int16s, int32s = st.integers(-(2**15), 2**15 - 1), st.integers(-(2**31), 2**31 - 1)
times = st.integers(0, 2**64 - 1)


def many(what: st.SearchStrategy[Any], count: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(what, min_size=count, max_size=count)


def oracle(message: Any, number: int = 0) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=200)
    sender.seq = number
    return bytes(message.pack(sender))


def test_a_sensor_message_has_these_bytes() -> None:
    data = hil.HilSender(1, 200).sensor(
        1_500_000, [1.0, 0, -2.0, 0, 0, 0, 0, 0, 0, 956.0, 0, 488.0, 25.0], 0x1AFF
    )
    assert (
        data.hex()
        == (
            "fd"
            "3e"
            "00"
            "00"
            "00"
            "01"
            "c8"
            "6b0000"  # magic, length, flags, flags, number, system, component, message
            "60e3160000000000"  # time_usec
            "0000803f"
            "00000000"
            "000000c0"  # accel
            "000000000000000000000000"
            "000000000000000000000000"  # gyro, mag
            "00006f44"
            "00000000"
            "0000f443"
            "0000c841"  # pressure, difference, height, temperature
            "ff1a"  # fields_updated; the zeros behind it, and id 0, are left away
        )
        + data[-2:].hex()
    )
    assert data == oracle(
        mavlink.MAVLink_hil_sensor_message(1_500_000, 1, 0, -2, *[0] * 6, 956, 0, 488, 25, 0x1AFF, 0)
    )


@given(times, many(floats, 13), st.integers(0, 2**32 - 1))
def test_sensors_are_packed_as_the_other_codec_packs_them(
    time_usec: int, readings: list[float], fields: int
) -> None:
    expected = mavlink.MAVLink_hil_sensor_message(time_usec, *readings, fields, 0)
    assert hil.HilSender(1, 200).sensor(time_usec, readings, fields) == oracle(expected)


@given(
    times,
    many(floats, 4),
    many(floats, 3),
    many(int32s, 3),
    many(int16s, 3),
    st.integers(0, 2**16 - 1),
    many(int16s, 3),
)
def test_the_truth_is_packed_as_the_other_codec_packs_it(
    time_usec: int,
    q: list[float],
    rates: list[float],
    place: list[int],
    v: list[int],
    speed: int,
    accel: list[int],
) -> None:
    expected = mavlink.MAVLink_hil_state_quaternion_message(
        time_usec, q, *rates, *place, *v, speed, speed, *accel
    )
    found = hil.HilSender(1, 200).state(time_usec, q, rates, (place[0], place[1], place[2]), v, speed, accel)
    assert found == oracle(expected)


def test_sequence_numbers_increase_and_wrap() -> None:
    sender = hil.HilSender(1, 200)
    assert [sender.sensor(0, [0.0] * 13, 1)[4] for _ in range(257)] == [*range(256), 0]


@pytest.mark.parametrize("at", range(10, 70))
def test_a_flipped_bit_is_detected(at: int) -> None:
    data = bytearray(hil.HilSender(1, 200).sensor(1, [1.0] * 13, 0x1FFF))
    assert len(parse_frames(data).frames) == 1
    data[at] ^= 0x10
    assert parse_frames(data).frames == []


def test_gps_and_rc_messages_are_decoded_by_pymavlink() -> None:
    codec, sender = mavlink.MAVLink(None), hil.HilSender(1, 200)
    (gps,) = codec.parse_buffer(
        sender.gps(5_000_000, (387_000_001, -91_000_002, 103_456), (80, 120), [30, -40, 5], 14)
    )
    assert (gps.time_usec, gps.lat, gps.lon, gps.alt) == (5_000_000, 387_000_001, -91_000_002, 103_456)
    assert (gps.eph, gps.epv, gps.vn, gps.ve, gps.vd, gps.fix_type, gps.satellites_visible) == (
        80,
        120,
        30,
        -40,
        5,
        3,
        14,
    )
    assert gps.vel == 50 and gps.cog == 65535
    (rc,) = codec.parse_buffer(sender.sticks(5_000, (1500,) * 7 + (1900,)))
    assert (rc.time_boot_ms, rc.chancount, rc.rssi) == (5_000, 8, 100)
    assert (rc.chan1_raw, rc.chan8_raw, rc.chan9_raw) == (1500, 1900, 65535)
