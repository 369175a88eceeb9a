"""Logs in other formats, read back by the packages that users read them with."""

from __future__ import annotations

import sqlite3
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil
from recorded_flights import flight_csv
from recorded_traffic import record_of, traffic

from arena.errors import InputError
from arena.flight_log.export import FORMATS, export
from arena.flight_log.flight import Flight, read_flight
from arena.flight_log.open import read_flights
from arena.wire.mavlink_frame import parse_frames

SECONDS = 4.5


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    record_of(folder / "flight.mcap", traffic(SECONDS))
    return folder


@pytest.fixture(scope="module")
def flight(run: Path) -> Flight:
    (found,) = read_flights(run)
    return found


def test_csv_is_the_file_that_the_report_writes(run, flight):
    (path,) = export(run, "csv")
    assert path == run / "csv" / "uav1.csv"
    found = read_flight(path)
    assert found is not None and found.t.size == flight.t.size


def test_parquet_has_the_values_of_every_row(run, flight, tmp_path):
    pandas = pytest.importorskip("pandas")
    (path,) = export(run, "parquet", tmp_path)
    table = pandas.read_parquet(path)
    assert len(table) == flight.t.size
    assert table["ekf.pos.north"].to_numpy() == pytest.approx(flight.numbers["ekf.pos.north"], nan_ok=True)
    armed = table["info.is_armed"]
    assert armed.isna().sum() == np.isnan(flight.numbers["info.is_armed"]).sum()
    assert (armed == True).sum() == flight.armed.sum()  # noqa: E712
    assert table["info.flight_mode"].dropna().iloc[-1] == "OFFBOARD"


def expected_counts(flight: Flight) -> dict[str, int]:
    def rows(*groups: tuple[str, str]) -> int:
        known = [flight.group(name, parts.split()) for name, parts in groups]
        return int(np.isfinite(np.concatenate(known, axis=1)).all(axis=1).sum())

    ned, rpy, q = "north east down", "roll pitch yaw", "w x y z"
    estimate = (("ekf.pos", ned), ("ekf.att_q", q), ("ekf.vel", ned), ("ekf.ang_vel", rpy))
    return {
        "/uav1/odometry": rows(*estimate),
        "/uav1/truth": flight.t.size,
        "/uav1/mocap/pose": rows(("mocap.pos", ned), ("mocap.att_q", q)),
        "/uav1/setpoint/pose": rows(("pos_ref", ned)),
        "/uav1/imu": rows(("imu.acc_body", ned), ("ekf.att_q", q)),
        "/uav1/actuators": rows(("act.output", "1 8")),
    }


def read_bag(path: Path) -> tuple[Counter[str], dict[str, list]]:
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store, counts, messages = get_typestore(Stores.ROS2_HUMBLE), Counter(), {}
    with Reader(path) as reader:
        for connection, stamp, data in reader.messages():
            counts[connection.topic] += 1
            found = store.deserialize_cdr(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append((stamp, found))
    return counts, messages


def test_ros2_bag_has_one_message_per_known_row(run, flight, tmp_path):
    (path,) = export(run, "ros2", tmp_path / "bag")
    counts, messages = read_bag(path)
    assert {topic: counts[topic] for topic in expected_counts(flight)} == expected_counts(flight)
    stamps = [stamp for found in messages.values() for stamp, _ in found]
    assert min(stamps) >= 0
    assert [m.data for _, m in messages["/uav1/mode"]] == ["AUTO.LOITER", "OFFBOARD"]
    assert [m.data for _, m in messages["/uav1/armed"]] == [False, True]
    (database,) = path.glob("*.db3")
    with sqlite3.connect(database) as connection:
        assert connection.execute("select count(*) from messages").fetchone() == (sum(counts.values()),)


def test_ros2_messages_are_in_ros_frames(run, flight, tmp_path):
    (path,) = export(run, "ros2", tmp_path / "bag")
    _, messages = read_bag(path)
    stamp, message = messages["/uav1/truth"][20]
    row = int(np.argmin(np.abs(flight.numbers["time.seconds"] - stamp * 1e-9)))
    north, east, down = flight.group("truth.pos")[row]
    place = message.pose.pose.position
    assert [place.x, place.y, place.z] == pytest.approx([east, north, -down])
    yaw = flight.numbers["truth.att_euler.yaw"][row]  # ENU: from east, counterclockwise
    q = message.pose.pose.orientation
    turned = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
    assert np.cos(turned - (np.pi / 2 - yaw)) == pytest.approx(1.0, abs=1e-6)
    assert (message.header.frame_id, message.child_frame_id) == ("map", "uav1/base_link")
    force = messages["/uav1/imu"][10][1]
    row = int(np.argmin(np.abs(flight.numbers["time.seconds"] - messages["/uav1/imu"][10][0] * 1e-9)))
    assert force.linear_acceleration.z == pytest.approx(-flight.numbers["imu.acc_body.down"][row])
    battery = messages["/uav1/battery"][0][1]
    assert battery.percentage == pytest.approx(0.87) and battery.current == pytest.approx(-12.5)


def test_existing_bag_is_not_replaced(run, tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="exists"):
        export(run, "ros2", tmp_path / "bag")


def test_mcap_has_the_messages_of_the_bag(run, flight, tmp_path):
    (path,) = export(run, "mcap", tmp_path / "uav1.mcap")
    with path.open("rb") as file:
        reader = make_reader(file)
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert {topic: counts[topic] for topic in expected_counts(flight)} == expected_counts(flight)


def test_tlog_has_every_recorded_frame(run, tmp_path):
    (path,) = export(run, "tlog", tmp_path)
    sent = Counter(
        frame.msgid
        for received in traffic(SECONDS)
        if received.kind in ("down", "up")
        for frame in parse_frames(received.data).frames
    )
    log = mavutil.mavlink_connection(str(path))
    found, stamps = Counter(), []
    while (message := log.recv_match()) is not None:
        assert message.get_type() != "BAD_DATA"
        found[message.get_msgId()] += 1
        stamps.append(message._timestamp)
    assert found == sent and stamps == sorted(stamps)
    assert 1.7e9 - 1 < stamps[0] < 1.7e9 + 1  # Unix time


@pytest.mark.parametrize("kind", ["parquet", "ros2", "mcap"])
def test_csv_file_is_exported_beside_it(tmp_path, kind):
    source = tmp_path / "uav7.csv"
    source.write_text(flight_csv())
    (path,) = export(source, kind)
    assert path == tmp_path / f"uav7{FORMATS[kind].suffix}" and path.exists()


def test_source_is_never_overwritten(tmp_path):
    source = tmp_path / "uav1.csv"
    source.write_text(flight_csv())
    with pytest.raises(InputError, match="another folder"):
        export(source, "csv")
    assert source.read_text() == flight_csv()
    record_of(tmp_path / "flight.mcap", traffic(1.5))
    with pytest.raises(InputError, match="record of a flight"):
        export(tmp_path, "mcap", tmp_path / "flight.mcap")


def test_csv_log_has_no_mavlink_messages(tmp_path):
    source = tmp_path / "uav1.csv"
    source.write_text(flight_csv())
    with pytest.raises(InputError, match="contains no MAVLink messages"):
        export(source, "tlog")


def test_unknown_vehicle_is_refused(run, tmp_path):
    for kind in ("csv", "tlog"):
        with pytest.raises(InputError, match=r"has no vehicle uav9; its vehicles are: uav1"):
            export(run, kind, tmp_path, ["uav9"])
