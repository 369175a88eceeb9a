"""Tests of what is known about a recorded flight before its replay starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError
from arena.replay.describe import describe
from arena.replay.open_script import open_script, record_of

ROW = "time.seconds,ekf.pos.north,ekf.pos.east,ekf.pos.down,info.flight_mode,info.is_armed,info.is_landed\n"


def csv(folder: Path, name: str, t0: float, north: float) -> Path:
    rows = [f"{t0 + 0.1 * k},{north},0.0,-1.0,OFFBOARD,True,False\n" for k in range(20)]
    (folder / name).write_text(ROW + "".join(rows))
    return folder / name


def test_room_contains_all_positions_of_the_logs(tmp_path: Path) -> None:
    found = describe([csv(tmp_path, "uav1.csv", 5.0, 9.5), csv(tmp_path, "uav4.csv", 5.0, 1.0)])
    assert found.size_m == (20.0, 4.0, 3.0)
    assert [(v.name, v.id) for v in found.vehicles] == [("uav1", 1), ("uav4", 4)]
    assert not found.unix_clock
    assert found.folder is None


def test_logs_with_unix_times_are_recognized(tmp_path: Path) -> None:
    assert describe([csv(tmp_path, "uav1.csv", 1.6e9, 0.0)]).unix_clock


def test_record_and_log_together_are_refused(tmp_path: Path) -> None:
    log = csv(tmp_path, "uav1.csv", 5.0, 0.0)
    (tmp_path / "flight.mcap").write_bytes(b"")
    for opened in (describe, open_script):
        with pytest.raises(InputError, match="contains all vehicles of a run"):
            opened([log, tmp_path / "flight.mcap"])


def test_run_folder_without_a_record_is_replayed_from_its_logs(tmp_path: Path) -> None:
    assert record_of(tmp_path) is None
    (tmp_path / "flight.mcap").write_bytes(b"")
    assert record_of(tmp_path) == tmp_path / "flight.mcap"
