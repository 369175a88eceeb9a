"""Logs computed from the record of a flight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from record_files import UAV2
from recorded_traffic import Received, record_of, state, traffic

from arena.flight_log.columns import RPY, columns
from arena.flight_log.conversion import flights_of
from arena.flight_log.csv_file import write_csv
from arena.flight_log.flight import Flight, read_flight
from arena.flight_log.recording import Recording

REAL = replace(UAV2, name="uav1", id=1)


def converted(path: Path, data: list[Received], **more: object) -> Flight:
    (flight,) = flights_of(Recording(record_of(path, data, **more)))
    return flight


def test_rows_of_a_simulated_vehicle_are_its_true_states(tmp_path):
    flight = converted(tmp_path / "flight.mcap", traffic(3.0))
    at = flight.numbers["time.seconds"]
    assert np.diff(at) == pytest.approx(1 / 30) and flight.simulated
    assert flight.group("truth.pos") == pytest.approx(np.array([state(t)[:3] for t in at]))
    error = np.linalg.norm(flight.group("err.pos"), axis=1)
    assert 0.001 < np.nanmedian(error) < 0.05 and np.isfinite(error).mean() > 0.9


def test_rows_of_a_real_vehicle_have_the_given_rate_and_no_truth(tmp_path):
    path = record_of(tmp_path / "flight.mcap", traffic(3.0), REAL)
    (flight,) = flights_of(Recording(path), 100.0)
    assert np.diff(flight.t) == pytest.approx(0.01) and not flight.simulated
    assert flight.position_source == "capture"


def test_voltage_current_and_health_of_the_estimator_are_columns(tmp_path):
    flight = converted(tmp_path / "flight.mcap", traffic(6.0))
    row = int(np.searchsorted(flight.numbers["time.seconds"], 5.0))
    assert flight.numbers["bat.voltage"][row] == pytest.approx(15.4) and flight.numbers["bat.current"][
        row
    ] == pytest.approx(12.5)
    names = [f"ekf.test_ratio.{part}" for part in ("vel", "pos", "height", "yaw")]
    assert [flight.numbers[name][row] for name in names] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert flight.numbers["ekf.accuracy.vertical"][row] == pytest.approx(0.02)


def test_vehicle_without_messages_has_no_log(tmp_path):
    data = [received for received in traffic(1.5) if received.kind != "down"]
    assert list(flights_of(Recording(record_of(tmp_path / "flight.mcap", data)))) == []


def test_damaged_datagrams_do_not_disturb_the_log(tmp_path):
    data = traffic(3.0)
    broken = [
        replace(r, data=r.data[:-3] + bytes(3)) if r.kind == "down" and i % 50 == 0 else r
        for i, r in enumerate(data)
    ]
    flight = converted(tmp_path / "flight.mcap", broken)
    assert np.nanmedian(np.abs(flight.group("err.pos"))) < 0.05


def test_written_csv_is_the_same_flight(tmp_path):
    flight = converted(tmp_path / "flight.mcap", traffic(4.0))
    write_csv(tmp_path / "uav1.csv", flight)
    found = read_flight(tmp_path / "uav1.csv")
    assert found is not None
    assert (tmp_path / "uav1.csv").read_text().splitlines()[0] == ",".join(columns(True))
    assert list(found.mode) == list(flight.mode)
    assert found.armed.tolist() == flight.armed.tolist()
    for name, values in flight.numbers.items():
        assert found.numbers[name] == pytest.approx(values, rel=1e-6, abs=1e-4, nan_ok=True), name
    assert found.group("ekf.att_euler", RPY) == pytest.approx(
        flight.group("ekf.att_euler", RPY), abs=1e-6, nan_ok=True
    )


def test_large_record_is_read_a_few_vehicles_at_a_time(tmp_path, monkeypatch):
    path = record_of(tmp_path / "flight.mcap", traffic(1.5))
    expected = [flight.t.size for flight in flights_of(Recording(path))]
    monkeypatch.setattr("arena.flight_log.conversion._BYTES_AT_ONCE", 1)
    assert [flight.t.size for flight in flights_of(Recording(path))] == expected == [expected[0]]
