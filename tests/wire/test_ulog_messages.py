"""Encoded ULog messages: golden bytes, and pyulog as an independent reader."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from pyulog import ULog

from arena.wire import ulog_messages as ulog
from arena.wire.ulog import parse_ulog

FIELDS = "uint64_t timestamp;double lat;float[3] xyz;int32_t count;uint16_t flags;bool good;"


def log(data: bytes = b"", params: bytes = b"") -> bytes:
    return b"".join(
        (
            ulog.file_header(12_000),
            ulog.information({"sys_name": "name", "ver_sw_release": 0x011000FF}),
            ulog.topic_format("topic", FIELDS),
            params,
            ulog.subscriptions(["topic"]),
            data,
        )
    )


def record(**values: object) -> bytes:
    found = np.zeros(1, ulog.record_type(FIELDS))
    ulog.set_record_head(found, 0)
    for name, value in values.items():
        found[name] = value
    return found.tobytes()


def test_header_and_parameters_have_the_golden_bytes() -> None:
    messages = ulog.ParameterMessages({"A_B": "int32", "C_D": "float"}, {"A_B": 3, "C_D": 0.5})
    assert ulog.file_header(12_000) == bytes.fromhex(
        "554C6F67011235 01 E02E000000000000 2800 42 01" + "00" * 39
    )
    assert messages.all({"A_B": 3, "C_D": 1.0}) == bytes.fromhex(
        "1000 50 0B 696E7433325F7420 415F42 03000000"  # P: int32_t A_B 3
        "0E00 50 09 666C6F617420 435F44 0000803F"  # P: float C_D 1.0
        "0F00 51 03 09 666C6F617420 435F44 0000003F"  # Q: its default 0.5, of the system and of the airframe
    )


def test_pyulog_reads_every_field() -> None:
    given = {"timestamp": 5, "lat": 47.25, "xyz": (1.5, -2.5, 3.5), "count": -7, "flags": 65535, "good": 1}
    read = ULog(io.BytesIO(log(record(**given) + ulog.text(4, 6, "words") + ulog.gap(1.5))))
    (topic,) = read.data_list
    assert {name: values[0] for name, values in topic.data.items()} == {
        **{"timestamp": 5, "lat": 47.25, "xyz[0]": 1.5, "xyz[1]": -2.5, "xyz[2]": 3.5},
        **{"count": -7, "flags": 65535, "good": 1},
    }
    assert [(m.log_level_str(), m.timestamp, m.message) for m in read.logged_messages] == [
        ("WARNING", 6, "words")
    ]
    assert [gap.duration for gap in read.dropouts] == [1500]
    assert read.msg_info_dict == {"sys_name": "name", "ver_sw_release": 0x011000FF}
    assert read.start_timestamp == 12_000


def test_values_and_defaults_of_parameters_are_read_by_pyulog_and_by_arena() -> None:
    messages = ulog.ParameterMessages({"A_B": "int32", "C_D": "float"}, {"A_B": 3, "C_D": 0.5})
    data = log(messages.value("A_B", 9), messages.all({"A_B": 4, "C_D": 0.5}))
    read, own = ULog(io.BytesIO(data)), parse_ulog(data)
    assert read.initial_parameters == own.initial == {"A_B": 4, "C_D": 0.5}
    assert (
        [(name, value) for _, name, value in read.changed_parameters]
        == [("A_B", 9)]
        == list(own.changed.items())
    )
    assert read.get_default_parameters(0) == read.get_default_parameters(1) == {"A_B": 3}


@pytest.mark.parametrize("fields", [FIELDS, "uint64_t timestamp;", "uint64_t timestamp;uint8_t a;"])
def test_padding_of_a_format_fills_eight_bytes(fields: str) -> None:
    size, _, text = (
        struct.unpack_from("<HB", ulog.topic_format("t", fields)),
        None,
        ulog.topic_format("t", fields)[3:],
    )
    assert size[0] == len(text)
    kind = ulog.record_type(text.decode().partition(":")[2])
    assert (kind.itemsize - 5) % 8 == 0


def test_long_text_is_cut_between_two_characters() -> None:
    raw = ulog.text(6, 0, "é" * 100)[12:]
    assert len(raw) == 126 and raw.decode() == "é" * 63
