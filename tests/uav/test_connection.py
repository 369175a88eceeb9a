"""The connection of a program: motion capture from one server or several."""

from __future__ import annotations

import pytest

from arena.clock import WallClock
from arena.mocap.client import CapturedFrame, Pose
from arena.uav.connection import Connection
from arena.uav.poses import Poses

from .conftest import free_address


class FakeClient:
    """A client whose server has every wanted body, at its own north coordinate."""

    made: list[FakeClient]

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
def clients(monkeypatch):
    monkeypatch.setattr(FakeClient, "made", [], raising=False)
    monkeypatch.setattr("arena.mocap.client.open_client", FakeClient)
    return FakeClient.made


def north_of_each_body(capture) -> tuple:
    poses = Poses("b1", [("uav2", "b2"), ("uav3", "b3")])
    host, port = free_address()
    connection = Connection(f"udpin:{host}:{port}", 1, WallClock(), poses, capture)
    connection.poll()
    connection.close()
    return tuple(p and p.position[0] for p in (poses.own, *poses.neighbours))


def test_each_server_is_asked_for_its_own_bodies(clients):
    emulator, vendor = {"north": 1.0, "bodies": ["b1", "b3"]}, {"north": 2.0, "bodies": ["b2"]}
    assert north_of_each_body([emulator, vendor]) == (1.0, 2.0, 1.0)
    assert [r.settings["bodies"] for r in clients] == [["b1", "b3"], ["b2"]]
    assert all(r.closed for r in clients)


def test_body_of_two_servers_is_taken_from_the_first(clients):
    assert north_of_each_body([{"north": 1.0, "bodies": ["b1", "b2"]}, {"north": 2.0, "bodies": None}]) == (
        1.0,
        1.0,
        2.0,
    )


def test_server_without_a_wanted_body_is_not_opened(clients):
    assert north_of_each_body([{"north": 1.0, "bodies": ["wand"]}, {"north": 2.0, "bodies": ["b1"]}]) == (
        2.0,
        None,
        None,
    )
    assert len(clients) == 1


def test_single_server_is_asked_for_all_bodies(clients):
    assert north_of_each_body({"north": 1.0, "bodies": ["b1"]}) == (1.0, 1.0, 1.0)
    assert north_of_each_body(None) == (None, None, None)
