"""ULog of the built-in autopilot: contents of a flight, begin and end of logs, and files on disks that do not respond."""

from __future__ import annotations

import errno
import io
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink
from pyulog import ULog

from arena.autopilot.ulog import files
from arena.autopilot.ulog.files import UlogFiles
from arena.autopilot.ulog.message_formats import FORMATS
from arena.autopilot.ulog.topics import PERIODIC, STATE, TOPICS
from arena.params.param_files import read_values
from arena.wire.ulog_messages import file_header, record_type, subscriptions, topic_format


class Memory:
    """Logs in memory: vehicle -> list of its logs."""

    def __init__(self) -> None:
        self.logs: dict[str, list[bytes]] = {}
        self.open: set[str] = set()

    def begin(self, name: str, data: bytes) -> None:
        self.logs.setdefault(name, []).append(data)
        self.open.add(name)

    def write(self, name: str, data: bytes) -> None:
        assert name in self.open
        self.logs[name][-1] += data

    def end(self, name: str) -> None:
        self.open.remove(name)

    def hand_over(self, now: float) -> None:
        pass

    def events(self) -> list[str]:
        return []

    def close(self) -> None:
        pass

    def read(self, name: str = "uav1", number: int = 0) -> ULog:
        return ULog(io.BytesIO(self.logs[name][number]))


def fly(
    memory: Memory, vehicles: int = 1, seconds: float = 8.0, params: list[dict[str, float]] | None = None
) -> Flight:
    """Take off in OFFBOARD, hover, and land with all vehicles."""
    flight = Flight(vehicles, params=params, ulog=memory, decoded=(mavlink.MAVLINK_MSG_ID_COMMAND_ACK,))
    everyone = range(vehicles)

    def stream(f: Flight) -> None:
        for i in everyone:
            f.setpoint(i, (0.5, 2.0 * i, -1.5), yaw=0.3)

    flight.run(3.0)
    flight.run(0.6, stream)
    for i in everyone:
        flight.offboard(i)
        flight.arm(i)
    flight.run(seconds, stream)
    for i in everyone:
        flight.command(i, mavlink.MAV_CMD_NAV_LAND)
    flight.until(lambda f: not any(f.armed(i) for i in everyone), 30.0)
    flight.run(0.5)
    return flight


@pytest.fixture(scope="module")
def flown() -> tuple[Memory, Flight]:
    memory = Memory()
    return memory, fly(memory, 2)


def topic(log: ULog, name: str) -> dict[str, np.ndarray]:
    return dict(log.get_dataset(name).data)


def test_formats_keep_the_order_and_sizes_of_px4() -> None:
    for name, fields in FORMATS.items():
        kind = record_type(fields)
        sizes = [kind[each].base.itemsize for each in kind.names[4:]]
        assert kind.names[3] == "timestamp" and sizes == sorted(sizes, reverse=True), name


def test_log_lasts_from_arming_to_disarming(flown: tuple[Memory, Flight]) -> None:
    log = flown[0].read()
    status = topic(log, "vehicle_status")
    assert status["arming_state"][0] == 2 and status["arming_state"][-1] == 1
    armed_s = status["armed_time"].max() * 1e-6
    assert log.start_timestamp * 1e-6 == pytest.approx(armed_s, abs=0.05)
    assert status["latest_disarming_reason"][-1] == 7, "by landing"
    assert not flown[0].open and len(flown[0].logs["uav1"]) == 1


def test_each_topic_has_the_period_of_px4(flown: tuple[Memory, Flight]) -> None:
    log = flown[0].read()
    length_s = (log.last_timestamp - log.start_timestamp) * 1e-6
    assert {each.name for each in log.data_list} == set(TOPICS)
    for name, each in PERIODIC.items():
        if name not in STATE:
            count = len(topic(log, name)["timestamp"])
            assert count == pytest.approx(length_s / max(each.period_s, 0.004), rel=0.02, abs=2), name
    assert np.all(np.diff(topic(log, "sensor_combined")["timestamp"].astype(int)) == 4000)


def test_records_follow_in_time(flown: tuple[Memory, Flight]) -> None:
    times: list[int] = []
    data = flown[0].logs["uav1"][0]
    at = data.index(b"A", 16)
    at = 16
    while at < len(data):
        size = int.from_bytes(data[at : at + 2], "little")
        if data[at + 2] == ord("D"):
            times.append(int.from_bytes(data[at + 5 : at + 13], "little"))
        at += 3 + size
    assert len(times) > 1000 and np.diff(times).min() >= -20_000, "a change is recorded one decision later"


def test_position_setpoint_and_attitude_are_those_of_the_flight(flown: tuple[Memory, Flight]) -> None:
    log, flight = flown[0].read("uav2"), flown[1]
    position, wanted = topic(log, "vehicle_local_position"), topic(log, "trajectory_setpoint")
    hover = (position["timestamp"] - log.start_timestamp) * 1e-6 > 7.0
    hover &= (position["timestamp"] - log.start_timestamp) * 1e-6 < 7.5
    for axis, value in (("x", 0.5), ("y", 2.0), ("z", -1.5)):
        assert position[axis][hover] == pytest.approx(value, abs=0.15)
    assert position["heading"][hover] == pytest.approx(0.3, abs=0.1)
    assert all(position["xy_valid"])
    first = (wanted["timestamp"] - log.start_timestamp) * 1e-6 < 7.5
    assert [wanted[f"position[{k}]"][first][-1] for k in range(3)] == pytest.approx([0.5, 2.0, -1.5])
    q = topic(log, "vehicle_attitude")
    assert np.hypot.reduce([q[f"q[{k}]"] for k in range(4)]) == pytest.approx(1.0, abs=1e-5)
    assert flight.position(1)[2] == pytest.approx(position["z"][-1], abs=0.1)


def test_innovations_have_the_sign_of_px4(flown: tuple[Memory, Flight]) -> None:
    """PX4's innovation is the estimate minus the measurement, so their difference at the same time has the same sign."""
    memory = Memory()
    flight = Flight(1, params={"SDLOG_MODE": 2}, ulog=memory)
    flight.run(4.0)
    flight.faults[0] = lambda p, q: (
        p + np.array([0.02, -0.03, 0.0]),
        q,
    )  # a small jump of the measured position
    flight.run(1.0 / 60 * 2)
    est = flight.pilots.est
    assert est.innovation[0, 0] > 0.0, "arena: measurement minus estimate"
    flight.run(0.6)
    ratios = topic(memory.read(), "estimator_innovation_test_ratios")
    found = topic(memory.read(), "estimator_innovations")
    assert np.sign(found["ev_hpos[0]"][-1]) == -np.sign(est.innovation[0, 0])
    assert ratios["ev_hpos[0]"].min() >= 0.0
    assert np.isnan(found["gps_hvel[0]"]).all(), "a measurement that the estimator does not have"


def test_motors_are_nan_where_there_is_no_rotor(flown: tuple[Memory, Flight]) -> None:
    motors = topic(flown[0].read(), "actuator_motors")
    assert np.isfinite(motors["control[3]"][5:-3]).all() and np.isnan(motors["control[4]"]).all()
    thrust = topic(flown[0].read(), "vehicle_thrust_setpoint")["xyz[2]"]
    assert thrust.min() < -0.4 and thrust.max() <= 0.0


def test_texts_modes_and_landing_are_recorded(flown: tuple[Memory, Flight]) -> None:
    log = flown[0].read()
    texts = [each.message for each in log.logged_messages]
    assert texts == [
        "Armed by external command",
        "Takeoff detected",
        "Landing detected",
        "Disarmed by landing",
    ]
    modes = topic(log, "vehicle_status")["nav_state"].tolist()
    assert list(dict.fromkeys(modes)) == [14, 18, 4], "OFFBOARD, LAND, HOLD"
    landed = topic(log, "vehicle_land_detected")["landed"].tolist()
    assert landed[0] == landed[-1] == 1 and 0 in landed
    assert 5 in topic(log, "takeoff_status")["takeoff_state"]
    assert topic(log, "offboard_control_mode")["position"].all()
    vision = topic(log, "vehicle_visual_odometry")
    assert len(vision["timestamp"]) > 100 and np.isnan(vision["velocity[0]"]).all()


def test_home_is_recorded_only_when_it_changes(flown: tuple[Memory, Flight]) -> None:
    found = flown[0].read().get_dataset("home_position").data
    assert list(found["update_count"]) == list(range(1, 1 + len(found["timestamp"])))
    assert 1 <= len(found["timestamp"]) <= 3


def test_parameters_with_defaults_and_changes_are_read_by_arena(
    flown: tuple[Memory, Flight], tmp_path: Path
) -> None:
    memory = Memory()
    flight = Flight(1, params={"SDLOG_MODE": 2}, ulog=memory)
    flight.run(1.0)
    flight.pilots.params.set(0, "MPC_XY_P", 1.2)
    flight.run(0.5)
    log = memory.read()
    assert log.initial_parameters["MPC_THR_HOVER"] == pytest.approx(0.563)
    assert log.get_default_parameters(0)["MPC_THR_HOVER"] == 0.5
    assert [(name, value) for _, name, value in log.changed_parameters] == [("MPC_XY_P", pytest.approx(1.2))]
    (tmp_path / "uav1.ulg").write_bytes(memory.logs["uav1"][0])
    read = read_values(tmp_path / "uav1.ulg")
    assert read.version == "1.16.0" and read.values["EKF2_EV_CTRL"] == 11
    assert "not PX4" in log.msg_info_dict["sys_name"]


def test_same_seed_gives_the_same_bytes() -> None:
    first, second = Memory(), Memory()
    for memory in (first, second):
        fly(memory, seconds=1.5)
    assert first.logs == second.logs and len(first.logs["uav1"][0]) > 100_000


def test_sdlog_mode_selects_begin_and_end() -> None:
    modes = (-1, 0, 1, 2, 3, 4)
    memory = Memory()
    fly(memory, len(modes), 1.5, params=[{"SDLOG_MODE": mode} for mode in modes])
    names = {mode: f"uav{k + 1}" for k, mode in enumerate(modes)}
    assert set(memory.logs) == {names[mode] for mode in (0, 1, 2, 4)}
    assert all(len(logs) == 1 for logs in memory.logs.values())
    assert memory.open == {names[2], names[4]}
    from_boot = {
        mode: topic(memory.read(names[mode]), "actuator_armed")["armed"][0] == 0 for mode in (0, 1, 2, 4)
    }
    assert from_boot == {0: False, 1: True, 2: True, 4: False}


def test_second_flight_gets_a_log_of_its_own() -> None:
    memory = Memory()
    flight = fly(memory, seconds=1.5)
    flight.run(0.6, lambda f: f.setpoint(0, (0.5, 0.0, -1.5)))
    flight.offboard(0)
    flight.arm(0)
    flight.run(0.2, lambda f: f.setpoint(0, (0.5, 0.0, -1.5)))
    flight.pilots.close()
    assert [ULog(io.BytesIO(each)).start_timestamp > 0 for each in memory.logs["uav1"]] == [True, True]
    assert not memory.open, "the end of the process ends the log"


# -- files -------------------------------------------------------------------------------------------------------


@pytest.fixture
def frequent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pass the bytes to the thread at each call of `hand_over`."""
    monkeypatch.setattr(files, "_PERIOD_S", 0.0)


@pytest.mark.parametrize("method", ["begin", "write", "end", "hand_over"])
def test_error_in_the_log_does_not_end_the_flight(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ValueError("broken")

    memory = Memory()
    monkeypatch.setattr(memory, method, broken)
    flight = fly(memory, seconds=1.0)
    assert not flight.armed(0), "it has landed"
    (event,) = [text for text in flight.pilots.events() if "ulog" in text]
    assert "broken" in event


def test_files_of_two_flights_are_numbered(tmp_path: Path) -> None:
    sink = UlogFiles(tmp_path / "ulog")
    for number in (b"1", b"2"):
        sink.begin("uav1", b"head" + number)
        sink.write("uav1", b"data" + number)
        sink.end("uav1")
    sink.close()
    assert {p.name: p.read_bytes() for p in (tmp_path / "ulog").iterdir()} == {
        "uav1.ulg": b"head1data1",
        "uav1_2.ulg": b"head2data2",
    }
    assert sink.events() == []


def test_full_disk_ends_the_log_and_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, frequent: None
) -> None:
    def full(fd: int, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    sink = UlogFiles(tmp_path)
    monkeypatch.setattr(files, "write_all", full)
    sink.begin("uav1", b"head")
    for now in (1.0, 2.0, 3.0):
        sink.write("uav1", b"data")
        sink.hand_over(now)
    sink.close()
    assert sink.events() == ["uav1: the ULog ends here: No space left on device"]


@pytest.fixture
def hung(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """A disk that does not respond until the event is set."""
    respond, real = threading.Event(), files.write_all

    def write(fd: int, data: bytes) -> None:
        assert respond.wait(30.0)
        real(fd, data)

    monkeypatch.setattr(files, "write_all", write)
    yield respond
    respond.set()


def test_log_that_ends_during_a_write_is_complete(
    tmp_path: Path, hung: threading.Event, frequent: None
) -> None:
    sink = UlogFiles(tmp_path)
    sink.begin("uav1", b"head")
    sink.write("uav1", b"one")
    sink.hand_over(0.0)  # the thread waits for the disk in this write
    sink.write("uav1", b"two")
    sink.end("uav1")
    hung.set()
    sink.close()
    assert sink.events() == []
    assert (tmp_path / "uav1.ulg").read_bytes() == b"headonetwo"


def test_hung_disk_does_not_block_and_leaves_a_gap(
    tmp_path: Path, hung: threading.Event, frequent: None
) -> None:
    sink = UlogFiles(tmp_path)
    sink.begin("uav1", file_header(0) + topic_format("a", "uint64_t timestamp;") + subscriptions(["a"]))
    for k in range(100):
        sink.write("uav1", b"")
        sink.hand_over(0.5 * k)
    hung.set()
    sink.close()
    log = ULog(str(tmp_path / "uav1.ulg"))
    assert sum(gap.duration for gap in log.dropouts) > 10_000
    (event,) = sink.events()
    assert "the disk did not respond" in event


def test_logging_is_reported_while_a_log_is_written():
    flight = Flight(1, ulog=Memory())
    bit = mavlink.MAV_SYS_STATUS_LOGGING

    def reported() -> tuple[bool, bool]:
        flight.run(0.5)
        m = [m for m in flight.received[0] if m.get_type() == "SYS_STATUS"][-1]
        return bool(m.onboard_control_sensors_present & bit), bool(m.onboard_control_sensors_health & bit)

    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    assert reported() == (False, True)
    assert flight.arm(0) == 0
    assert reported() == (True, True)
