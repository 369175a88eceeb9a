"""Whole campaigns with fakes in place of flights: retries, resumption, interruption, files and exit codes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from arena import cli
from arena.campaign import runner
from arena.campaign.design import Flight, flights
from arena.campaign.measures import MEASURES
from arena.campaign.progress import Pace
from arena.campaign.store import Record, Store
from arena.campaign.sweep import load_sweep
from arena.cli import main

from .conftest import record_of

SWEEP = "name: two\narena: arena.yaml\nseeds: 2\nvary: {defaults.mass_kg: [1.0, 1.2]}\n"
Write = Callable[[str], Path]


def flown(flight: Flight, folder: Path, *, passed: bool = True) -> Record:
    """Return a record as a flight returns it, and note the flight in a file."""
    with (folder / "begun").open("a") as begun:
        begun.write(f"{flight.number}\n")
    known = {"tracking_rms_m": 0.1 * flight.number, "crashes": 0.0}
    measures = dict.fromkeys((m.name for m in MEASURES), None) | known
    return record_of(flight, passed=passed, measures=measures)


def begun(folder: Path) -> list[int]:
    return sorted(int(line) for line in (folder / "begun").read_text().split())


@pytest.fixture
def campaign(sweep_file: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run `arena campaign` on a sweep with a fake flight. Return the exit code.

    A fake flight is a copy of this process and does not use the fork server. Therefore it is started only with `forks`.
    """
    monkeypatch.chdir(tmp_path)

    def run(
        fly: Callable[[Flight, Path], Record] = flown, text: str = SWEEP, *more: str, forks: bool = False
    ) -> int:
        if not forks:
            monkeypatch.delitem(cli._FORKING, "campaign", raising=False)
        monkeypatch.setattr(runner, "fly_all", partial(FLY_ALL, flown_by=fly))
        return main(["campaign", str(sweep_file(text)), "-j", "1", *more])

    return run


FLY_ALL = runner.fly_all


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "campaigns" / "two"


def test_campaign_writes_table_and_plots(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(forks=True) == 0
    table = pyarrow.parquet.read_table(folder / "results.parquet")
    assert table.num_rows == 4 and table.column("defaults.mass_kg").to_pylist() == [1.0, 1.0, 1.2, 1.2]
    assert table.column("tracking_rms_m").to_pylist() == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert table.column("touchdown_m_s").to_pylist() == [None] * 4
    assert table.schema.field("tracking_rms_m").metadata[b"unit"] == b"m"
    plots = {path.stem for path in (folder / "plots").iterdir()}
    assert plots == {"tracking_rms_m", "crashes"}, "a plot per measure with data"
    out = capsys.readouterr().out
    assert "two: 4 flights: 4 passed, 0 failed" in out and "4/4, 0 s left" in out


def test_failed_flight_gives_exit_code_1(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(lambda f, d: flown(f, d, passed=f.number != 3)) == 1
    out = capsys.readouterr().out
    assert (
        "3 passed, 1 failed" in out
        and "FAILED  flight 3 defaults.mass_kg=1.2 seed=1" in out
        and "it fell" in out
    )
    assert campaign() == 1, "a failed flight has a result and is not flown again"
    assert begun(folder) == [1, 2, 3, 4]


def test_wrong_sweep_flies_nothing(campaign: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert campaign(flown, "arena: arena.yaml\nvary: {world.win: [1]}\n") == 2
    assert "sweep.yaml:2: vary.world.win[0]: world.win: unknown key" in capsys.readouterr().err
    assert not (tmp_path / "campaigns").exists()


def test_flight_of_a_killed_worker_is_flown_again(campaign: Any, folder: Path) -> None:
    def fly(flight: Flight, into: Path) -> Record:
        made = flown(flight, into)
        if flight.number == 2 and begun(into).count(2) == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return made

    assert campaign(fly) == 0
    assert begun(folder) == [1, 2, 2, 3, 4]


def test_flight_of_a_terminated_worker_is_flown_again(campaign: Any, folder: Path) -> None:
    def fly(flight: Flight, into: Path) -> Record:
        made = flown(flight, into)
        if flight.number == 2 and begun(into).count(2) == 1:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        return made

    assert campaign(fly) == 0
    assert begun(folder) == [1, 2, 2, 3, 4]


def test_file_that_is_changed_during_the_campaign_ends_it(
    campaign: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fly(flight: Flight, into: Path) -> Record:
        if flight.number == 2:
            (tmp_path / "fly.py").write_text("# changed\n")
        return flown(flight, into)

    assert campaign(fly) == 2
    assert "fly.py: changed while the campaign flew" in capsys.readouterr().err
    assert [r.number for r in Store(folder).records().values()] == [1]
    assert pyarrow.parquet.read_table(folder / "results.parquet").num_rows == 1
    (tmp_path / "fly.py").write_text("")
    assert campaign() == 0 and begun(folder) == [1, 2, 2, 3, 4]


def test_failed_flights_are_flown_again_on_request(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(lambda f, d: flown(f, d, passed=f.number != 3)) == 1
    assert campaign() == 1 and "4 of them flown before (1 failed)" in capsys.readouterr().out
    assert campaign(flown, SWEEP, "--retry-failed") == 0
    assert begun(folder) == [1, 2, 3, 3, 4]
    assert pyarrow.parquet.read_table(folder / "results.parquet").column("passed").to_pylist() == [True] * 4


def test_another_arena_under_the_same_name_is_refused(
    campaign: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign() == 0
    (tmp_path / "other.yaml").write_text((tmp_path / "arena.yaml").read_text())
    assert campaign(flown, SWEEP.replace("arena: arena.yaml", "arena: other.yaml")) == 2
    assert "already has the results of arena.yaml, not of other.yaml" in capsys.readouterr().err


def test_table_and_plots_of_older_results_are_removed(campaign: Any, folder: Path) -> None:
    assert campaign() == 0
    assert (
        campaign(lambda f, d: replace(flown(f, d), measures={}), SWEEP.replace("1.0, 1.2", "1.1, 1.3")) == 0
    )
    assert [path.name for path in (folder / "plots").iterdir()] == []
    assert pyarrow.parquet.read_table(folder / "results.parquet").num_rows == 4


def test_time_left_is_given_once_all_jobs_have_ended_a_flight() -> None:
    now = [0.0]
    pace = Pace(4, lambda: now[0])
    pace.begin(24, 0)
    left = []
    for now[0] in (9.0, 10.0, 10.0, 10.0):
        pace.add()
        left.append(pace.left_s)
    assert left == [None, None, None, pytest.approx(50.0)]


def test_lost_flight_is_flown_again_when_the_campaign_is_resumed(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fly(flight: Flight, into: Path) -> Record:
        if flight.number == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return flown(flight, into)

    assert campaign(fly) == 1
    assert "ended without a result, 3 times (exit code -9)" in capsys.readouterr().out
    assert pyarrow.parquet.read_table(folder / "results.parquet").num_rows == 3
    assert campaign() == 0
    assert begun(folder) == [1, 2, 3, 4]


def test_interrupted_campaign_keeps_its_results_and_is_resumed(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fly(flight: Flight, into: Path) -> Record:
        if flight.number == 3:
            os.kill(os.getppid(), signal.SIGINT)
            signal.pause()
        return flown(flight, into)

    assert campaign(fly, forks=True) == 130
    assert "2 passed, 0 failed, 2 not flown" in capsys.readouterr().out
    assert pyarrow.parquet.read_table(folder / "results.parquet").num_rows == 2
    assert campaign() == 0
    assert begun(folder) == [1, 2, 3, 4] and "4 flights, 2 of them flown before" in capsys.readouterr().out


def test_larger_sweep_flies_only_the_new_flights(campaign: Any, folder: Path) -> None:
    assert campaign() == 0
    assert campaign(flown, SWEEP.replace("seeds: 2", "seeds: 3")) == 0
    assert begun(folder) == [1, 2, 3, 3, 4, 6]
    numbers = pyarrow.parquet.read_table(folder / "results.parquet").column("number").to_pylist()
    assert numbers == [1, 2, 3, 4, 5, 6]


def test_results_of_another_program_are_not_mixed(
    campaign: Any, tmp_path: Path, sweep_file: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign() == 0
    (tmp_path / "fly.py").write_text("")
    original = load_sweep(tmp_path / "sweep.yaml")
    assert len(flights(original)) == 4
    (tmp_path / "arena.yaml").write_text((tmp_path / "arena.yaml").read_text() + "# changed\n")
    monkey = main(["campaign", str(tmp_path / "sweep.yaml")])
    assert monkey == 2 and "arena.yaml changed since the first flights" in capsys.readouterr().err


def test_show_writes_the_table_of_a_killed_campaign(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign() == 0
    (folder / "results.parquet").unlink()
    lines = (folder / "results.jsonl").read_text().splitlines()
    (folder / "results.jsonl").write_text("\n".join(lines[:3]) + '\n{"id": "cut')
    capsys.readouterr()
    assert main(["campaign", "show", str(folder)]) == 0
    assert "4 flights: 3 passed, 0 failed, 1 not flown" in capsys.readouterr().out
    assert pyarrow.parquet.read_table(folder / "results.parquet").num_rows == 3
    assert len(Store(folder).records()) == 3


def test_show_of_another_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "show", str(tmp_path)]) == 2
    assert "not the folder of a campaign, because it has no campaign.json" in capsys.readouterr().err


def test_list_flies_nothing(campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert campaign(flown, SWEEP, "--list") == 0
    assert "flight 4 defaults.mass_kg=1.2 seed=2" in capsys.readouterr().out and not folder.exists()


def test_campaign_without_pyarrow_flies_and_names_the_package(
    campaign: Any, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from arena.campaign import table

    monkeypatch.setattr(table, "has_pyarrow", lambda: False)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    assert campaign() == 0
    assert "flying-arena[campaign]" in capsys.readouterr().err
    assert not (folder / "results.parquet").exists() and (folder / "plots" / "crashes.png").exists()
