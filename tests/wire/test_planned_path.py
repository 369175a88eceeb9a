"""Planned paths as MAVLink messages: nothing is lost, a new path replaces the old one, messages of others are ignored."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.planned_path import MAX_POINTS, PathAssembler, may_contain_path, path_messages

PROGRAM = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER


def datagrams(points, time_us, system=3, component=PROGRAM):
    codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return [m.pack(codec) for m in path_messages(np.array(points, float).reshape(-1, 3), time_us)]


def received(*groups):
    path = PathAssembler(3)
    for group in groups:
        for data in group:
            path.on_datagram(data)
    return np.array(path.points).reshape(-1, 3)


@pytest.mark.parametrize("count", [1, 2, 5, 6, 137, MAX_POINTS])
def test_path_arrives_point_for_point(count):
    points = np.random.default_rng(count).uniform(-5, 5, (count, 3))
    assert received(datagrams(points, 7)) == pytest.approx(points, abs=1e-6)


def test_longer_path_is_thinned_out_and_keeps_its_ends():
    points = np.linspace((0, 0, 0), (9, 3, -2), 1000)
    found = received(datagrams(points, 7))
    assert len(found) == MAX_POINTS
    assert found[0] == pytest.approx(points[0]) and found[-1] == pytest.approx(points[-1], abs=1e-6)


def test_new_path_replaces_the_old_one_and_an_empty_one_removes_it():
    old, new = datagrams([(1, 2, -3)] * 7, 7), datagrams([(4, 5, -6)] * 2, 8)
    assert received(old, new) == pytest.approx(np.array([(4, 5, -6)] * 2))
    assert len(received(old, datagrams([], 9))) == 0


def test_messages_of_another_system_or_component_are_ignored():
    for group in (datagrams([(1, 2, -3)], 7, system=4), datagrams([(1, 2, -3)], 7, component=1)):
        assert len(received(group)) == 0


def test_datagrams_are_recognised_by_their_message_id():
    assert all(may_contain_path(data) for data in datagrams([(1, 2, -3)] * 9, 7))
    other = mavlink.MAVLink_system_time_message(0, 0).pack(mavlink.MAVLink(None, srcSystem=3))
    assert not may_contain_path(other) and not may_contain_path(b"\xfd")


def test_endless_messages_of_one_path_need_no_more_memory():
    path = PathAssembler(3)
    for _ in range(200):
        for data in datagrams([(1, 2, -3)] * 5, 7):
            path.on_datagram(data)
    assert len(path.points) == MAX_POINTS
