"""The diagnosis of a NatNet client: each cause has a sentence of its own that says what to do."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arena.mocap.client.reception import BodyStatus
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet.diagnosis import Condition, diagnose
from arena.mocap.natnet.receiver import NatNetReceiver

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
        ({"foreign": "10.0.0.6"}, "10.0.0.6 streams to the same group"),
        ({"no_network": "no interface"}, "no network route to 10.0.0.5"),
        ({"answered": info((2, 10)), "version_unsupported": True}, "NatNet 2.10"),
        ({"answered": info()}, "firewalls let UDP 1511"),
        ({"answered": info(group="")}, "mocap.transport: unicast"),
        ({"answered": info(), "transport": "unicast"}, "mocap.transport: multicast"),
        ({"answered": info(port=1999)}, "port 1999"),
        ({"answered": info(), "malformed": True}, "do not have the layout of NatNet 4.1"),
        ({"answered": info(), "foreign": "10.0.0.6"}, "frames come from 10.0.0.6"),
        (
            {"streaming": True, "bodies": BodyStatus(missing=["uav1"], names=["Uav_1", "wand"])},
            "mean 'Uav_1'",
        ),
        ({"streaming": True, "bodies": BodyStatus(missing=["uav1"])}, "it has no bodies"),
        ({"streaming": True, "bodies": BodyStatus(duplicate=["uav1"])}, "two bodies called 'uav1'"),
        (
            {"streaming": True, "bodies": BodyStatus(shared_ids={"uav1": 7}, hidden=["uav1"])},
            "two bodies with the id 7 ('uav1' is one of them), so the poses of both are dropped: give one of them",
        ),
        ({"streaming": True, "bodies": BodyStatus(hidden=["uav1"])}, "does not track 'uav1'"),
    ],
)
def test_each_cause_has_its_own_sentence(changes, words):
    assert words in diagnose(replace(BASE, **changes))


def test_diagnosis_is_empty_when_nothing_is_wrong():
    assert diagnose(replace(BASE, streaming=True, bodies=BodyStatus(names=["uav1"]))) == ""


def test_unsupported_version_is_reported_and_its_frames_are_not_decoded():
    receiver = NatNetReceiver(None)
    receiver.receive(natnet.encode_server_info(info((2, 9))))
    assert not receiver.is_connected and receiver.counts["version unsupported"] == 1
    seen = replace(BASE, answered=receiver.info, version_unsupported=receiver.version_unsupported)
    assert "NatNet 2.9" in diagnose(seen)
