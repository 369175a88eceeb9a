"""Planned path of a program: it is published to the recorder, and never sent to the vehicle."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
import pytest

from arena.errors import SetpointError
from arena.trajectories import Circle, Moved, Reference, positions_along
from arena.uav.planned_path import PathPublisher
from arena.wire.planned_path import PATH_MESSAGE, PathAssembler, may_contain_path

from .conftest import make_uav

CIRCLE = Circle((0.0, 0.0, -1.0), 1.0, lap_s=6.0)


class OwnTrajectory:
    """A trajectory of a user, whose method `at` has side effects."""

    duration_s = 0.1

    def __init__(self) -> None:
        self.asked: list[float] = []

    def at(self, t: float) -> Reference:
        self.asked.append(t)
        return Reference(pos=np.array([0.0, 0.0, -1.0]))


@pytest.fixture
def recorder() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(60.0)
        yield sock


def received(recorder: socket.socket, least: int) -> np.ndarray:
    """Return the points of the path that has arrived. Wait until there are `least` of them."""
    path = PathAssembler(1)
    while len(path.points) < least:
        path.on_datagram(recorder.recv(4096))
    return np.array(path.points)


def test_path_arrives_at_the_recorder_and_not_at_the_vehicle(autopilot, address, recorder):
    points = np.linspace((0, 0, -1), (2, 1, -2), 12)
    sent: list[bytes] = []
    with make_uav(address, log=recorder.getsockname()) as uav:
        inner = uav._connection._send_frame

        def spy(data, to):
            sent.append((may_contain_path(data), to))
            inner(data, to)

        uav._connection._send_frame = spy
        uav.planned_path(points)
    assert received(recorder, 12) == pytest.approx(points, abs=1e-6)
    assert {to for is_path, to in sent if is_path} == {recorder.getsockname()}


def test_path_of_wrong_shape_is_refused(uav):
    for points in ([1, 2, 3], [[1, 2]], [[1, 2, float("nan")]]):
        with pytest.raises(SetpointError, match="planned_path"):
            uav.planned_path(points)


def test_path_of_a_library_trajectory_goes_from_its_beginning_to_its_end():
    moved = Moved(trajectory=CIRCLE, offset=np.array([1.0, 2.0, 0.0]))
    found = positions_along(moved)
    assert found[0] == pytest.approx(moved.at(0.0).pos) and found[-1] == pytest.approx(
        moved.at(moved.duration_s).pos
    )
    assert 20 < len(found) <= 200


def test_trajectory_of_a_user_is_not_evaluated_ahead():
    own = OwnTrajectory()
    assert positions_along(own) is None
    assert positions_along(Moved(trajectory=own, offset=np.zeros(3))) is None
    assert own.asked == []


def test_path_of_a_trajectory_is_removed_at_its_end():
    sent = []
    paths = PathPublisher(sent.append)
    paths.publish_trajectory(CIRCLE, 1.0)
    assert sum(m.valid_points for m in sent) == len(positions_along(CIRCLE))
    paths.end_trajectory(2.0)
    assert sent[-1].valid_points == 0 and sent[-1].time_usec > sent[0].time_usec


def test_end_of_an_own_trajectory_keeps_the_path_that_the_program_has_published():
    sent = []
    paths = PathPublisher(sent.append)
    paths.publish([[0, 0, -1], [1, 0, -1]], 1.0)
    paths.publish_trajectory(OwnTrajectory(), 1.5)
    paths.end_trajectory(2.0)
    assert len(sent) == 1


def test_line_to_a_goal_is_published_once():
    sent = []
    paths = PathPublisher(sent.append)
    for now in (1.0, 1.5, 2.0):
        paths.publish_line(lambda: np.zeros(3), [1.0, 0.0, -1.0], 4.0, now)
    assert len(sent) == 1 and sent[0].get_msgId() == PATH_MESSAGE
    paths.publish_line(lambda: np.zeros(3), [1.0, 1.0, -1.0], 4.0, 2.5)
    assert len(sent) == 2 and sent[1].time_usec > sent[0].time_usec


def test_streamed_setpoints_publish_no_path():
    sent = []
    paths = PathPublisher(sent.append)
    for k in range(50):
        paths.publish_line(lambda: np.zeros(3), [0.1 * k, 0.0, -1.0], 0.02, 0.02 * k)
    assert sent == []


def test_unknown_position_or_wrong_goal_publishes_no_path_and_raises_nothing(autopilot, address):
    sent = []
    paths = PathPublisher(sent.append)
    with make_uav(address, stale_s=1e-9) as uav:
        paths.publish_line(lambda: uav.ekf.pos, [1, 0, -1], 4.0, 1.0)
    for goal in ([1, 2], "north", [1, 2, float("nan")]):
        paths.publish_line(lambda: np.zeros(3), goal, 4.0, 1.0)
    assert sent == []


def test_two_paths_of_one_instant_are_two_paths():
    sent = []
    paths = PathPublisher(sent.append)
    paths.publish([[0, 0, -1], [1, 0, -1]], 5.0)
    paths.publish([[2, 0, -1], [3, 0, -1]], 5.0)
    assert sent[0].time_usec != sent[1].time_usec
