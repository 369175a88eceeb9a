"""Frames found and packed by the compiled and by the interpreted kernel, compared with each other and with pymavlink."""

from __future__ import annotations

import random
from types import ModuleType
from typing import Any

import pytest
from fastcrc import crc16
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, TRIES
from arena.wire.mavlink_targets import TARGETS
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

KEY = bytes(range(32))
INTERPRETED = interpreted_modules("mavlink_framing")["mavlink_framing"]
VERSIONS = [
    pytest.param(INTERPRETED, id="interpreted"),
    pytest.param(compiled_modules("mavlink_framing")["mavlink_framing"], id="compiled", marks=needs_compiled),
]


def parser(module: ModuleType) -> Any:
    return module.FrameParser(SEEDS, TARGETS, TRIES)


def frames(rng: random.Random) -> list[bytes]:
    """Return frames of many kinds: MAVLink 1 and 2, signed, unknown messages, short and long payloads."""
    sender = mavlink.MAVLink(None, srcSystem=rng.randrange(256), srcComponent=rng.randrange(256))
    signer = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    signer.signing.secret_key, signer.signing.sign_outgoing = KEY, True
    old = mavlink1.MAVLink(None, srcSystem=3, srcComponent=1)
    attitude = (rng.randrange(2**32), *(rng.choice([0.0, rng.gauss(0, 1)]) for _ in range(6)))
    command = (rng.randrange(256), rng.randrange(256), 400, 0, *[rng.gauss(0, 1)] * 7)
    made = [
        mavlink.MAVLink_attitude_message(*attitude).pack(sender),
        mavlink.MAVLink_command_long_message(*command).pack(sender),
        mavlink.MAVLink_statustext_message(rng.randrange(8), b"text").pack(signer),
        mavlink1.MAVLink_attitude_message(*attitude).pack(old),
    ]
    payload = rng.randbytes(rng.randrange(1, 255))
    unknown = INTERPRETED.pack(payload, 60_000, b"\x11", sender.seq, 1 + rng.randrange(255), 1)
    return [bytes(each) for each in made] + [unknown]


def datagrams(rng: random.Random) -> list[bytes]:
    """Return datagrams with whole frames, flipped bytes, truncated frames, garbage between frames and only garbage."""
    joined = b"".join(rng.sample(frames(rng), 3))
    flipped = bytearray(joined)
    flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    cut = rng.randrange(len(joined))
    garbage = bytes(rng.choice((0xFD, 0xFE, 0, rng.randrange(256))) for _ in range(rng.randrange(300)))
    return [
        joined,
        bytes(flipped),
        joined[:cut],
        joined[cut:],
        joined + garbage,
        garbage + joined,
        garbage,
        b"",
    ]


@needs_compiled
def test_compiled_and_interpreted_parser_find_the_same_frames() -> None:
    rng = random.Random(1)
    compiled, source = (parser(param.values[0]) for param in reversed(VERSIONS))  # type: ignore[attr-defined]
    found = selected = 0
    for _ in range(400):
        for data in datagrams(rng):
            expected = source.parse(data)
            assert tuple(compiled.parse(data)) == tuple(expected), data.hex()
            found += len(expected.frames)
            wanted, sender = {30, 76, 60_000}, (rng.choice([3, 7]), 1)
            if expected.frames and rng.random() < 0.5:
                sender = expected.frames[0].sysid, expected.frames[0].compid
            searched = source.search(data, wanted, *sender)
            assert compiled.search(data, wanted, *sender) == searched
            assert searched[1:] == expected[1:]
            assert searched.frames == [
                f for f in expected.frames if (f.sysid, f.compid) == sender and f.msgid in wanted
            ]
            selected += len(searched.frames)
            for at in range(0, len(data), 7):
                assert compiled.frame_at(data, at, len(data)) == source.frame_at(data, at, len(data))
    assert found > 4000 and selected > 400


@pytest.mark.parametrize("module", VERSIONS)
def test_frames_with_their_senders_are_those_of_pymavlink(module: ModuleType) -> None:
    rng = random.Random(2)
    for _ in range(50):
        known = frames(rng)[:-1]
        found = parser(module).parse(b"".join(known))
        receiver = mavlink.MAVLink(None)
        expected = [receiver.decode(bytearray(each)) for each in known]
        assert (found.garbage, found.bad_crc, found.unknown) == (0, 0, 0)
        assert [(f.msgid, f.sysid, f.compid) for f in found.frames] == [
            (m.get_msgId(), m.get_srcSystem(), m.get_srcComponent()) for m in expected
        ]
        assert [f.end - f.start for f in found.frames] == [len(each) for each in known]


@pytest.mark.parametrize("module", VERSIONS)
def test_frame_with_a_wrong_crc_is_counted_and_not_returned(module: ModuleType) -> None:
    data = bytearray(frames(random.Random(3))[0])
    data[-1] ^= 1
    found = parser(module).parse(bytes(data))
    assert (found.frames, found.bad_crc, found.garbage) == ([], 1, len(data))


@pytest.mark.parametrize("module", VERSIONS)
def test_payload_is_packed_as_by_pymavlink(module: ModuleType) -> None:
    rng = random.Random(4)
    for message in mavlink.mavlink_map.values():
        for zeros in (0, 3, 300):
            size = message.unpacker.size
            payload = rng.randbytes(size)[: max(0, size - zeros)].ljust(size, b"\0")
            sender = mavlink.MAVLink(None, srcSystem=rng.randrange(256), srcComponent=rng.randrange(256))
            sender.seq = rng.randrange(256)
            seed = bytes([message.crc_extra])
            packed = module.pack(payload, message.id, seed, sender.seq, sender.srcSystem, sender.srcComponent)
            assert packed == _packed_by_pymavlink(message, payload, sender)


@pytest.mark.parametrize("module", VERSIONS)
def test_crc_of_a_buffer_is_that_of_fastcrc(module: ModuleType) -> None:
    rng = random.Random(5)
    for size in (0, 1, 2, *(rng.randrange(300) for _ in range(200))):
        data = bytearray(rng.randbytes(size + 20))
        begin = rng.randrange(20)
        expected = crc16.mcrf4xx(bytes(data[begin : begin + size]))
        assert module.crc_of_buffer(memoryview(data), begin, begin + size) == expected


def _packed_by_pymavlink(message: Any, payload: bytes, sender: Any) -> bytes:
    """Return the frame that pymavlink makes of a payload. A message object could change NaN payload bytes."""
    blank = mavlink.MAVLink_message(message.id, message.msgname)
    return bytes(blank._pack(sender, message.crc_extra, payload))
