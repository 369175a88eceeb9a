"""One motion capture client for several vehicles of a process."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from arena.kernels.capture_types import Pose
from arena.uav.poses import Poses
from arena.uav.shared_capture import SharedCapture, SharedClient
from arena.wire.pose_page import PosePageWriter


class Client:
    """Motion capture client that counts its bodies."""

    def __init__(self, _: object) -> None:
        self.bodies: list[str] = []
        self.closed = False

    def add_body(self, body: str) -> None:
        assert not self.closed
        self.bodies.append(body)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> SharedCapture:
    monkeypatch.setattr("arena.mocap.client.open_client", Client)
    return SharedCapture()


def poses() -> Any:
    """Return an object that stands for the poses of a vehicle."""
    return SimpleNamespace()


def test_vehicles_of_one_server_share_a_client(capture: SharedCapture) -> None:
    one, two = capture.open({"host": "a"}, "uav1", poses()), capture.open({"host": "a"}, "uav2", poses())
    assert one is two and one is not capture.open({"host": "b"}, "uav3", poses())


def test_client_that_another_vehicle_closes_at_this_moment_is_not_used(
    capture: SharedCapture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other thread closes the client after `open` has found it, and before the new vehicle is added."""
    first: Poses = poses()
    shared = capture.open({"host": "a"}, "uav1", first)
    add = SharedClient.add

    def closed_before(client: SharedClient, body: str, poses: Poses) -> bool:
        if client is shared:
            client.remove(first)
        return add(client, body, poses)

    monkeypatch.setattr(SharedClient, "add", closed_before)
    second = capture.open({"host": "a"}, "uav2", poses())
    assert second is not shared and not second.closed


def test_poses_of_a_page_are_stored_with_the_time_at_which_they_are_read(tmp_path: Path) -> None:
    page, own = PosePageWriter(tmp_path / "poses", ["uav1", "uav2"]), Poses("uav2")
    settings = {"kind": "page", "path": str(tmp_path / "poses"), "row": 1}
    client = SharedCapture().open(settings, "uav2", own)
    client.poll(0.5, once=True)
    assert own.own is None
    page.write((Pose("uav2", (1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0)),))
    client.poll(1.5, once=True)
    assert own.own is not None
    assert (own.own.received_at, own.own.p_n.tolist()) == (1.5, [1.0, 2.0, -3.0])
    client.poll(2.5, once=True)
    assert own.own.received_at == 1.5, "an old pose does not become new"
