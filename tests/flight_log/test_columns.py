"""The table of columns, and the page made of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from recorded_flights import flight_csv

from arena.flight_log.columns import THESIS, columns

ROOT = Path(__file__).parents[2]
THESIS_FILES = ROOT.parent / "shared" / "data" / "thesis"
PAGE = ROOT / "docs" / "reference" / "log-columns.md"


@pytest.mark.parametrize("name", ["setpoints_real_uav2.csv", "formation_gazebo_uav1.csv"])
def test_header_begins_like_the_thesis_files(name):
    file = THESIS_FILES / name
    if not file.exists():
        pytest.skip("the thesis's data are not on this machine")
    theirs = file.read_text().splitlines()[0].split(",")
    assert list(columns(True))[: len(theirs)] == theirs


def test_column_names_are_unique():
    assert len(set(columns(True))) == len(columns(True))
    assert columns(False) == columns(True)[: len(columns(False))]


def test_first_column_is_the_time_of_the_row():
    assert THESIS[0].columns == ("time.seconds",) and THESIS[0].instant == "row"


def test_pandas_example_of_the_page_runs(tmp_path, monkeypatch, capsys):
    pytest.importorskip("pandas")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "uav1.csv").write_text(flight_csv())
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {})
    assert re.search(r"tracking error: 0\.0\d+ m rms, estimate: 0\.01\d* m rms", capsys.readouterr().out)
