"""The layout of payloads, against pymavlink's packing."""

from __future__ import annotations

import random
import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, pack_frame, parse_frames
from arena.wire.mavlink_layout import decoder, layout, message_name, payload_bytes


@pytest.mark.parametrize("message", mavlink.mavlink_map.values(), ids=lambda m: m.msgname)
def test_fields_lie_where_pymavlink_packs_them(message):
    """Each field in turn is 1, all other fields are 0."""
    for name, field in layout(message.id).items():
        values = {
            each: b"" if at.code == "s" else [0] * at.elements if _is_array(message, each) else 0
            for each, at in layout(message.id).items()
        }
        one = b"\x01" * field.elements if field.code == "s" else 1
        values[name] = [1] * field.elements if _is_array(message, name) and field.code != "s" else one
        expected = bytearray(payload_bytes(message.id))
        code = f"<{field.elements}{field.code}"
        at = (one,) if field.code == "s" else (1,) * field.elements
        struct.pack_into(code, expected, field.offset, *at)
        sender = mavlink.MAVLink(None)
        packed = bytes(message(**values).pack(sender))
        assert packed[10:-2].ljust(len(expected), b"\0") == bytes(expected), name


def _is_array(message, name):
    return message.array_lengths[message.ordered_fieldnames.index(name)] > 0


@pytest.mark.parametrize("message", mavlink.mavlink_map.values(), ids=lambda m: m.msgname)
def test_random_payload_is_decoded_as_by_pymavlink(message):
    rng, sender = random.Random(message.id), mavlink.MAVLink(None, srcSystem=3)
    size = payload_bytes(message.id)
    for zeros in (0, 1, size // 2, size):
        payload = rng.randbytes(size - zeros) + bytes(zeros)
        data = b"garbage" + pack_frame(
            message.id, payload, sender, SEEDS.get(message.id, bytes([message.crc_extra]))
        )
        frames = parse_frames(data).frames
        if not frames:  # a message that is not in the table of seeds
            continue
        (at,) = frames
        found, expected = decoder(message.id)(data, at), sender.decode(bytearray(data[at.start : at.end]))
        for name in message.fieldnames:
            assert _comparable(getattr(found, name)) == _comparable(
                getattr(expected, f"_{name}_raw", getattr(expected, name))
            )


def _comparable(value):
    """Arrays as tuples, numbers as text, because NaN is not equal to itself."""
    return (
        value
        if isinstance(value, bytes)
        else repr(tuple(value))
        if isinstance(value, (list, tuple))
        else repr(value)
    )


def test_messages_have_names_also_if_the_dialect_lacks_them():
    assert [message_name(number) for number in (0, 436, 60000)] == [
        "HEARTBEAT",
        "CURRENT_MODE",
        "message 60000",
    ]
