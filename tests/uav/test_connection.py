"""The connection of a program: motion capture and measurements of relative sensors."""

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


def opened(body, capture) -> Connection:
    host, port = free_address()
    return Connection(f"udpin:{host}:{port}", 1, WallClock(), Poses(body), capture)


def test_only_the_own_body_is_requested_and_stored(clients):
    connection = opened("b1", {"north": 1.0, "bodies": ["b1", "b2"]})
    connection.poll()
    connection.close()
    assert [r.settings["bodies"] for r in clients] == [["b1"]] and clients[0].closed
    assert connection.poses.own is not None and connection.poses.own.position[0] == 1.0


@pytest.mark.parametrize(("body", "capture"), [(None, {"north": 1.0}), ("b1", None)])
def test_without_body_or_settings_no_client_is_opened(clients, body, capture):
    connection = opened(body, capture)
    connection.poll()
    connection.close()
    assert not clients and connection.poses.own is None
