"""Files that `arena fly` reads, and the straight line to their start."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.errors import InputError
from arena.fly.trajectory_file import read_trajectory
from arena.trajectories import Sampled, SetpointList, StraightLine


def write(folder, text):
    file = folder / "path.csv"
    file.write_text(text)
    return file


def test_file_with_times_is_a_trajectory(tmp_path):
    found = read_trajectory(write(tmp_path, "t,north,east,down\n0,0,0,-1\n2,1,0,-1\n4,1,1,-1\n"))
    assert isinstance(found, Sampled) and found.duration_s == 4.0


def test_file_with_hold_times_is_a_list_of_setpoints(tmp_path):
    found = read_trajectory(write(tmp_path, "north,east,down,yaw,hold_s\n0,0,-1,0,2\n1,0,-1.5,1.5,3\n"))
    assert isinstance(found, SetpointList) and found.duration_s == 5.0
    assert found.at(3.0).pos.tolist() == [1.0, 0.0, -1.5] and found.at(3.0).yaw == 1.5


@pytest.mark.parametrize("row", ["0,0,-1", "0,0,-1,x", "0,0,-1,0"])
def test_bad_setpoint_names_file_and_reason(tmp_path, row):
    with pytest.raises(InputError, match=r"path\.csv:2|setpoint list"):
        read_trajectory(write(tmp_path, f"north,east,down,hold_s\n{row}\n"))


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv"):
        read_trajectory(tmp_path / "none.csv")


def test_straight_line_keeps_its_greatest_speed_and_ends_at_rest():
    line = StraightLine((0, 0, -1), (3, 4, -1), speed=1.0)
    speeds = [float(np.linalg.norm(line.at(t).vel)) for t in np.linspace(0, line.duration_s, 201)]
    assert max(speeds) == pytest.approx(1.0, abs=1e-3) and speeds[-1] == pytest.approx(0.0, abs=1e-9)
    assert line.at(line.duration_s).pos == pytest.approx([3, 4, -1])


def test_straight_line_turns_by_the_shorter_way():
    line = StraightLine((0, 0, -1), (1, 0, -1), speed=1.0, yaw=(math.radians(170), math.radians(-170)))
    assert math.degrees(line.at(line.duration_s).yaw) == pytest.approx(190.0)
