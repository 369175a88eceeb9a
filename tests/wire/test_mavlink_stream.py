"""The stream cutter: the same frames however the line is chopped, and never an exception."""

from __future__ import annotations

import itertools
import random

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import Stream, parse_frames


def frames_of(n: int, version: int = 2) -> list[bytes]:
    voice = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    made = []
    for i in range(n):
        m = (
            mavlink.MAVLink_local_position_ned_message(i, i + 0.5, -2.0, 0.25, 0.0, 1e-9, 0.0)
            if i % 2
            else (mavlink.MAVLink_statustext_message(3, f"hello {i} \xfd\xfe".encode("latin1"), 0, 0))
        )
        made.append(m.pack(voice, force_mavlink1=version == 1))
        voice.seq = (voice.seq + 1) % 256
    return made


def fed(pieces: list[bytes]) -> tuple[list[bytes], int]:
    """(frames, garbage bytes)"""
    stream, found, garbage = Stream(), [], 0
    for piece in pieces:
        buffer, result = stream.feed(piece)
        found += [buffer[f.start : f.end] for f in result.frames]
        garbage += result.garbage
    return found, garbage


def chopped(data: bytes, cuts: list[int]) -> list[bytes]:
    places = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(places)]


@given(st.lists(st.integers(0, 10_000), max_size=40), st.binary(max_size=60), st.sampled_from([1, 2]))
@settings(max_examples=150)
def test_any_split_of_a_stream_gives_the_same_frames(cuts, noise, version):
    data = noise + b"".join(frames_of(6, version)) + noise + b"".join(frames_of(6, version))
    assert fed(chopped(data, cuts)) == fed([data])


@given(st.binary(max_size=400).filter(lambda b: b"\xfd" not in b and b"\xfe" not in b))
@settings(max_examples=60)
def test_frames_after_garbage_are_found_and_garbage_is_counted(noise):
    sent = frames_of(4)
    assert fed([noise + b"".join(sent)]) == (sent, len(noise))


def test_an_incomplete_frame_costs_no_other_frame():
    sent = frames_of(8)
    broken = [*sent[:3], sent[3][:-5], *sent[4:]]
    found, _ = fed([bytes([b]) for b in b"".join(broken)])
    assert found == [*sent[:3], *sent[4:]]


def test_a_frame_with_a_wrong_checksum_is_dropped():
    sent = frames_of(3)
    bent = bytearray(sent[1])
    bent[-1] ^= 0x55
    stream = Stream()
    buffer, result = stream.feed(sent[0] + bytes(bent) + sent[2])
    assert [buffer[f.start : f.end] for f in result.frames] == [sent[0], sent[2]]
    assert result.bad_crc >= 1


def test_an_unknown_message_passes_only_between_two_frames():
    foreign = bytes([0xFD, 4, 0, 0, 9, 7, 1, 0x50, 0xC3, 0, 1, 2, 3, 4, 0xAA, 0xBB])  # message 50000
    before, after = frames_of(2)
    assert fed([before + foreign, after]) == ([before, foreign, after], 0)
    found, garbage = fed([b"noise" + foreign + after])
    assert (found, garbage) == ([after], 5 + len(foreign))


@given(st.lists(st.binary(max_size=300), max_size=20))
@settings(max_examples=150)
def test_random_bytes_never_raise_and_few_are_kept(pieces):
    stream = Stream()
    for piece in pieces:
        stream.feed(piece)
        assert len(stream._kept) <= 10 + 255 + 2 + 13


def test_a_stream_of_whole_frames_is_parsed_as_datagrams_are():
    rng = random.Random(5)
    data = b"".join(rng.choices(frames_of(10), k=200))
    assert len(fed([data])[0]) == len(parse_frames(data).frames) == 200
