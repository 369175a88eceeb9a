"""Poses that an autopilot has received, from its own log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_flights import make_run
from ulog_files import write_ulog

from arena.report.figures import drawn
from arena.report.link_record import LinkRecord
from arena.report.run_data import read_run
from arena.report.system_figures import links_figure
from arena.report.system_rows import link_row
from arena.report.vision_times import vision_times


def write_log(folder, stamps_s):
    (folder / "ulog").mkdir(exist_ok=True)
    rows = [(round(1e6 * t), 1.0) for t in stamps_s]
    fields = {"timestamp": "uint64_t", "x": "float"}
    write_ulog(folder / "ulog" / "uav1.ulg", {"vehicle_visual_odometry": (fields, rows)})


def test_times_of_the_logged_poses_are_read(tmp_path):
    write_log(tmp_path, (5.0, 5.04, 5.08))
    assert vision_times(tmp_path, "uav1") == pytest.approx([5.0, 5.04, 5.08])
    assert vision_times(tmp_path, "uav2").size == 0


def test_damaged_log_has_no_poses(tmp_path):
    (tmp_path / "ulog").mkdir()
    (tmp_path / "ulog" / "uav1.ulg").write_bytes(b"no log")
    assert vision_times(tmp_path, "uav1").size == 0


def test_gap_begins_when_the_poses_to_the_autopilot_stop(tmp_path):
    run = read_run(make_run(tmp_path / "run"))
    received = np.arange(
        5.0, 15.0, 1 / 180
    )  # motion capture repeats a pose from 8 s on, which the forwarder drops
    link = LinkRecord(
        pose_s=received, pose_age_s=np.full(received.size, 0.01), vision_s=np.arange(5.0, 8.0, 0.04)
    )
    (one,) = drawn(run.flights, {"uav1": 0.0})
    row = link_row(one, replace(run, links={"uav1": link}))
    assert row["pose_gap"].length_s < 0.1
    assert row["vision_gap"].at_s == pytest.approx(7.96) and row["vision_gap"].length_s > 2.0
    (sent,) = [
        t for t in links_figure([one], {"uav1": link})["data"] if t["meta"]["curve"].endswith("autopilot")
    ]
    assert sent["y"][0] == pytest.approx(25.0, abs=2.0) and sent["y"][-1] == 0.0
