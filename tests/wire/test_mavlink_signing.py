"""MAVLink 2 signing, compared with pymavlink in both directions, and its protection against repeated frames."""

import hashlib

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_minimal import MinimalSender
from arena.wire.mavlink_signing import (
    NEW_STREAM_AGE,
    FrameSigner,
    SignatureCheck,
    Verdict,
    has_signature,
    is_signed,
    pack_setup_signing,
    timestamp_at,
)

KEY = bytes(range(1, 33))
OTHER = bytes(32 - i for i in range(32))
WALL_S = 1_795_000_000.0
NOW = timestamp_at(WALL_S)


def messages():
    yield mavlink.MAVLink_heartbeat_message(2, 12, 81, 0x10000, 4, 3)
    yield mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    yield mavlink.MAVLink_statustext_message(6, b"ready", 0, 0)
    yield mavlink.MAVLink_odometry_message(
        0, 1, 12, 1, 2, 3, [1, 0, 0, 0], *[0] * 6, [0] * 21, [0] * 21, 0, 2, 9
    )


def theirs(key=KEY, link=3, timestamp=NOW, system=1, component=1):
    """Return a pymavlink sender that signs."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.signing.secret_key, mav.signing.link_id = key, link
    mav.signing.timestamp, mav.signing.sign_outgoing = timestamp, True
    return mav


def frame_in(data):
    (frame,) = parse_frames(data).frames
    return frame


def verdict(check, data, local=NOW):
    return check.check(data, frame_in(data), local)


@pytest.mark.parametrize("message", list(messages()), ids=lambda m: m.get_type())
def test_signed_frame_has_the_bytes_of_pymavlink(message) -> None:
    plain = Codec(9, 192).pack(message)
    assert FrameSigner(KEY, 3, NOW - 1).sign(plain, 0.0) == message.pack(theirs(system=9, component=192))


@pytest.mark.parametrize("message", list(messages()), ids=lambda m: m.get_type())
def test_pymavlink_accepts_our_frames(message) -> None:
    signed = FrameSigner(KEY, 3).sign(Codec(9, 192).pack(message), WALL_S)
    receiver = theirs()
    assert [m.get_type() for m in receiver.parse_buffer(signed)] == [message.get_type()]
    assert receiver.signing.goodsig_count == 1


def test_pymavlink_refuses_our_frames_with_another_key() -> None:
    signed = FrameSigner(OTHER, 3).sign(Codec(9, 192).onboard_heartbeat(), WALL_S)
    receiver = theirs()
    with pytest.raises(mavlink.MAVError):
        receiver.parse_buffer(signed)


@pytest.mark.parametrize("message", list(messages()), ids=lambda m: m.get_type())
def test_frames_of_pymavlink_are_valid(message) -> None:
    assert verdict(SignatureCheck(KEY), message.pack(theirs())) is Verdict.VALID


def test_unsigned_and_wrongly_signed_frames_are_not_valid() -> None:
    message, check = next(messages()), SignatureCheck(KEY)
    assert verdict(check, Codec(1, 1).pack(message)) is Verdict.UNSIGNED
    assert verdict(check, message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)) is Verdict.UNSIGNED
    assert verdict(check, message.pack(theirs(key=OTHER))) is Verdict.WRONG


def test_every_changed_byte_makes_the_signature_wrong() -> None:
    data = next(messages()).pack(theirs())
    frame = frame_in(data)
    for at in range(frame.end):
        changed = bytearray(data)
        changed[at] ^= 0x40
        assert not has_signature(KEY, bytes(changed), frame) or at == 0


def test_repeated_frame_is_old() -> None:
    check, mav = SignatureCheck(KEY), theirs()
    first, second = (message.pack(mav) for message in list(messages())[:2])
    assert verdict(check, first) is Verdict.VALID
    assert verdict(check, first) is Verdict.OLD
    assert verdict(check, second) is Verdict.VALID
    assert verdict(check, first) is Verdict.OLD


def test_each_system_component_and_link_is_a_stream() -> None:
    check, message = SignatureCheck(KEY), next(messages())
    assert verdict(check, message.pack(theirs(timestamp=NOW + 500))) is Verdict.VALID
    for changes in ({"system": 2}, {"component": 9}, {"link": 4}):
        assert verdict(check, message.pack(theirs(timestamp=NOW, **changes))) is Verdict.VALID
        assert verdict(check, message.pack(theirs(timestamp=NOW, **changes))) is Verdict.OLD


def test_wrong_frame_does_not_move_the_timestamp_of_a_stream() -> None:
    check, message = SignatureCheck(KEY), next(messages())
    assert verdict(check, message.pack(theirs(key=OTHER, timestamp=NOW + 10**9))) is Verdict.WRONG
    assert verdict(check, message.pack(theirs())) is Verdict.VALID


def test_new_stream_older_than_a_minute_is_old() -> None:
    message = next(messages())
    old, young = (message.pack(theirs(timestamp=NOW - NEW_STREAM_AGE - d)) for d in (1, 0))
    assert verdict(SignatureCheck(KEY), old) is Verdict.OLD
    assert verdict(SignatureCheck(KEY), young) is Verdict.VALID


def test_timestamps_increase_when_the_clock_does_not() -> None:
    signer, plain = FrameSigner(KEY, 1), Codec(9, 192).onboard_heartbeat()
    check = SignatureCheck(KEY)
    for wall_s in (WALL_S, WALL_S, WALL_S - 3600.0, WALL_S - 3599.0):
        assert verdict(check, signer.sign(plain, wall_s)) is Verdict.VALID
    assert signer.timestamp == NOW + 3


def test_signer_follows_a_newer_timestamp_of_the_vehicle() -> None:
    signer = FrameSigner(KEY, 1)
    signer.on_received(NOW + 10**8)
    signer.sign(Codec(9, 192).onboard_heartbeat(), WALL_S)
    assert signer.timestamp == NOW + 10**8 + 1


def test_timestamp_counts_10_us_since_2015() -> None:
    assert timestamp_at(1_420_070_400.0) == 0 == timestamp_at(0.0)
    assert timestamp_at(1_420_070_401.5) == 150_000


def test_earlier_signature_is_replaced() -> None:
    signed = next(messages()).pack(theirs(key=OTHER, system=9))
    again = FrameSigner(KEY, 1).sign(signed, WALL_S)
    assert len(again) == len(signed)
    assert verdict(SignatureCheck(KEY), again) is Verdict.VALID


def test_mavlink_1_and_unknown_messages_cannot_be_signed() -> None:
    signer = FrameSigner(KEY, 1)
    old = next(messages()).pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)
    assert signer.sign(old, WALL_S) is None
    unknown = bytes([0xFD, 1, 0, 0, 0, 1, 1, 0xFE, 0xFF, 0xFE, 7, 0, 0])
    assert signer.sign(unknown, WALL_S) is None
    assert signer.sign(b"no frame", WALL_S) is None


def test_senders_beyond_the_limit_are_sent_as_this_process() -> None:
    signer = FrameSigner(KEY, 1, own=(9, 192), most_senders=3)
    sent = [signer.sign(Codec(252, c).onboard_heartbeat(), WALL_S) for c in (190, 191, 192, 193, 190)]
    senders = [(frame_in(d).sysid, frame_in(d).compid) for d in sent]
    assert senders == [(252, 190), (252, 191), (9, 192), (9, 192), (252, 190)]
    assert all(has_signature(KEY, d, frame_in(d)) for d in sent)


def test_setup_signing_has_the_bytes_of_pymavlink() -> None:
    expected = Codec(252, 190).pack(mavlink.MAVLink_setup_signing_message(7, 1, list(KEY), NOW))
    assert pack_setup_signing(MinimalSender(252, 190), 7, 1, KEY, NOW) == expected


@pytest.mark.parametrize("key", [b"", KEY[:31], KEY + b"\1", bytes(32)])
def test_key_of_another_length_or_of_zeros_is_refused(key) -> None:
    for use in (lambda: FrameSigner(key, 1), lambda: SignatureCheck(key)):
        with pytest.raises(ValueError, match="32 bytes") as raised:
            use()
        assert key.hex() not in str(raised.value) or not key


def test_signature_is_the_hash_of_key_and_frame() -> None:
    data = next(messages()).pack(theirs())
    assert is_signed(data, frame_in(data))
    assert data[-6:] == hashlib.sha256(KEY + data[:-6]).digest()[:6]
