"""Reading a log file, also one whose writer was killed."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_flights import flight_csv

from arena.flight_log.csv_file import header
from arena.flight_log.flight import read_flight


@pytest.mark.parametrize("cut", [1, 7, 40, 300])
def test_log_cut_in_a_line_is_read_up_to_there(tmp_path, cut):
    file = tmp_path / "uav1.csv"
    file.write_text(flight_csv()[:-cut])
    flight = read_flight(file)
    assert flight is not None and 295 <= flight.t.size <= 300
    assert np.isfinite(flight.pos).all()


def test_header_alone_is_no_flight(tmp_path):
    file = tmp_path / "uav1.csv"
    file.write_text(header(simulated=True))
    assert read_flight(file) is None
    assert read_flight(tmp_path / "none.csv") is None
