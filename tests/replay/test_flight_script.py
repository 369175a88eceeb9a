"""Tests of scripts made from logs: telemetry, frames and true states from the columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.flight_log.flight import Flight
from arena.geometry import quat_from_euler
from arena.replay.flight_script import FlightScript, vehicle_ids
from arena.replay.script import NS, Item, Kind, TrueState
from arena.replay.synthetic_telemetry import custom_mode
from arena.wire.flight_record import RecordedFrame
from arena.wire.px4_mode import mode_words
from arena.wire.telemetry import Telemetry

N = 91
T = np.arange(N) / 30.0


def log(name: str, t0: float = 100.0, *, truth: bool = False) -> Flight:
    """Return a log of 3 s at 30 Hz: a climb with a turn."""
    q = quat_from_euler(np.stack([0.1 * np.sin(T), 0.2 * np.cos(T), 2.5 * T], axis=1))
    pos = np.stack([0.5 * T, -0.2 * T, -0.3 * T], axis=1)
    vel = np.tile([0.5, -0.2, -0.3], (N, 1))
    numbers = {"time.seconds": t0 + T, "info.battery": np.linspace(80.0, 78.0, N)}
    wxyz, ned, rpy = ("w", "x", "y", "z"), ("north", "east", "down"), ("roll", "pitch", "yaw")
    for group, parts, values in (
        *((f"{g}.pos", ned, pos) for g in (("ekf", "mocap", "truth") if truth else ("ekf", "mocap"))),
        *((f"{g}.att_q", wxyz, q) for g in (("ekf", "mocap", "truth") if truth else ("ekf", "mocap"))),
        ("ekf.vel", ned, vel),
        ("ekf.ang_vel", rpy, vel),
        ("imu.acc_body", ned, vel - 9.0),
        ("imu.ang_vel", rpy, vel),
        ("imu.mag", ned, 1e-5 * vel),
        ("pos_ref", ned, pos + 0.1),
        ("att_euler_ref", rpy, np.full((N, 3), 0.1)),
        ("act.output", ("1", "2", "3", "4"), np.full((N, 4), 0.6)),
        *((("truth.vel", ned, vel), ("truth.ang_vel", rpy, vel)) if truth else ()),
    ):
        numbers |= {f"{group}.{part}": values[:, k] for k, part in enumerate(parts)}
    modes = ["AUTO.LOITER" if t < 1.0 else "OFFBOARD" for t in T]
    return Flight(name=name, t=T, t0=t0, numbers=numbers, mode=modes, armed=T > 0.5, landed=T < 0.7)


@pytest.mark.parametrize(
    ("rotors", "servos", "mav_type"), [(0, 0, 2), (4, 0, 2), (4, 2, 2), (6, 0, 13), (6, 2, 13), (8, 0, 14)]
)
def test_heartbeat_has_the_type_of_the_number_of_rotors(rotors: int, servos: int, mav_type: int) -> None:
    """A servo has an output while the vehicle is disarmed, too."""
    flight = log("uav3")
    turns, moves = np.where(flight.armed, 0.6, 0.0), np.full(N, 0.5)
    kinds = [turns] * rotors + [moves] * servos + [np.zeros(N)] * (8 - rotors - servos)
    outputs = {f"act.output.{k + 1}": values for k, values in enumerate(kinds)}
    script = FlightScript([replace(flight, numbers={**flight.numbers, **outputs})])
    parser = mavlink.MAVLink(None)
    sent = [
        m for item in of(list(script.items(0)), Kind.DOWN) for m in parser.parse_buffer(item.payload) or []
    ]
    assert {m.type for m in sent if m.get_type() == "HEARTBEAT"} == {mav_type}


def of(items: list[Item], kind: Kind, vehicle: int = 0) -> list[Item]:
    return [i for i in items if i.kind is kind and i.vehicle == vehicle]


def test_telemetry_has_the_values_of_each_row_at_its_time() -> None:
    flight = log("uav3")
    script = FlightScript([flight])
    telemetry = Telemetry(3)
    sent = of(list(script.items(0)), Kind.DOWN)
    assert [i.time_ns for i in sent] == [round(NS * t) for t in 100.0 + T]
    for row, item in enumerate(sent):
        assert isinstance(item.payload, bytes)
        telemetry.on_datagram(item.payload, item.time_ns / NS)
        local, attitude, imu = telemetry.local, telemetry.attitude, telemetry.imu
        assert local is not None and attitude is not None and imu is not None
        assert local.pos == pytest.approx(flight.group("ekf.pos")[row], abs=1e-6)
        assert local.vel == pytest.approx([0.5, -0.2, -0.3], abs=1e-6)
        assert attitude.q_nb == pytest.approx(flight.group("ekf.att_q", ("w", "x", "y", "z"))[row], abs=1e-6)
        assert imu.acc_body == pytest.approx([-8.5, -9.2, -9.3], abs=1e-5)
        assert local.boot_s == pytest.approx(100.0 + T[row], abs=1e-3)
        heartbeat, ground, reference = telemetry.heartbeat, telemetry.ground, telemetry.reference
        assert heartbeat is not None and ground is not None and reference is not None
        assert (heartbeat.mode, heartbeat.armed) == (flight.mode[row], flight.armed[row])
        assert ground.landed == flight.landed[row]
        assert reference.pos == pytest.approx(flight.group("pos_ref")[row], abs=1e-6)
        assert np.isnan(reference.vel).all()
    status, wanted, actuators = telemetry.status, telemetry.attitude_reference, telemetry.actuators
    assert status is not None and wanted is not None and actuators is not None
    assert status.battery == pytest.approx(78.0, abs=1.0)
    assert wanted.q_nb == pytest.approx(quat_from_euler([0.1, 0.1, 0.1]), abs=1e-6)
    assert actuators.output[:4] == pytest.approx([0.6] * 4, abs=1e-3)


def test_frames_have_the_poses_of_all_vehicles_at_the_rows_of_the_first() -> None:
    shifted = log("uav2", 100.01)
    script = FlightScript([log("uav1"), shifted])
    frames = [i.payload for i in script.items(0) if isinstance(i.payload, RecordedFrame)]
    assert [f.number for f in frames] == list(range(1, N + 1))
    a, b = frames[30].bodies
    assert (a.name, b.name) == ("uav1", "uav2")
    assert a.p_n == pytest.approx((0.5, -0.2, -0.3))
    assert b.p_n == pytest.approx((0.495, -0.198, -0.297), abs=1e-9)  # 10 ms earlier in its flight
    assert np.linalg.norm(b.q_nb) == pytest.approx(1.0)
    assert not frames[0].bodies[1].tracked  # the second log begins 10 ms later


def test_gap_in_the_captured_poses_is_not_interpolated() -> None:
    flight = log("uav2")
    numbers = dict(flight.numbers)
    numbers["mocap.pos.north"] = np.where((T > 1.0) & (T < 2.0), np.nan, numbers["mocap.pos.north"])
    script = FlightScript([log("uav1"), replace(flight, numbers=numbers)])
    frames = [i.payload for i in script.items(0) if isinstance(i.payload, RecordedFrame)]
    tracked = [f.bodies[1].tracked for f in frames]
    assert tracked == [bool(t <= 1.0 or t >= 2.0) for t in T]


def test_true_state_is_sent_if_the_log_has_it() -> None:
    script = FlightScript([log("uav1", truth=True), log("uav2")])
    items = list(script.items(0))
    assert len(of(items, Kind.TRUTH, 0)) == N
    assert not of(items, Kind.TRUTH, 1)
    state = of(items, Kind.TRUTH, 0)[30].payload
    assert isinstance(state, TrueState)
    assert state.p_n == pytest.approx((0.5, -0.2, -0.3))
    assert [v.simulated for v in script.vehicles] == [True, False]


def test_messages_are_in_the_order_of_time_and_begin_at_the_requested_time() -> None:
    script = FlightScript([log("uav1", truth=True), log("uav2", 100.5)])
    times = [i.time_ns for i in script.items(101 * NS)]
    assert times == sorted(times)
    assert times[0] >= 101 * NS
    assert (script.start_ns, script.end_ns) == (100 * NS, round(103.5 * NS))


def test_logs_of_different_clocks_begin_at_the_same_time() -> None:
    script = FlightScript([log("uav1", 5000.0), log("uav2", 20.0)])
    firsts = {i.vehicle: i.time_ns for i in reversed(list(script.items(0))) if i.kind is Kind.DOWN}
    assert firsts == {0: 5000 * NS, 1: 5000 * NS}


def test_ids_are_the_numbers_in_the_names() -> None:
    names = ["setpoints_real_uav2", "log", "uav2", "log", "uav999"]
    assert vehicle_ids(names) == {"setpoints_real_uav2": 2, "log": 1, "uav2": 3, "log_2": 4, "uav999": 5}


def test_names_of_modes_are_those_of_px4_or_mavsdk() -> None:
    assert mode_words(custom_mode("OFFBOARD")) == "OFFBOARD"
    assert mode_words(custom_mode("HOLD")) == "AUTO.LOITER"
    assert custom_mode("unheard of") == 0
