"""PX4's messages that pymavlink's dialect lacks: sizes, contents, and PX4's checksum."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import pytest

from arena.wire import px4_messages
from arena.wire.mavlink_frame import SEEDS, pack_frame, parse_frames
from arena.wire.mavlink_layout import layout, payload_bytes


def sender():
    return SimpleNamespace(seq=254, srcSystem=3, srcComponent=1)


@pytest.mark.parametrize(("text", "crc"), [(b"", 0), (b"123456789", 0x2DFD2D88), (b"\0\0\0\0", 0)])
def test_checksum_is_that_of_px4(text, crc):
    assert px4_messages.px4_crc32(text) == crc
    assert px4_messages.px4_crc32(text[3:], px4_messages.px4_crc32(text[:3])) == crc


def test_tables_of_fields_have_the_sizes_of_the_messages():
    assert {msgid: payload_bytes(msgid) for msgid in px4_messages.FIELDS} == {
        290: 46,
        291: 57,
        411: 3,
        436: 9,
    }
    assert layout(px4_messages.ESC_INFO)["info"] == ("B", 45, 1)
    assert layout(px4_messages.ESC_STATUS)["current"] == ("f", 40, 4)


def test_event_request_is_read_and_its_target_is_known():
    data = pack_frame(412, struct.pack("<2H2B", 7, 9, 3, 1), sender(), SEEDS[412])
    (frame,) = parse_frames(data).frames
    assert (frame.target_sys, frame.target_comp) == (3, 1)
    assert px4_messages.read_event_request(data, frame) == (7, 9, 3, 1)


def test_uris_and_versions_are_at_their_places():
    metadata = px4_messages.component_metadata(8, "mftp://a", 0x01020304).payload
    assert (len(metadata), metadata[4:8], metadata[8:17]) == (108, b"\4\3\2\1", b"mftp://a\0")
    assert px4_messages.component_information(8, "mftp://a", 1).payload[12:20] == b"mftp://a"
    assert struct.unpack_from("<3H", px4_messages.protocol_version().payload) == (200, 100, 200)
