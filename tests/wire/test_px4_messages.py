"""PX4's messages that pymavlink's dialect lacks: sizes, contents, and PX4's checksum."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import pytest

from arena.wire import px4_messages
from arena.wire.mavlink_frame import SEEDS, pack_frame, parse_frames


def sender():
    return SimpleNamespace(seq=254, srcSystem=3, srcComponent=1)


@pytest.mark.parametrize(("text", "crc"), [(b"", 0), (b"123456789", 0x2DFD2D88), (b"\0\0\0\0", 0)])
def test_checksum_is_that_of_px4(text, crc):
    assert px4_messages.px4_crc32(text) == crc
    assert px4_messages.px4_crc32(text[3:], px4_messages.px4_crc32(text[:3])) == crc


@pytest.mark.parametrize(("escs", "messages"), [(4, 1), (6, 2), (8, 2)])
def test_esc_messages_contain_four_escs_each_and_are_numbered(escs, messages):
    rpm = [1000.0 + k for k in range(escs)]
    own = sender()
    data = px4_messages.esc_status(5, rpm, 12.0, [1.0] * escs).pack(own)
    frames = parse_frames(data).frames
    assert [f.msgid for f in frames] == [px4_messages.ESC_STATUS] * messages
    assert [data[f.start + 4] for f in frames] == [254, 255][:messages] and own.seq == 253 + messages
    payload = data[frames[-1].payload : frames[-1].payload + frames[-1].size].ljust(57, b"\0")
    values = struct.unpack("<Q4i4f4fB", payload)
    last = rpm[4 * (messages - 1) :]
    assert list(values[1 : 1 + len(last)]) == last and values[5] == 12.0 and values[13] == 4 * (messages - 1)
    info = px4_messages.esc_info(5, 70000, escs).pack(sender())
    assert len(parse_frames(info).frames) == messages


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
