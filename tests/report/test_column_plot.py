"""Plots of columns over time."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from recorded_flights import flight_csv

from arena.errors import InputError
from arena.flight_log.flight import Flight, read_flight
from arena.report.column_plot import panels, write_plot


@pytest.fixture
def flights(tmp_path: Path) -> list[Flight]:
    found = []
    for name in ("uav1", "uav2"):
        path = tmp_path / f"{name}.csv"
        path.write_text(flight_csv())
        flight = read_flight(path)
        assert flight is not None
        found.append(flight)
    return found


def test_quantity_is_a_panel_with_all_its_columns_and_the_unit(flights):
    (panel,) = panels(flights[:1], ["ekf.pos"])
    assert [line.label for line in panel.lines] == ["ekf.pos.north", "ekf.pos.east", "ekf.pos.down"]
    assert panel.title == "ekf.pos [m]"


def test_joined_columns_of_several_vehicles_share_a_panel(flights):
    first, second = panels(flights, ["truth.pos.down+pos_ref.down", "info.is_armed"])
    assert len(first.lines) == 4 and {line.label.split()[0] for line in first.lines} == {"uav1", "uav2"}
    assert set(second.lines[0].values.tolist()) == {0.0, 1.0}


def test_unknown_column_names_similar_ones(flights):
    with pytest.raises(InputError, match=r"no column 'ekf\.poss'. Similar names: ekf\.pos"):
        panels(flights, ["ekf.poss"])


def test_plot_is_written_as_picture_and_as_page(flights, tmp_path):
    shown = panels(flights, ["ekf.pos", "info.battery"])
    write_plot(tmp_path / "a.png", shown, "run")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width == 1200 and len(picture.getcolors(1 << 24) or []) > 100
    write_plot(tmp_path / "a.html", shown, "run")
    page = (tmp_path / "a.html").read_text()
    assert "uav2 ekf.pos.north" in page and 'src="http' not in page
    with pytest.raises(InputError, match=r"expected one of \.png"):
        write_plot(tmp_path / "a.txt", shown, "run")
