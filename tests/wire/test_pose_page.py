"""The pose page: the newest captured pose of each body, read once, and never a half of it."""

from __future__ import annotations

import mmap

import pytest

from arena.errors import RunError
from arena.kernels.capture_types import Pose
from arena.kernels.captured_poses import POSE_ROW
from arena.wire.pose_page import PosePageWriter, PoseRow

ONE = Pose("uav1", (1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0))
TWO = Pose("uav2", (4.0, 5.0, -6.0), (0.0, 1.0, 0.0, 0.0))


def test_each_pose_is_read_once(tmp_path):
    writer = PosePageWriter(tmp_path / "poses", ["uav1", "uav2"])
    first, second = PoseRow(tmp_path / "poses", 0), PoseRow(tmp_path / "poses", 1)
    assert first.new_pose() is None and second.new_pose() is None, "no pose before the first"
    writer.write((TWO,))
    assert first.new_pose() is None
    assert second.new_pose() == [*TWO.p_n, *TWO.q_nb]
    assert second.new_pose() is None, "an untracked body keeps its old pose, which is not new"
    writer.write((ONE, TWO._replace(p_n=(7.0, 8.0, -9.0))))
    assert first.new_pose() == [*ONE.p_n, *ONE.q_nb]
    assert second.new_pose() == [7.0, 8.0, -9.0, *TWO.q_nb]


def test_newest_of_several_poses_is_read(tmp_path):
    writer, row = PosePageWriter(tmp_path / "poses", ["uav1"]), PoseRow(tmp_path / "poses", 0)
    for up_m in range(5):
        writer.write((ONE._replace(p_n=(0.0, 0.0, -float(up_m))),))
    assert row.new_pose() == [0.0, 0.0, -4.0, *ONE.q_nb]
    assert row.new_pose() is None


def test_pose_from_before_the_reader_is_not_new(tmp_path):
    """A program that is started again must not take the last pose of a lost body for a fresh one."""
    writer = PosePageWriter(tmp_path / "poses", ["uav1"])
    writer.write((ONE,))
    row = PoseRow(tmp_path / "poses", 0)
    assert row.new_pose() is None
    writer.write((ONE,))
    assert row.new_pose() == [*ONE.p_n, *ONE.q_nb]


def test_body_without_a_row_is_left_out(tmp_path):
    writer, row = PosePageWriter(tmp_path / "poses", ["uav1"]), PoseRow(tmp_path / "poses", 0)
    writer.write((TWO, ONE))
    assert row.new_pose() == [*ONE.p_n, *ONE.q_nb]


def test_pose_that_is_being_written_is_not_read(tmp_path):
    writer, row = PosePageWriter(tmp_path / "poses", ["uav1"]), PoseRow(tmp_path / "poses", 0)
    writer.write((ONE,))
    with (tmp_path / "poses").open("r+b") as file:
        page = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")
    page[0], page[1] = 2.0, 99.0  # the writer has begun the second pose
    assert row.new_pose() is None
    page[POSE_ROW - 1] = 2.0
    assert row.new_pose() == [99.0, *ONE.p_n[1:], *ONE.q_nb]


def test_missing_page_and_row_are_errors(tmp_path):
    with pytest.raises(RunError, match="no shared memory with the captured poses"):
        PoseRow(tmp_path / "poses", 0)
    PosePageWriter(tmp_path / "poses", ["uav1"])
    for row in (1, -1):
        with pytest.raises(RunError, match="has no row"):
            PoseRow(tmp_path / "poses", row)
