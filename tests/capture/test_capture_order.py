"""Whose pose is whose: repeated frames, restarted servers, renamed bodies: never one body in the place of another."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.mocap.client.frame_order import FrameOrder
from arena.mocap.client.natnet import NatNetReceiver
from arena.wire import natnet

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


def shaken(*bodies: tuple[int, str], wanted=None) -> NatNetReceiver:
    receiver = NatNetReceiver(wanted)
    receiver.hear(INFO)
    receiver.hear(models(*(bodies or ((1, "uav1"), (2, "uav2")))))
    return receiver


def east(receiver: NatNetReceiver, data: bytes) -> dict[str, float]:
    found = receiver.hear(data)
    return {} if found is None else {p.body: p.p_n[1] for p in found.poses}


def test_a_frame_that_comes_twice_is_one_frame():
    receiver = shaken()
    assert receiver.hear(frame(7))
    assert receiver.hear(frame(7)) is None
    assert receiver.hear(frame(6)) is None
    assert receiver.counts["repeated"] == 2
    assert receiver.hear(frame(8))


def test_one_old_frame_is_never_believed_however_old():
    receiver = shaken()
    assert receiver.hear(frame(1_000_000))
    assert receiver.hear(frame(3)) is None
    assert receiver.known
    assert receiver.hear(frame(1_000_001))


def test_a_server_that_counts_from_the_start_again_is_asked_for_its_bodies_anew():
    """The swap that flies one vehicle into another: after a restart the ids have changed places."""
    receiver = shaken((1, "uav1"), (2, "uav2"))
    assert east(receiver, frame(5000)) == {"uav1": 1.0, "uav2": 2.0}
    assert all(not east(receiver, frame(n)) for n in range(0, 40))
    assert not receiver.known
    assert receiver.counts["restarted"] == 1
    receiver.hear(INFO)
    assert not receiver.known, "its old names went with it"
    assert not east(receiver, frame(41))
    receiver.hear(models((1, "uav2"), (2, "uav1")))
    assert east(receiver, frame(42)) == {"uav2": 1.0, "uav1": 2.0}


def test_names_do_not_outlive_the_silence_of_their_server():
    receiver = shaken()
    receiver.forget()
    receiver.hear(INFO)
    assert not receiver.known
    assert receiver.hear(frame(9)) is None


def test_a_frame_that_says_its_models_changed_names_nobody_until_they_are_known_again():
    receiver = shaken((1, "uav1"), (2, "uav2"))
    assert receiver.hear(frame(1, changed=True)) is None
    assert natnet.message_of(receiver.ask()) == natnet.REQUEST_MODELDEF
    receiver.hear(models((2, "uav1"), (1, "uav2")))
    assert east(receiver, frame(2, changed=True)) == {"uav1": 2.0, "uav2": 1.0}, (
        "a bit that stays set is no new change"
    )
    assert receiver.hear(frame(3))
    assert receiver.hear(frame(4, changed=True)) is None


def test_a_name_that_two_bodies_bear_is_nobodys():
    receiver = shaken((1, "uav1"), (2, "uav1"), (3, "uav3"))
    assert east(receiver, frame(1, ids=(1, 2, 3))) == {"uav3": 3.0}
    assert receiver.counts["names borne twice"] == 1


def test_a_frame_is_dated_by_its_exposure_and_by_the_servers_time_where_there_is_none():
    assert shaken().hear(frame(1, exposure_ticks=2500, stamp=9.0)).time_s == 2.5
    assert shaken().hear(frame(1, exposure_ticks=0, stamp=9.0)).time_s == 9.0


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf])
def test_a_frame_without_a_time_is_malformed(stamp):
    receiver = shaken()
    assert receiver.hear(frame(1, stamp=stamp)) is None
    assert receiver.counts["malformed"] == 1


def test_a_body_kilometres_away_is_no_pose_and_is_counted_apart_from_an_occluded_one():
    far = natnet.Body(streaming_id=1, position=(3e30, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
    lost = natnet.Body(
        streaming_id=2, position=(0.0, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0), tracked=False
    )
    receiver = shaken()
    found = receiver.hear(
        natnet.encode_frame(natnet.Frame(number=1, timestamp_s=1.0, exposure_ticks=0, bodies=(far, lost)), V)
    )
    assert (found.poses, found.untracked) == ((), ("uav1", "uav2"))
    assert receiver.counts["no pose"] == 1


@given(st.lists(st.integers(-(2**31), 2**31 - 1), max_size=60))
def test_whatever_the_numbers_new_ones_rise_until_a_restart(numbers):
    order, newest = FrameOrder(), None
    for number in numbers:
        place = order.place(number)
        if place == "new":
            assert newest is None or number > newest
        if place != "repeated":
            newest = number


def test_a_restart_takes_nine_in_a_row_that_count_up():
    order = FrameOrder()
    order.place(100)
    assert [order.place(n) for n in range(8)] == ["repeated"] * 8
    order.place(101)
    assert [order.place(50)] * 20 == ["repeated"] * 20
    assert [order.place(n) for n in range(1, 10)] == ["repeated"] * 8 + ["restarted"]
    assert order.place(10) == "new"


def test_a_section_that_reaches_back_or_past_the_end_is_malformed():
    for size in (-8, 1 << 20):
        payload = struct.pack("<iii", 1, 1, size) + b"uav1\0" + bytes(60)
        receiver = NatNetReceiver(None)
        receiver.hear(INFO)
        receiver.hear(natnet.packet(natnet.MODELDEF, payload))
        assert receiver.counts["malformed"] == 1
