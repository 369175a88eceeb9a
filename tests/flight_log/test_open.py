"""Logs of all formats, opened by one function."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_flights import flight_csv
from recorded_traffic import record_of, traffic
from ulog_files import write_ulog

from arena.errors import InputError
from arena.flight_log.columns import RPY, WXYZ
from arena.flight_log.open import read_flights
from arena.geometry import euler_from_quat

THESIS = Path(__file__).parents[2].parent / "shared" / "data" / "thesis"


def us(t: np.ndarray) -> list[int]:
    return [round(1e6 * x) for x in t]


def px4_log(path: Path, **more: tuple) -> Path:
    """A climb at 1 m/s from 10 s after PX4's start, armed in OFFBOARD from 11 s on, with a heading of 0.4 rad."""
    t = 10.0 + np.arange(400) / 100
    q = [np.cos(0.2), 0.0, 0.0, np.sin(0.2)]
    fields = {"timestamp": "uint64_t"} | dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), "float")
    fields |= dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), "bool")
    topics = {
        "vehicle_local_position": (
            fields,
            [
                (k, 1.0, 2.0, 10.0 - x, 0.0, 0.0, -1.0, x >= 10.5, 1, 1, 1)
                for k, x in zip(us(t), t, strict=True)
            ],
        ),
        "vehicle_attitude": ({"timestamp": "uint64_t", "q": "float[4]"}, [(k, *q) for k in us(t)]),
        "vehicle_status": (
            {"timestamp": "uint64_t", "nav_state": "uint8_t", "arming_state": "uint8_t"},
            [(10_000_000, 4, 1), (11_000_000, 14, 2)],
        ),
        "actuator_motors": (
            {"timestamp": "uint64_t", "control": "float[12]"},
            [(k, *[0.5] * 4, *[np.nan] * 8) for k in us(t[::10])],
        ),
        "battery_status": (
            {"timestamp": "uint64_t", "voltage_v": "float", "current_a": "float", "remaining": "float"},
            [(k, 15.5, -1.0, 0.75) for k in us(t[::50])],
        ),
        **more,
    }
    return write_ulog(path, topics)


def test_px4_log_is_a_flight_in_our_columns(tmp_path):
    (flight,) = read_flights(px4_log(tmp_path / "log_3.ulg"))
    assert flight.name == "log_3" and flight.t0 == 10.0
    row = int(np.searchsorted(flight.t, 1.5))
    assert flight.group("ekf.pos")[row] == pytest.approx([1.0, 2.0, -1.5], abs=1e-5)
    assert flight.group("ekf.vel")[row] == pytest.approx([0.0, 0.0, -1.0])
    assert flight.group("ekf.att_euler", RPY)[row] == pytest.approx([0.0, 0.0, 0.4])
    assert flight.mode[row] == "OFFBOARD" and flight.armed[row] and not flight.armed[0]
    assert flight.mode[0] == "AUTO.LOITER"
    assert flight.numbers["info.battery"][row] == pytest.approx(75.0)
    assert flight.numbers["bat.voltage"][row] == pytest.approx(15.5)
    assert np.isnan(flight.numbers["bat.current"][row]), "PX4 reports -1 if the current is not measured"
    assert [flight.numbers[f"act.output.{k}"][row] for k in (1, 4, 5)] == pytest.approx([0.5, 0.5, 0.0])


def test_position_that_px4_marks_as_invalid_is_empty(tmp_path):
    (flight,) = read_flights(px4_log(tmp_path / "a.ulg"))
    north = flight.numbers["ekf.pos.north"]
    assert np.isnan(north[flight.t < 0.48]).all() and np.isfinite(north[flight.t > 0.52]).all()


def test_innovations_and_biases_of_px4_are_read(tmp_path):
    stamp = {"timestamp": "uint64_t"}
    names = ("ev_hpos", "ev_vpos", "ev_hvel", "ev_vvel", "heading")
    kinds = ("float[2]", "float", "float[2]", "float", "float")
    innovations = stamp | dict(zip(names, kinds, strict=True))
    more = {
        "estimator_innovations": (
            innovations,
            [(k, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7) for k in (12_000_000,)],
        ),
        "estimator_sensor_bias": (
            stamp | {"gyro_bias": "float[3]", "accel_bias": "float[3]"},
            [(12_000_000, 1, 2, 3, 4, 5, 6)],
        ),
    }
    (flight,) = read_flights(px4_log(tmp_path / "a.ulg", **more))
    row = int(np.searchsorted(flight.t, 2.1))
    assert flight.group("ekf.innov_pos")[row] == pytest.approx([0.1, 0.2, 0.3])
    assert flight.group("ekf.innov_vel")[row] == pytest.approx([0.4, 0.5, 0.6])
    assert flight.numbers["ekf.innov_yaw"][row] == pytest.approx(0.7)
    assert flight.group("ekf.gyro_bias", RPY)[row] == pytest.approx([1, 2, 3])
    assert flight.group("ekf.acc_bias")[row] == pytest.approx([4, 5, 6])


def test_run_folder_has_one_flight_per_vehicle(tmp_path):
    (tmp_path / "csv").mkdir()
    for name in ("uav2", "uav1"):
        (tmp_path / "csv" / f"{name}.csv").write_text(flight_csv())
    assert [flight.name for flight in read_flights(tmp_path)] == ["uav1", "uav2"]


@pytest.mark.parametrize("name", ["setpoints_real_uav2", "formation_gazebo_uav1"])
def test_thesis_log_is_read_without_its_repeated_columns(name):
    if not THESIS.exists():
        pytest.skip("the thesis's data are not on this machine")
    (flight,) = read_flights(THESIS / f"{name}.csv")
    assert flight.offboard.any() and flight.position_source == "capture"
    assert "imu.mag.north" not in flight.numbers
    captured = euler_from_quat(flight.group("mocap.att_q", WXYZ))
    assert flight.group("mocap.att_euler", RPY) == pytest.approx(captured, nan_ok=True)


def test_px4_log_of_a_real_flight_agrees_with_the_csv_of_the_same_flight():
    if not THESIS.exists():
        pytest.skip("the thesis's data are not on this machine")
    (csv,), (ulog,) = (read_flights(THESIS / f"setpoints_real_uav2.{kind}") for kind in ("csv", "ulg"))

    def since_landing(flight):
        return flight.t - flight.t[np.flatnonzero(flight.offboard)[-1]]

    at = np.arange(-25.0, 0.0, 0.1)
    # The yaw differs by 90 degrees: the CSV's comes from ROS, the autopilot's from its external vision.
    for column in ("ekf.pos.north", "ekf.pos.down", "mocap.pos.east"):
        values = [np.interp(at, since_landing(f), f.numbers[column]) for f in (csv, ulog)]
        assert np.median(np.abs(values[0] - values[1])) < 0.02, column


def test_error_for_another_file_says_what_is_expected(tmp_path):
    (tmp_path / "photo.ulg").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))
    (tmp_path / "text.csv").write_text("hello\nworld\n")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "folder").mkdir()
    for name, words in (
        ("photo.ulg", "begins with 89 50 4E 47"),
        ("text.csv", "begins with 'hello'"),
        ("empty.csv", "empty file"),
        ("folder", "a folder that contains nothing"),
        ("none.csv", "No such file"),
    ):
        with pytest.raises(InputError, match="expected") as error:
            read_flights(tmp_path / name)
        assert words in str(error.value) and name in str(error.value)


def test_damaged_px4_log_is_refused(tmp_path):
    file = tmp_path / "cut.ulg"
    file.write_bytes(px4_log(tmp_path / "a.ulg").read_bytes()[:60])
    with pytest.raises(InputError, match=r"cut\.ulg"):
        read_flights(file)


def test_px4_log_without_position_names_its_topics(tmp_path):
    stamp = {"timestamp": "uint64_t", "load": "float"}
    with pytest.raises(InputError, match="its topics are: cpuload"):
        read_flights(write_ulog(tmp_path / "a.ulg", {"cpuload": (stamp, [(1, 0.5)])}))


def test_record_and_run_folder_with_a_record_are_flights(tmp_path):
    record_of(tmp_path / "flight.mcap", traffic(2.0))
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv" / "old.csv").write_text(flight_csv())
    for path in (tmp_path, tmp_path / "flight.mcap"):
        (flight,) = read_flights(path)
        assert flight.name == "uav1" and flight.simulated


def test_record_without_messages_is_refused(tmp_path):
    record_of(tmp_path / "flight.mcap", [])
    with pytest.raises(InputError, match="no message of a vehicle"):
        read_flights(tmp_path)
