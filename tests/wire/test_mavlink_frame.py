"""The frame cutter against pymavlink, and against bytes that are nothing."""

import itertools
import random
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from arena.wire import mavlink_targets
from arena.wire.mavlink_frame import TRIES, byte_at, parse_frames, uint_at
from arena.wire.px4_mode import mode_words


def speaker(system=7, component=191):
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def filled(message):
    """One message of the class with a different number in every field."""
    values = []
    for i, name in enumerate(message.ordered_fieldnames):
        kind, length = message.fieldtypes[message.fieldnames.index(name)], message.array_lengths[i]
        number = 1.5 + i if kind in ("float", "double") else 3 + i
        values.append(
            (
                name,
                (b"ab" if kind == "char" else [number] * length)
                if length
                else b"a"
                if kind == "char"
                else number,
            )
        )
    return message(**dict(values))


def command(target=(9, 1), sender=(7, 191), number=400):
    voice = speaker(*sender)
    return bytes(mavlink.MAVLink_command_long_message(*target, number, 0, 1, 0, 0, 0, 0, 0, 0).pack(voice))


def attitude(system=7):
    return bytes(mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0).pack(speaker(system, 1)))


def test_the_tables_are_those_of_pymavlink():
    """Only messages in both tables are compared, because other versions of pymavlink have a few more or fewer."""
    crc_extra, targets = mavlink_targets.tables_of(mavlink)
    both = crc_extra.keys() & mavlink_targets.CRC_EXTRA.keys()
    assert len(both) > 200
    assert {k: crc_extra[k] for k in both} == {k: mavlink_targets.CRC_EXTRA[k] for k in both}
    assert {k: targets.get(k) for k in both} == {k: mavlink_targets.TARGETS.get(k) for k in both}


KNOWN = [m for number, m in mavlink.mavlink_map.items() if number in mavlink_targets.CRC_EXTRA]


@pytest.mark.parametrize("message", KNOWN, ids=lambda m: m.msgname)
def test_every_message_is_found_with_its_sender_and_target(message):
    sent = filled(message)
    data = bytes(sent.pack(speaker()))
    frames, garbage, bad_crc, unknown = parse_frames(data)
    assert (len(frames), garbage, bad_crc, unknown) == (1, 0, 0, 0)
    frame = frames[0]
    assert (frame.start, frame.end, frame.sysid, frame.compid, frame.msgid) == (
        0,
        len(data),
        7,
        191,
        message.id,
    )
    assert frame.target_sys == getattr(
        sent, "target_system", getattr(sent, "target", 0) if message.id == 69 else 0
    )
    assert frame.target_comp == getattr(sent, "target_component", 0)


def test_mavlink_1_is_understood_beside_mavlink_2():
    voice = mavlink1.MAVLink(None, srcSystem=3, srcComponent=4)
    old = bytes(mavlink1.MAVLink_command_long_message(5, 6, 400, 0, 0, 0, 0, 0, 0, 0, 0).pack(voice))
    frames = parse_frames(old + command()).frames
    assert [(f.sysid, f.compid, f.target_sys, f.target_comp) for f in frames] == [
        (3, 4, 5, 6),
        (7, 191, 9, 1),
    ]
    assert frames[1].start == len(old)


def test_zeros_that_mavlink_2_cut_off_read_as_zero():
    data = bytes(mavlink.MAVLink_command_long_message(9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0).pack(speaker()))
    frame = parse_frames(data).frames[0]
    assert frame.size == 31
    assert (frame.target_sys, frame.target_comp) == (9, 0)
    assert byte_at(data, frame, 31) == 0
    assert uint_at(data, frame, 30, 4) == 9


def test_a_signed_frame_ends_after_its_signature():
    voice = speaker()
    voice.signing.secret_key, voice.signing.sign_outgoing = b"k" * 32, True
    data = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(voice))
    frames = parse_frames(data + attitude()).frames
    assert [f.msgid for f in frames] == [0, 30]
    assert frames[0].end == len(data) == 12 + 9 + 13


@pytest.mark.parametrize("byte", range(1, len(attitude())))
def test_a_frame_with_a_wrong_bit_is_dropped(byte):
    """All but one way out: a message id that becomes an unknown one cannot be checked."""
    for bit in range(8):
        data = bytearray(attitude())
        data[byte] ^= 1 << bit
        frames = parse_frames(data).frames
        assert not frames or (byte in (7, 8, 9) and frames[0].msgid not in mavlink_targets.CRC_EXTRA)


def test_a_frame_with_an_unknown_incompatibility_flag_is_dropped():
    data = bytearray(attitude())
    data[2] = 0x02
    assert parse_frames(data).frames == []


def test_frames_after_garbage_and_a_torn_tail_are_found():
    noise = b"\x00\xfd\x01\xfe\xff"
    data = noise + attitude() + noise + command() + attitude()[:20]
    found = parse_frames(data)
    assert [f.msgid for f in found.frames] == [30, 76]
    assert found.garbage == 2 * len(noise) + 20
    assert sum(f.end - f.start for f in found.frames) + found.garbage == len(data)


def unknown_frame(msgid=54321):
    return b"\xfd\x03\x00\x00\x05\x01\x01" + msgid.to_bytes(3, "little") + b"abc" + b"\x12\x34"


def test_an_unknown_message_passes_only_without_leftover_bytes():
    assert parse_frames(unknown_frame()).unknown == 1
    assert [f.msgid for f in parse_frames(attitude() + unknown_frame() + attitude()).frames] == [
        30,
        54321,
        30,
    ]
    assert parse_frames(unknown_frame() + b"\x00").frames == []
    assert parse_frames(b"\x00" + unknown_frame()).frames == []


@given(st.binary(max_size=600))
def test_any_bytes_are_parsed_into_parts_that_add_up(data):
    frames, garbage, _, _ = parse_frames(data)
    assert sum(f.end - f.start for f in frames) + garbage == len(data)
    assert all(a.end <= b.start for a, b in itertools.pairwise(frames))
    assert all(f.end <= len(data) for f in frames)


@given(st.lists(st.sampled_from([attitude(), command(), unknown_frame()]), max_size=20), st.data())
def test_a_truncated_datagram_gives_its_complete_frames(parts, data):
    whole = b"".join(parts)
    length = data.draw(st.integers(0, len(whole)))
    kept, at = [], 0
    for part in parts:
        if at + len(part) > length:
            break
        kept.append(part)
        at += len(part)
    found = parse_frames(memoryview(whole)[:length])
    assert [whole[f.start : f.end] for f in found.frames][: len(kept)] == kept
    assert len(found.frames) == len(kept)


@pytest.mark.parametrize(
    "filler", [b"\xfd", b"\xfe", b"\xfe\xf0\x00\x00\x00\x00", b"\xfd\xff\x00\x00\x00\x00\x00\x1e\x00\x00"]
)
def test_a_datagram_with_many_false_starts_is_skipped_early(filler):
    data = (filler * 65507)[:65507]
    used_s = []
    for _ in range(20):
        began = time.thread_time()
        assert parse_frames(data).bad_crc <= TRIES
        used_s.append(time.thread_time() - began)
    assert min(used_s) < 0.005  # CPU time, the smallest: a busy machine does not change it


def test_random_bytes_rarely_pass_as_a_frame():
    rng = random.Random(4)
    passed = sum(len(parse_frames(rng.randbytes(rng.randrange(1, 300))).frames) for _ in range(20000))
    assert passed <= 2


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (6 << 16, "OFFBOARD"),
        (4 << 16 | 6 << 24, "AUTO.LAND"),
        (4 << 16 | 3 << 24, "AUTO.LOITER"),
        (3 << 16, "POSCTL"),
        (3 << 16 | 1 << 24, "ORBIT"),
        (4 << 16 | 77 << 24, "AUTO.77"),
        (0, "mode 0"),
    ],
)
def test_modes_have_px4s_names(number, words):
    assert mode_words(number) == words
