"""Planned paths on their way from a program to viewers: recorder's socket, files, feed."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.live_view.planned_paths import PlannedPaths
from arena.recorder.channels import Recorded
from arena.recorder.path_files import PathFiles
from arena.recorder.router_copies import CopySenders
from arena.wire.planned_path import path_messages

VEHICLES = [
    Recorded(name="uav1", id=1, body="uav1", index=0),
    Recorded(name="uav2", id=2, body="uav2", index=1),
]


def datagrams(points, time_us, system):
    codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    return [m.pack(codec) for m in path_messages(np.array(points, float).reshape(-1, 3), time_us)]


def test_viewer_reads_the_newest_path_of_each_vehicle(tmp_path):
    files, paths = (
        PathFiles(VEHICLES, tmp_path / "paths"),
        PlannedPaths(str(tmp_path / "paths"), ["uav1", "uav2"]),
    )
    paths.poll()
    assert [len(p) for p in paths.newest] == [0, 0]
    before = paths.newest
    points = np.linspace((0, 0, -1), (3, 2, -1), 13)
    for data in datagrams(points, 5, 2):
        files.on_datagrams([("uav2", True, data, 1.0)])
    assert files._writer.flush(30)
    paths.poll()
    assert paths.newest[1] == pytest.approx(points, abs=1e-6) and len(paths.newest[0]) == 0
    assert paths.newest is not before
    again = paths.newest
    paths.poll()
    assert paths.newest is again, "unchanged"
    for data in datagrams([], 6, 2):
        files.on_datagrams([("uav2", True, data, 2.0)])
    assert files._writer.flush(30)
    paths.poll()
    assert len(paths.newest[1]) == 0


def test_broken_file_keeps_the_path_before(tmp_path):
    (tmp_path / "uav1.json").write_text("[[1, 2, -3]]")
    paths = PlannedPaths(str(tmp_path), ["uav1"])
    paths.poll()
    (tmp_path / "uav1.json").write_text("[[1, 2")
    paths.poll()
    assert paths.newest[0].tolist() == [[1, 2, -3]]


def test_folder_that_cannot_be_written_raises_nothing(tmp_path):
    (tmp_path / "paths").write_text("a file, no folder")
    files = PathFiles(VEHICLES, tmp_path / "paths")
    for data in datagrams([(1, 2, -3)], 5, 1):
        files.on_datagrams([("uav1", True, data, 1.0)])
    assert files._writer.flush(30)


def test_recorder_accepts_paths_of_its_programs_only():
    vehicles = [{"name": "uav1", "id": 1, "serve": ("127.0.0.1", 1), "tools": ("127.0.0.1", 2)}]
    senders = CopySenders(vehicles)
    (mine,), (other,) = datagrams([(1, 2, -3)], 5, 1), datagrams([(1, 2, -3)], 5, 9)
    assert senders.find(("127.0.0.1", 40000), mine) == ("uav1", True)
    assert senders.find(("127.0.0.1", 40000), other) is None and senders.unknown == 1
