"""A connection is bound to the hardware uid of one autopilot; other vehicles with its system id are strangers."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.identity import Identity
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

from .link_rig import ID, UID, Rig, arm, attitude, heartbeat, odometry, sys_status, version

A, B = ("10.0.0.21", 14550), ("10.0.0.66", 14550)
OTHER = bytes(range(101, 119))
VEHICLE = Codec(ID, 1)


def receive(identity: Identity, source: Any, now: float, *messages: Any, codec: Codec = VEHICLE) -> bool:
    data = b"".join(codec.pack(m) for m in messages)
    return identity.accepts(source, data, parse_frames(data).frames, now)


def known(uid: str = "", **changes: Any) -> Identity:
    """Return the identity of a vehicle that has sent its uid from address A."""
    identity = Identity(ID, uid, **changes)
    assert receive(identity, A, 0.0, heartbeat(), version())
    identity.events.clear()
    return identity


def asked(identity: Identity, now: float) -> list[Any]:
    return [source for source, _ in identity.requests(now)]


# -- the first contact -------------------------------------------------------------------------------------------------


def test_a_vehicle_counts_only_after_it_has_sent_its_uid():  # review fault 4
    identity = Identity(ID)
    assert not receive(identity, A, 0.0, heartbeat())
    assert identity.requests(0.0) == [(A, mavlink.MAV_CMD_REQUEST_MESSAGE)]
    assert asked(identity, 0.1) == [] and asked(identity, 0.3) == [A]
    assert identity.problem(0.3) == "hardware uid not received"
    assert receive(identity, A, 0.4, version())
    assert (identity.source, identity.uid) == (A, UID.hex()) and not identity.problem(0.4)
    assert asked(identity, 1.0) == []
    assert identity.events == [f"hardware uid {UID.hex()}", "sends from 10.0.0.21:14550"]


@pytest.mark.parametrize("uid", [UID.hex(), UID.hex().upper(), "00000000000000ab"])
def test_the_uid_of_the_yaml_is_uid2_or_uid(uid):
    identity = Identity(ID, uid)
    assert receive(identity, A, 0.0, version(uid=0xAB))


def test_review_fault_4_another_uid_than_in_the_yaml_is_refused_from_the_start():
    identity = Identity(ID, UID.hex())
    assert not receive(identity, A, 0.0, heartbeat(), version(OTHER))
    assert identity.source is None and asked(identity, 0.0) == []
    assert identity.problem(0.0) == "another vehicle answers: wrong uid"
    assert identity.events == [
        f"another vehicle answers with system id {ID}: uid {OTHER.hex()} at 10.0.0.21:14550, expected {UID.hex()}. "
        "Nothing is sent to it"
    ]
    assert receive(identity, B, 0.1, version())


def test_an_old_autopilot_is_asked_with_the_older_command():
    identity = Identity(ID)
    unsupported = mavlink.MAVLink_command_ack_message(512, 3)
    receive(identity, A, 0.0, heartbeat())
    identity.requests(0.0)
    receive(identity, A, 0.1, unsupported)
    assert identity.requests(0.3) == [(A, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)]


def test_a_companion_computer_is_never_asked():
    identity = Identity(ID)
    assert not receive(identity, A, 0.0, heartbeat(), codec=Codec(ID, 191))
    assert not receive(identity, A, 0.0, heartbeat(), codec=Codec(ID + 1, 1))
    assert asked(identity, 0.0) == []


# -- strangers --------------------------------------------------------------------------------------------------------


def test_review_fault_4_a_stranger_is_refused_whatever_the_silence():
    identity = known()
    identity.fix()
    for i in range(1, 600):
        assert not receive(identity, B, 1.0 * i, heartbeat(), version(OTHER))
    assert identity.last_source == A
    assert [e for e in identity.events if "another vehicle answers" in e] == identity.events
    assert len(identity.events) == 1, "one line"
    assert receive(identity, A, 601.0, version())


def test_the_vehicle_is_accepted_at_a_new_address_after_silence():
    identity = known()
    identity.fix()
    assert not receive(identity, B, 1.0, version()), "its first address still sends"
    assert not receive(identity, B, 2.9, heartbeat())
    assert receive(identity, B, 3.1, heartbeat())
    assert identity.source == B and not receive(identity, A, 3.2, heartbeat())
    assert identity.events == ["sends from 10.0.0.66:14550 (before: 10.0.0.21:14550, silent for 3 s)"]


def test_a_vehicle_that_was_silent_sends_its_uid_again():
    identity = known()
    identity.fix()
    assert receive(identity, A, 2.9, heartbeat())
    assert not receive(identity, A, 6.0, heartbeat()) and asked(identity, 6.0) == [A]
    assert not receive(identity, A, 6.1, version(OTHER))
    assert not receive(identity, A, 6.2, heartbeat())
    assert "another vehicle answers" in identity.events[0]


def test_a_stranger_at_the_address_of_the_vehicle_ends_the_connection():
    identity = known()
    identity.fix()
    assert not receive(identity, A, 0.5, version(OTHER))
    assert not receive(identity, A, 1.0, heartbeat())
    assert identity.source is None and identity.last_source == A


def test_another_vehicle_may_be_connected_before_the_first_arm_permit():
    identity = known()
    assert not receive(identity, B, 1.0, version(OTHER)), "the first one still sends"
    assert receive(identity, B, 4.0, version(OTHER))
    assert identity.uid == OTHER.hex()
    assert f"hardware uid {OTHER.hex()} (before: {UID.hex()})" in identity.events


def test_an_exchanged_serial_device_sends_its_uid_again():
    identity = known()
    identity.fix()
    identity.release()
    assert not receive(identity, A, 0.1, heartbeat()) and asked(identity, 0.1) == [A]
    assert not receive(identity, A, 0.2, version(OTHER))


# -- autopilots without a uid -------------------------------------------------------------------------------------------


def test_an_autopilot_without_uid_is_connected_but_may_not_arm():
    identity = Identity(ID)
    assert receive(identity, A, 0.0, version(bytes(18)))
    assert identity.problem(0.0) == "no hardware uid: needs `uid: none`"
    assert "reports no hardware uid" in identity.events[0]
    hitl = Identity(ID, needs_uid=False)
    assert receive(hitl, A, 0.0, version(bytes(18))) and not hitl.problem(0.0)


def test_without_uid_the_first_address_is_the_identity():
    identity = Identity(ID, "none")
    assert receive(identity, A, 0.0, version(bytes(18))) and not identity.problem(0.0)
    assert not receive(identity, B, 10.0, version(bytes(18)))
    assert "neither reports a hardware uid" in identity.events[-1]
    assert not receive(identity, A, 20.0, version()), "an autopilot with a uid"
    assert receive(identity, A, 30.0, version(bytes(18)))


def test_an_autopilot_without_uid_does_not_replace_one_with_uid():
    identity = known()
    identity.fix()
    assert not receive(identity, A, 10.0, version(bytes(18)))


# -- the link ---------------------------------------------------------------------------------------------------------


def stranger(rig: Rig, *messages: Any) -> None:
    data = b"".join(Codec(ID, 1).pack(m) for m in messages)
    rig.core.from_vehicle(data, parse_frames(data), rig.now, B)


def test_review_fault_4_a_stranger_gets_only_the_request_for_its_uid():
    rig = Rig(params={"MPC_XY_P": 0.95})
    rig.fly(2.0)
    rig.core.identity.fix()
    for end in rig.got.values():
        end.clear()
    asked = []
    for _ in range(100):  # 10 s without the vehicle, with a stranger that sends telemetry and no uid
        rig.now += 0.1
        stranger(rig, heartbeat(armed=True), sys_status(), attitude())
        asked += [source for source, _ in rig.core.own.uid_requests(rig.now)]
        rig.core.tick(rig.now)
    assert set(asked) == {B} and 20 <= len(asked) <= 41
    assert not any(rig.got.values()) and not rig.core.armed(rig.now) and not rig.core.alive(rig.now)
    assert rig.core.identity.source != B
    assert "Preflight: hardware uid not received" in rig.reasons()


def test_review_fault_4_nothing_is_sent_before_the_uid_is_known():
    rig = Rig(params={"MPC_XY_P": 0.95})
    rig.core.identity.release()
    data = Codec(ID, 1).pack(heartbeat())
    for _ in range(40):
        rig.now += 0.1
        rig.core.from_vehicle(data, parse_frames(data), rig.now)
        rig.core.tick(rig.now)
        for link in ("router", "panic"):
            rig.send(link, arm(param1=0.0))
        rig.send("vision", odometry())
    assert rig.out == []
    assert rig.core.counts["to the vehicle: not connected (panic)"] == 40
    ((source, frame),) = rig.core.own.uid_requests(rig.now)
    (request,) = Codec(1, 1).parse(frame)
    assert (source, request.command, request.param1) == ("the vehicle", 512, 148.0)


def test_a_reboot_requires_the_uid_again():
    rig = Rig()
    rig.fly(1.0)
    rig.receive(mavlink.MAVLink_system_time_message(0, 60_000))
    rig.receive(mavlink.MAVLink_system_time_message(0, 900))
    assert rig.core.identity.source is None
    rig.receive(heartbeat())
    assert rig.core.identity.source is not None


def test_silence_and_a_stranger_are_reported_differently():
    rig = Rig(uid=UID.hex())
    for _ in range(150):
        rig.now += 0.1
        stranger(rig, heartbeat(), version(OTHER))
        rig.core.tick(rig.now)
    texts = rig.core.events()
    assert sum("another vehicle answers with system id 7" in t for t in texts) == 1
    assert any("is not connected: another vehicle answers: wrong uid" in t for t in texts)


def test_the_mode_is_known_before_the_first_command():
    rig = Rig()
    rig.core.identity.release()
    for message in (heartbeat(armed=True), version()):
        data = Codec(ID, 1).pack(message)
        rig.core.from_vehicle(data, parse_frames(data), rig.now)
    assert rig.core.armed(rig.now)
