"""The right name for each body after repeated frames, server restarts and renamed bodies."""

from __future__ import annotations

import math
import struct

import pytest

from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet.receiver import NatNetReceiver

V = (4, 1)
INFO = natnet.encode_server_info(
    natnet.ServerInfo(name="x", app_version=(4, 1, 0, 0), version=V, clock_hz=1000, data_port=1511, group="")
)


def models(*bodies: tuple[int, str]) -> bytes:
    return natnet.encode_models(bodies, V)


def frame(
    number: int, *, ids=(1, 2), exposure_ticks: int = 0, stamp: float = 5.0, changed: bool = False
) -> bytes:
    bodies = tuple(
        natnet.Body(streaming_id=i, position=(float(i), 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
        for i in ids
    )
    return natnet.encode_frame(
        natnet.Frame(
            number=number,
            timestamp_s=stamp,
            exposure_ticks=exposure_ticks,
            bodies=bodies,
            models_changed=changed,
        ),
        V,
    )


def connected_receiver(*bodies: tuple[int, str], wanted=None) -> NatNetReceiver:
    receiver = NatNetReceiver(wanted)
    receiver.receive(INFO)
    receiver.receive(models(*(bodies or ((1, "uav1"), (2, "uav2")))))
    return receiver


def east(receiver: NatNetReceiver, data: bytes) -> dict[str, float]:
    found = receiver.receive(data)
    return {} if found is None else {p.body: p.p_n[1] for p in found.poses}


def test_repeated_frame_is_dropped():
    receiver = connected_receiver()
    assert receiver.receive(frame(7))
    assert receiver.receive(frame(7)) is None
    assert receiver.receive(frame(6)) is None
    assert receiver.counts["repeated"] == 2
    assert receiver.receive(frame(8))


def test_single_old_frame_is_dropped():
    receiver = connected_receiver()
    assert receiver.receive(frame(1_000_000))
    assert receiver.receive(frame(3)) is None
    assert receiver.is_connected
    assert receiver.receive(frame(1_000_001))


def test_restarted_server_is_asked_for_its_bodies_again():
    """After a restart streaming ids may have changed places, which would fly one vehicle into another."""
    receiver = connected_receiver((1, "uav1"), (2, "uav2"))
    assert east(receiver, frame(5000)) == {"uav1": 1.0, "uav2": 2.0}
    assert all(not east(receiver, frame(n)) for n in range(0, 40))
    assert not receiver.is_connected
    assert receiver.counts["restarted"] == 1
    receiver.receive(INFO)
    assert not receiver.is_connected, "the old names are gone"
    assert not east(receiver, frame(41))
    receiver.receive(models((1, "uav2"), (2, "uav1")))
    assert east(receiver, frame(42)) == {"uav2": 1.0, "uav1": 2.0}


def test_reset_forgets_the_body_names():
    receiver = connected_receiver()
    receiver.reset()
    receiver.receive(INFO)
    assert not receiver.is_connected
    assert receiver.receive(frame(9)) is None


def test_changed_models_give_no_pose_until_they_are_received_again():
    receiver = connected_receiver((1, "uav1"), (2, "uav2"))
    assert receiver.receive(frame(1, changed=True)) is None
    assert natnet.message_of(receiver.next_request()) == natnet.REQUEST_MODELDEF
    receiver.receive(models((2, "uav1"), (1, "uav2")))
    assert east(receiver, frame(2, changed=True)) == {"uav1": 2.0, "uav2": 1.0}, (
        "a bit that stays set is no new change"
    )
    assert receiver.receive(frame(3))
    assert receiver.receive(frame(4, changed=True)) is None


def test_duplicate_body_name_gives_no_pose():
    receiver = connected_receiver((1, "uav1"), (2, "uav1"), (3, "uav3"))
    assert east(receiver, frame(1, ids=(1, 2, 3))) == {"uav3": 3.0}
    assert receiver.counts["duplicate names"] == 1


@pytest.mark.parametrize("wanted", [None, ["uav1", "uav2"]])
def test_two_bodies_with_one_id_in_a_frame_give_no_pose(wanted):
    receiver = connected_receiver(wanted=wanted)
    assert east(receiver, frame(1, ids=(1, 2))) == {"uav1": 1.0, "uav2": 2.0}
    found = receiver.receive(frame(2, ids=(1, 2, 1)))
    assert ([p.body for p in found.poses], found.untracked) == (["uav2"], ("uav1",))
    assert receiver.counts["duplicate ids"] == 1 and receiver.shared_ids_in_frame == {"uav1": 1}
    assert east(receiver, frame(3, ids=(1, 2))) == {"uav1": 1.0, "uav2": 2.0}


def test_id_that_two_bodies_have_gives_no_pose_even_if_one_is_hidden():
    receiver = connected_receiver((1, "wand"), (1, "uav1"), (2, "uav2"), wanted=["uav1", "uav2"])
    assert east(receiver, frame(1, ids=(1, 2))) == {"uav2": 2.0}
    assert receiver.shared_ids == {"uav1": 1} and not receiver.is_connected
    receiver.receive(models((1, "wand"), (3, "uav1"), (2, "uav2")))
    assert east(receiver, frame(2, ids=(1, 2, 3))) == {"uav1": 3.0, "uav2": 2.0}
    assert receiver.shared_ids == {}


def test_frame_time_is_its_exposure_or_else_the_server_time():
    assert connected_receiver().receive(frame(1, exposure_ticks=2500, stamp=9.0)).time_s == 2.5
    assert connected_receiver().receive(frame(1, exposure_ticks=0, stamp=9.0)).time_s == 9.0


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf])
def test_frame_without_a_finite_time_is_malformed(stamp):
    receiver = connected_receiver()
    assert receiver.receive(frame(1, stamp=stamp)) is None
    assert receiver.counts["malformed"] == 1


def test_body_kilometres_away_is_dropped_and_counted():
    far = natnet.Body(streaming_id=1, position=(3e30, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
    lost = natnet.Body(
        streaming_id=2, position=(0.0, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0), tracked=False
    )
    receiver = connected_receiver()
    found = receiver.receive(
        natnet.encode_frame(natnet.Frame(number=1, timestamp_s=1.0, exposure_ticks=0, bodies=(far, lost)), V)
    )
    assert (found.poses, found.untracked) == ((), ("uav1", "uav2"))
    assert receiver.counts["no pose"] == 1


def test_section_with_an_impossible_size_is_malformed():
    for size in (-8, 1 << 20):
        payload = struct.pack("<iii", 1, 1, size) + b"uav1\0" + bytes(60)
        receiver = NatNetReceiver(None)
        receiver.receive(INFO)
        receiver.receive(natnet.packet(natnet.MODELDEF, payload))
        assert receiver.counts["malformed"] == 1
