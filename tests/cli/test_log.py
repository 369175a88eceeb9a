"""`arena log`."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_flights import flight_csv
from recorded_traffic import record_of, traffic

from arena.cli import main


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "runs" / "20261122-lab"
    folder.mkdir(parents=True)
    (folder / "plan.json").write_text("{}")
    record_of(folder / "flight.mcap", traffic(2.0))
    return folder


def test_newest_run_is_listed_by_default(run, monkeypatch, capsys):
    monkeypatch.chdir(run.parents[1])
    assert main(["log", "ls"]) == 0
    out = capsys.readouterr().out
    assert "flight.mcap" in out and str(len(traffic(2.0))) in out


def test_run_folder_without_logs_says_so(tmp_path, capsys):
    assert main(["log", "ls", str(tmp_path)]) == 0
    assert "no logs" in capsys.readouterr().out
    assert main(["log", "ls", str(tmp_path / "none")]) == 2


def test_content_of_a_run_is_shown(run, capsys):
    assert main(["log", "info", str(run)]) == 0
    out = capsys.readouterr().out
    assert "complete: the file ended cleanly" in out and "HEARTBEAT (1/1)" in out


def test_run_of_a_killed_recorder_is_exported(run, capsys):
    record = run / "flight.mcap"
    record.write_bytes(record.read_bytes()[:-300])
    assert main(["log", "export", str(run), "--to", "csv"]) == 0
    assert capsys.readouterr().out.strip() == str(run / "csv" / "uav1.csv")
    assert (run / "csv" / "uav1.csv").stat().st_size > 10_000


def test_plot_is_written(run, tmp_path, capsys):
    picture = tmp_path / "x.png"
    arguments = ["log", "plot", str(run), "ekf.pos", "bat.voltage", "-o", str(picture), "-v", "uav1"]
    assert main(arguments) == 0 and picture.exists()
    assert main([*arguments[:-1], "uav9"]) == 2
    assert "its vehicles are: uav1" in capsys.readouterr().err


def test_flights_are_compared(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text(flight_csv())
    files = [str(tmp_path / f"{name}.csv") for name in ("a", "b")]
    assert main(["log", "compare", *files, "--align", "offboard"]) == 0
    out = capsys.readouterr().out
    assert "after the event `offboard`" in out and "tracking error, rms" in out
    distance = next(line for line in out.splitlines() if line.startswith("distance m"))
    assert distance.split()[2:] == ["0.000"] * 3
