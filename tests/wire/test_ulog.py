"""A ULog's parameters: golden bytes, and the place of what is wrong. Whole files: tests/params/test_params_sources.py."""

from __future__ import annotations

import pytest

from arena.errors import WireError
from arena.wire.ulog import parse_ulog

GOLDEN = bytes.fromhex(
    "554C6F67011235 01 E02E000000000000"  # ULog, version 1, 12 ms
    "2800 42 0000000000000000 0000000000000000"
    + 3
    * "0000000000000000"  # B: flags, no offsets
    + "1C00 49 17 75696E7433325F74207665725F73775F72656C65617365 FF001001"  # I: uint32_t ver_sw_release 1.16.0
    "1900 50 14 696E7433325F7420454B46325F45565F4354524C 0B000000"  # P: int32_t EKF2_EV_CTRL 11
    "1800 50 13 666C6F617420434F4D5F4F465F4C4F53535F54 0000003F"  # P: float COM_OF_LOSS_T 0.5
    "0400 41 00 0000 61"  # A: the definitions end
    "1900 50 14 696E7433325F7420454B46325F45565F4354524C 00000000"  # P: EKF2_EV_CTRL is changed to 0
)


def test_the_golden_bytes_are_read():
    log = parse_ulog(GOLDEN)
    assert log.initial == {"EKF2_EV_CTRL": 11, "COM_OF_LOSS_T": 0.5}
    assert log.changed == {"EKF2_EV_CTRL": 0}
    assert log.types == {"EKF2_EV_CTRL": "INT32", "COM_OF_LOSS_T": "FLOAT"}
    assert log.info == {"ver_sw_release": 0x011000FF} and log.damaged == []


def test_an_error_names_its_byte():
    place = GOLDEN.index(b"\x19\x00P")
    with pytest.raises(WireError, match=f"byte {place}: "):
        parse_ulog(GOLDEN.replace(b"int32_t EKF2", b"int64_t EKF2", 1))
    with pytest.raises(WireError, match=f"byte {place}: .*before its definitions section"):
        parse_ulog(GOLDEN[: place + 10])


def test_damage_after_the_definitions_is_skipped_and_recorded():
    assert parse_ulog(GOLDEN + b"\x02\x00P\xffA").damaged == [len(GOLDEN)]
