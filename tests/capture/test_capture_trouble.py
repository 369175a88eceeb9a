"""Why no pose comes: each cause is told apart, once, with what to do."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arena.mocap.client.diagnosis import WELL, Complaint, Condition, sentence
from arena.mocap.client.natnet import NatNetReceiver
from arena.mocap.client.reception import Watch
from arena.wire import natnet

BASE = Condition(
    server="10.0.0.5",
    command_port=1510,
    data_port=1511,
    transport="multicast",
    group="239.255.42.99",
    local="10.0.0.9",
)


def info(version=(4, 1), port=1511, group="239.255.42.99") -> natnet.ServerInfo:
    return natnet.ServerInfo(
        name="x", app_version=(3, 1, 0, 0), version=version, clock_hz=1, data_port=port, group=group
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "no answer from 10.0.0.5:1510"),
        ({"early": True}, "though its frames arrive"),
        ({"stranger": "10.0.0.6"}, "10.0.0.6 streams to the same group"),
        ({"closed": "no interface"}, "no way to 10.0.0.5"),
        ({"answered": info((2, 10)), "refused": True}, "NatNet 2.10"),
        ({"answered": info()}, "firewalls let UDP 1511"),
        ({"answered": info(group="")}, "mocap.transport: unicast"),
        ({"answered": info(), "transport": "unicast"}, "mocap.transport: multicast"),
        ({"answered": info(port=1999)}, "port 1999"),
        ({"answered": info(), "garbled": True}, "not laid out as NatNet 4.1"),
        ({"answered": info(), "stranger": "10.0.0.6"}, "frames come from 10.0.0.6"),
        ({"streaming": True, "missing": ["uav1"], "names": ["Uav_1", "wand"]}, "meant 'Uav_1'"),
        ({"streaming": True, "missing": ["uav1"]}, "no bodies at all"),
        ({"streaming": True, "twice": ["uav1"]}, "two bodies called 'uav1'"),
        ({"streaming": True, "hidden": ["uav1"]}, "does not track 'uav1'"),
    ],
)
def test_each_cause_has_its_own_words(changes, words):
    assert words in sentence(replace(BASE, **changes))


def test_when_all_is_well_nothing_is_said():
    assert sentence(replace(BASE, streaming=True, names=["uav1"])) == ""


def test_a_trouble_is_told_once_and_so_is_its_end():
    complaint = Complaint()
    assert [complaint.news(t) for t in ("", "a", "a", "b", "", "")] == [None, "a", None, "b", WELL, None]


def test_a_body_is_hidden_only_after_a_while_and_not_when_it_comes_back():
    receiver, watch = NatNetReceiver(["uav1"]), Watch(0.0)
    receiver.hear(natnet.encode_server_info(info()))
    receiver.hear(natnet.encode_models([(1, "uav1")], (4, 1)))

    def see(wall: float, tracked: bool) -> list[str]:
        body = natnet.Body(
            streaming_id=1, position=(0.0, 0.0, 1.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0), tracked=tracked
        )
        sent = natnet.Frame(number=int(wall * 10), timestamp_s=wall, exposure_ticks=0, bodies=(body,))
        found = receiver.hear(natnet.encode_frame(sent, (4, 1)))
        watch.look(receiver, [found], wall)
        return list(watch.condition(receiver, wall, BASE).hidden)

    assert [see(t, tracked=False) for t in (0.1, 1.0, 2.0)] == [[], [], []]
    assert see(2.2, tracked=False) == ["uav1"]
    assert see(2.3, tracked=True) == []
    assert see(3.0, tracked=False) == []


def test_a_version_that_is_not_understood_is_refused_by_name_and_no_frame_of_it_is_read():
    receiver, watch = NatNetReceiver(None), Watch(0.0)
    receiver.hear(natnet.encode_server_info(info((2, 9))))
    watch.look(receiver, [], 1.0)
    assert not receiver.known and receiver.counts["version not understood"] == 1
    assert "NatNet 2.9" in sentence(watch.condition(receiver, 1.0, BASE))
