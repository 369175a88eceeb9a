"""What a log says of what was heard."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arena.recorder.columns import columns
from arena.recorder.flight_log import read_flight
from arena.recorder.recorder import Recorder

from .synthetic import OFFBOARD, STEPS, flight_csv, stream, truth_at

THESIS_FILES = Path(__file__).parents[3] / "shared" / "data" / "thesis"


def cells(recorder: Recorder, line: str) -> dict[str, str]:
    return dict(zip(recorder.header.strip().split(","), line.strip().split(","), strict=True))


@pytest.mark.parametrize("name", ["setpoints_real_uav2.csv", "formation_gazebo_uav1.csv"])
def test_the_header_begins_as_the_thesis_does(name):
    file = THESIS_FILES / name
    if not file.exists():
        pytest.skip("the thesis's data are not on this machine")
    theirs = file.read_text().splitlines()[0].split(",")
    assert list(columns(True))[: len(theirs)] == theirs


def test_no_column_stands_twice():
    assert len(set(columns(True))) == len(columns(True))
    assert columns(False) == columns(True)[: len(columns(False))]


def test_the_magnetic_field_is_not_the_body_rates_again():
    recorder = Recorder(1, None)
    recorder.hear(stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 1.0)
    row = cells(recorder, recorder.row(1.0, 1.0))
    assert [float(row[f"imu.ang_vel.{x}"]) for x in ("roll", "pitch", "yaw")] == [4, 5, 6]
    assert [float(row[f"imu.mag.{x}"]) for x in ("north", "east", "down")] == pytest.approx(
        [7e-4, 8e-4, 9e-4]
    )


def test_the_captured_attitude_is_the_cameras_own():
    recorder = Recorder(1, None)
    recorder.hear(stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 1.0)
    recorder.hear_pose(np.zeros(3), np.array([np.cos(0.2), 0, 0, np.sin(0.2)]), 1.0)
    row = cells(recorder, recorder.row(1.0, 1.0))
    assert float(row["mocap.att_euler.yaw"]) == pytest.approx(0.4)
    assert float(row["ekf.att_euler.yaw"]) == pytest.approx(0.0)


def test_stale_values_are_empty_cells():
    recorder = Recorder(1, 0)
    recorder.hear(stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 1.0)
    recorder.hear_pose(np.zeros(3), np.array([1.0, 0, 0, 0]), 1.0)
    row = cells(recorder, recorder.row(2.0, 2.0))
    assert {
        row[name]
        for name in row
        if name.startswith(("ekf", "imu", "mocap", "pos_ref", "att", "truth", "err"))
    } == {""}
    assert row["info.flight_mode"] == "OFFBOARD"  # told once a second
    assert cells(recorder, recorder.row(30.0, 30.0))["info.is_armed"] == ""


def test_an_axis_that_is_not_controlled_is_an_empty_cell():
    recorder = Recorder(1, None)
    recorder.hear(stream(1.0, np.zeros(3), (float("nan"),) * 3, OFFBOARD, True, False), 1.0)
    assert cells(recorder, recorder.row(1.0, 1.0))["pos_ref.north"] == ""


def test_an_estimate_is_compared_with_the_truth_of_its_own_instant():
    recorder = Recorder(1, 0)
    recorder.hear(
        stream(100.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 250.0
    )  # the autopilot booted 150 s after us
    recorder.hear(stream(100.1, np.zeros(3), STEPS[0], OFFBOARD, True, False), 250.13)
    assert recorder.estimated_at() == pytest.approx(250.1)
    then = truth_at(np.array([0.5, 0.0, 0.0]), np.zeros(3), (0.0, 0.0, 0.1))
    row = cells(recorder, recorder.row(250.13, 250.13, truth_at(np.array([9.0, 0, 0]), np.zeros(3)), then))
    assert float(row["err.pos.north"]) == pytest.approx(0.01 - 0.5, abs=1e-6)
    assert float(row["err.att_euler.yaw"]) == pytest.approx(-0.1, abs=1e-6)


def test_stamps_in_simulation_time_are_taken_as_they_are():
    recorder = Recorder(1, 0)
    recorder.hear(stream(100.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 100.012)
    assert recorder.estimated_at() == 100.0


def test_another_vehicles_messages_are_not_logged():
    recorder = Recorder(2, None)
    recorder.hear(stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, True, False), 1.0)
    assert recorder.first_heard is None


@pytest.mark.parametrize("cut", [1, 7, 40, 300])
def test_a_log_cut_in_the_middle_of_a_line_is_read_up_to_there(tmp_path, cut):
    file = tmp_path / "uav1.csv"
    file.write_text(flight_csv()[:-cut])
    flight = read_flight(file)
    assert flight is not None and 295 <= flight.t.size <= 300
    assert np.isfinite(flight.pos).all()


def test_a_header_alone_is_no_flight(tmp_path):
    file = tmp_path / "uav1.csv"
    file.write_text(Recorder(1, 0).header)
    assert read_flight(file) is None
    assert read_flight(tmp_path / "none.csv") is None
