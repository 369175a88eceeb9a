"""Logs of a run folder."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pymavlink import mavutil
from record_files import UAV2
from recorded_traffic import record_of, traffic
from ulog_files import write_ulog

from arena.flight_log.flight import read_flight
from arena.flight_log.open import read_flights
from arena.flight_log.run_folder import ulogs_of, write_csv_files, write_tlog_files


def test_csv_files_are_written_with_the_rate_of_the_arena(tmp_path):
    record_of(tmp_path / "flight.mcap", traffic(2.0, system=2), UAV2)
    (tmp_path / "plan.json").write_text(json.dumps({"slices": {"recorder.json": {"rate_hz": 125}}}))
    assert write_csv_files(tmp_path) == [tmp_path / "csv" / "uav2.csv"]
    flight = read_flight(tmp_path / "csv" / "uav2.csv")
    assert flight is not None and np.diff(flight.t) == pytest.approx(0.008, abs=1e-3)


def test_a_telemetry_log_is_written_for_each_vehicle(tmp_path):
    record_of(tmp_path / "flight.mcap", traffic(2.0, system=2), UAV2)
    (path,) = write_tlog_files(tmp_path)
    log = mavutil.mavlink_connection(str(path))
    types = {message.get_type() for message in iter(log.recv_msg, None)}
    assert path == tmp_path / "tlog" / "uav2.tlog" and "LOCAL_POSITION_NED" in types


def test_ulogs_of_a_vehicle_are_found_in_order(tmp_path):
    (tmp_path / "ulog").mkdir()
    for name in ("uav1_2", "uav1", "uav1_10", "uav12"):
        (tmp_path / "ulog" / f"{name}.ulg").touch()
    assert [p.name for p in ulogs_of(tmp_path, "uav1")] == ["uav1.ulg", "uav1_2.ulg", "uav1_10.ulg"]
    px4 = tmp_path / "px4" / "uav3" / "log" / "2026-11-22" / "13_52_52.ulg"
    px4.parent.mkdir(parents=True)
    px4.touch()
    assert ulogs_of(tmp_path, "uav3") == [px4]


def test_biases_come_from_the_ulog_by_the_clock_of_the_autopilot(tmp_path):
    record_of(tmp_path / "flight.mcap", traffic(4.0, boot_s=100.0))
    (tmp_path / "ulog").mkdir()
    stamp, vector = {"timestamp": "uint64_t"}, "float[3]"
    topics = {
        "vehicle_local_position": (stamp | dict.fromkeys("xyz", "float"), [(101_000_000, 0, 0, 0)]),
        "estimator_sensor_bias": (
            stamp | {"gyro_bias": vector, "accel_bias": vector},
            [(102_000_000, 1, 2, 3, 4, 5, 6), (103_000_000, 7, 8, 9, 10, 11, 12)],
        ),
    }
    write_ulog(tmp_path / "ulog" / "uav1.ulg", topics)
    (flight,) = read_flights(tmp_path)
    at = flight.numbers["time.seconds"]
    bias = flight.group("ekf.acc_bias")
    assert np.isnan(bias[at < 1.9]).all()
    assert (bias[(at > 2.1) & (at < 2.9)] == [4.0, 5.0, 6.0]).all()
    assert (bias[at > 3.1] == [10.0, 11.0, 12.0]).all()


def test_damaged_ulog_leaves_its_columns_empty(tmp_path):
    record_of(tmp_path / "flight.mcap", traffic(2.0))
    (tmp_path / "ulog").mkdir()
    (tmp_path / "ulog" / "uav1.ulg").write_bytes(b"ULog")
    (flight,) = read_flights(tmp_path)
    assert np.isnan(flight.group("ekf.acc_bias")).all() and np.isfinite(flight.group("ekf.pos")).any()
