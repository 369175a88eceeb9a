"""A program whose vehicles are seen by one server or by several."""

from __future__ import annotations

import pytest

from arena.clock import WallClock
from arena.mocap.client import CapturedFrame, Pose
from arena.uav.connection import Connection
from arena.uav.poses import Poses

from .fake import free_address


class FakeReceiver:
    """Sees the bodies it was asked for, at a place of its own."""

    made: list[FakeReceiver]

    def __init__(self, settings: dict) -> None:
        self.settings, self.closed, self.number = settings, False, 0
        self.made.append(self)

    def poll(self, now: float) -> list[CapturedFrame]:
        self.number += 1
        poses = tuple(
            Pose(b, (self.settings["north"], 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)) for b in self.settings["bodies"]
        )
        return [CapturedFrame(self.number, now, poses, ())]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def receivers(monkeypatch):
    monkeypatch.setattr(FakeReceiver, "made", [], raising=False)
    monkeypatch.setattr("arena.mocap.client.open_client", FakeReceiver)
    return FakeReceiver.made


def places(capture) -> tuple:
    poses = Poses("b1", [("uav2", "b2"), ("uav3", "b3")])
    host, port = free_address()
    link = Connection(f"udpin:{host}:{port}", 1, WallClock(), poses, capture)
    link._look()
    link.close()
    return tuple(p and p.place[0] for p in (poses.own, *poses.neighbours))


def test_each_server_is_asked_for_its_own_bodies_alone(receivers):
    emulator, vendor = {"north": 1.0, "bodies": ["b1", "b3"]}, {"north": 2.0, "bodies": ["b2"]}
    assert places([emulator, vendor]) == (1.0, 2.0, 1.0)
    assert [r.settings["bodies"] for r in receivers] == [["b1", "b3"], ["b2"]]
    assert all(r.closed for r in receivers)


def test_a_body_that_two_servers_would_see_is_taken_from_one(receivers):
    assert places([{"north": 1.0, "bodies": ["b1", "b2"]}, {"north": 2.0, "bodies": None}]) == (1.0, 1.0, 2.0)


def test_a_server_that_sees_none_of_them_is_not_spoken_to(receivers):
    assert places([{"north": 1.0, "bodies": ["wand"]}, {"north": 2.0, "bodies": ["b1"]}]) == (2.0, None, None)
    assert len(receivers) == 1


def test_a_server_that_stands_alone_is_asked_for_all(receivers):
    assert places({"north": 1.0, "bodies": ["b1"]}) == (1.0, 1.0, 1.0)
    assert places(None) == (None, None, None)
