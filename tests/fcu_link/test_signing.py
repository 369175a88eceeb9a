"""The link to a vehicle that signs: every frame for the vehicle is signed, and only validly signed frames are passed on."""

from collections import Counter

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError
from arena.fcu_link.settings import Settings
from arena.fcu_link.signing import LinkSigning
from arena.signing_key import TimestampFile, read_key, write_new_key
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_signing import FrameSigner, SignatureCheck, Verdict, timestamp_at

from .link_rig import ID, heartbeat, slice_of

WALL_S = 1_795_000_000.0


class Rig:
    """A link process's signing, and the vehicle with the same key. wall_s: time of both clocks."""

    def __init__(self, folder, key_file=True):
        self.file = folder / "key"
        if not self.file.exists():
            write_new_key(self.file)
        self.wall_s, self.counts = WALL_S, Counter()
        self.settings = Settings.from_slice(slice_of(key_file=str(self.file) if key_file else ""))
        self.link = LinkSigning(self.settings, self.counts, lambda: self.wall_s)
        self.vehicle = FrameSigner(read_key(self.file), 0)
        self.codec = Codec(ID, 1)

    def signed(self, message=None):
        return self.vehicle.sign(self.codec.pack(message or heartbeat()), self.wall_s)

    def receive(self, data, now=0.0, source=("10.0.0.7", 14550)):
        """Return the ids of the messages that the link passes on."""
        return [f.msgid for f in self.link.accepted(source, data, parse_frames(data), now).frames]

    def send(self, *frames):
        """Return the frames that the link sends to the vehicle."""
        waiting, sent = list(frames), []
        while (
            frame := self.link.next_frame(lambda now: waiting.pop(0) if waiting else None, 0.0)
        ) is not None:
            sent.append(frame)
        return sent


def test_signed_frames_pass_and_all_others_do_not(tmp_path) -> None:
    rig = Rig(tmp_path)
    other = FrameSigner(bytes([7]) * 32, 0).sign(rig.codec.pack(heartbeat()), WALL_S)
    first = rig.signed()
    assert rig.receive(first) == [0]
    assert rig.receive(first) == []
    assert rig.receive(rig.codec.pack(heartbeat(armed=True))) == []
    assert rig.receive(other) == []
    assert rig.receive(rig.signed()) == [0]
    assert rig.counts == {
        f"from the vehicle: {v.value}": 1 for v in (Verdict.OLD, Verdict.UNSIGNED, Verdict.WRONG)
    }


def test_heartbeat_before_the_first_signed_frame_is_reported_only(tmp_path) -> None:
    rig = Rig(tmp_path)
    assert rig.receive(rig.codec.pack(heartbeat())) == []
    assert "not signed" in rig.link.problem and "arena signing setup" in rig.link.problem
    rig.receive(rig.signed())
    assert rig.link.problem == "" and rig.link.events == ["its messages have a valid signature"]


def test_radio_status_needs_no_signature(tmp_path) -> None:
    radio = Codec(51, 68).pack(mavlink.MAVLink_radio_status_message(200, 200, 100, 20, 20, 0, 0))
    assert Rig(tmp_path).receive(radio) == [109]


def test_source_of_invalid_frames_gets_one_signed_heartbeat_a_second(tmp_path) -> None:
    """It moves the timestamp of a vehicle that has just started."""
    rig, vehicle = Rig(tmp_path), ("10.0.0.7", 14550)
    greeted = []
    for tenth in range(21):
        rig.receive(rig.codec.pack(heartbeat()), tenth / 10, vehicle)
        greeted += rig.link.timestamp_heartbeats()
    assert [source for source, _ in greeted] == [vehicle] * 3
    signed = rig.link.signed(greeted[0][1])
    check = SignatureCheck(read_key(rig.file))
    assert check.check(signed, parse_frames(signed).frames[0], timestamp_at(WALL_S)) is Verdict.VALID


def test_source_of_valid_frames_gets_no_timestamp_heartbeat(tmp_path) -> None:
    rig = Rig(tmp_path)
    rig.receive(rig.signed())
    assert rig.link.timestamp_heartbeats() == []


def test_every_frame_for_the_vehicle_is_signed(tmp_path) -> None:
    rig = Rig(tmp_path)
    plain = [Codec(s, c).onboard_heartbeat() for s, c in ((ID, 192), (ID, 191), (254, 190), (253, 190))]
    check = SignatureCheck(read_key(rig.file))
    sent = rig.send(*plain)
    assert len(sent) == 4
    for data in sent:
        (frame,) = parse_frames(data).frames
        assert check.check(data, frame, timestamp_at(WALL_S)) is Verdict.VALID


def test_frames_that_cannot_be_signed_are_dropped_and_counted(tmp_path) -> None:
    rig = Rig(tmp_path)
    mavlink_1 = heartbeat().pack(mavlink.MAVLink(None, 255, 190), force_mavlink1=True)
    assert len(rig.send(mavlink_1, Codec(ID, 191).onboard_heartbeat())) == 1
    assert rig.counts["to the vehicle: cannot be signed"] == 1


def test_setup_signing_is_never_sent_through_the_link(tmp_path) -> None:
    rig = Rig(tmp_path)
    setup = Codec(255, 190).pack(mavlink.MAVLink_setup_signing_message(ID, 1, [5] * 32, 1))
    assert rig.send(setup) == []
    assert rig.counts["to the vehicle: SETUP_SIGNING"] == 1


def test_restarted_link_continues_after_its_last_timestamp(tmp_path) -> None:
    """Also when the clock of this computer has been set back meanwhile."""
    rig = Rig(tmp_path)
    check = SignatureCheck(read_key(rig.file))
    sent = rig.send(Codec(ID, 192).onboard_heartbeat())
    TimestampFile(rig.file).write(timestamp_at(WALL_S))
    again = Rig(tmp_path)
    again.wall_s = WALL_S - 86_400.0
    sent += again.send(Codec(ID, 192).onboard_heartbeat())
    verdicts = [check.check(d, parse_frames(d).frames[0], 0) for d in sent]
    assert verdicts == [Verdict.VALID, Verdict.VALID]


def test_timestamp_is_stored_while_the_link_runs(tmp_path) -> None:
    rig = Rig(tmp_path)
    rig.send(Codec(ID, 192).onboard_heartbeat())
    rig.link.tick(0.0)
    rig.link._timestamps._writing.join(60.0)
    assert TimestampFile(rig.file).first() > timestamp_at(WALL_S)


def test_vehicle_that_starts_with_an_old_timestamp_is_valid_after_our_first_frame(tmp_path) -> None:
    """PX4 starts with the timestamp of its SETUP_SIGNING, and follows the timestamps that it receives."""
    rig = Rig(tmp_path)
    rig.wall_s = WALL_S - 86_400.0
    old = rig.signed()
    rig.wall_s = WALL_S
    assert rig.receive(old) == []
    rig.vehicle = FrameSigner(read_key(rig.file), 0)
    sent = rig.send(Codec(ID, 192).onboard_heartbeat())[0]
    check = SignatureCheck(read_key(rig.file))
    assert check.check(sent, parse_frames(sent).frames[0], 0) is Verdict.VALID
    rig.vehicle.on_received(check.timestamp)
    rig.wall_s = 0.0
    answer = rig.signed()
    rig.wall_s = WALL_S
    assert rig.receive(answer) == [0]


def test_link_without_a_key_changes_nothing(tmp_path) -> None:
    rig = Rig(tmp_path, key_file=False)
    plain = Codec(ID, 192).onboard_heartbeat()
    assert rig.send(plain) == [plain]
    assert rig.receive(rig.codec.pack(heartbeat())) == [0]
    assert not rig.link.events and not rig.link.timestamp_heartbeats()


def test_link_does_not_start_with_a_key_that_others_can_read(tmp_path) -> None:
    rig = Rig(tmp_path)
    rig.file.chmod(0o644)
    with pytest.raises(InputError, match="mode 0644, expected 0600"):
        LinkSigning(rig.settings, Counter())


def test_key_is_not_in_the_settings(tmp_path) -> None:
    rig = Rig(tmp_path)
    assert read_key(rig.file).hex() not in repr(rig.settings)
