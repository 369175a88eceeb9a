"""Data groups of a program: units, frames and ages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import StaleDataError
from arena.geometry import quat_from_euler, quat_rotate
from arena.uav.data_groups import Snapshot
from arena.uav.data_source import Body, Source
from arena.uav.measurements import Measurements, RelativeSensors
from arena.uav.poses import Poses
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import SENSORS_COMPONENT
from arena.wire.px4_mode import mode_numbers, mode_words
from arena.wire.relative_measurements import (
    DEBUG_FLOAT_ARRAY,
    BeaconMeasurement,
    Measurement,
    NeighbourMeasurement,
    measurement_payload,
)
from arena.wire.telemetry import Telemetry

BODY = Body(ns="uav1", mass=1.5, radius=0.3, height=0.1, num_rotors=4, thrust_curve={"kind": "quadratic"})
SENSORS = RelativeSensors(
    neighbours={"uav2": 2, "uav3": 3}, beacons={"door": 1, "window": 2}, beacons_stale_s=3.0
)
Q_NB = quat_from_euler(np.radians([10, -20, 35]))


class Bench:
    """Data groups over telemetry and a time that the test sets."""

    def __init__(self) -> None:
        self.now = 100.0
        self.telemetry = Telemetry(1)
        self.poses = Poses("aero2")
        self.relative = Measurements(SENSORS, 1)
        self.source = Source(
            ns="uav1",
            stale_s=0.5,
            telemetry=self.telemetry,
            poses=self.poses,
            relative=self.relative,
            now=lambda: self.now,
            refresh=lambda: None,
        )
        self.uav = Snapshot.of(self.source, BODY)
        self._out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def measure(self, measurement: Measurement, system: int = 1) -> None:
        self.relative.on_datagram(
            Codec(system, SENSORS_COMPONENT).frame(DEBUG_FLOAT_ARRAY, measurement_payload(measurement)),
            self.now,
        )

    def receive(self, *messages: mavlink.MAVLink_message, prefix: bytes = b"") -> None:
        self.telemetry.on_datagram(prefix + b"".join(m.pack(self._out) for m in messages), self.now)


@pytest.fixture
def bench() -> Bench:
    found = Bench()
    found.receive(
        mavlink.MAVLink_local_position_ned_message(1, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3),
        mavlink.MAVLink_attitude_quaternion_message(1, *Q_NB, 0.4, 0.5, 0.6),
        mavlink.MAVLink_highres_imu_message(
            0, 1, 2, -9.8, 0.1, 0.2, 0.3, 0.2, 0.1, 0.4, 1013.25, 0.0, 12.5, 21.0, 0x1FFF
        ),
        mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128, 4 << 16 | 6 << 24, 4, 3),
        mavlink.MAVLink_extended_sys_state_message(0, 2),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 0, 42, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_servo_output_raw_message(0, 1, 1250, 1500, 1750, 2000, 0, 0, 0, 0),
        mavlink.MAVLink_gps_raw_int_message(0, 3, 473977420, 85455940, 488_000, 0, 0, 0, 0, 9),
    )
    return found


def test_estimate_is_in_ned_and_body_values_in_frd(bench):
    ekf = bench.uav.ekf
    assert ekf.pos.tolist() == pytest.approx([1, 2, -3]) and ekf.pos.shape == (3,)
    assert ekf.att_q == pytest.approx(Q_NB, abs=1e-6)
    assert np.degrees(ekf.att_euler) == pytest.approx([10, -20, 35], abs=1e-3)
    assert quat_rotate(Q_NB, ekf.vel_body) == pytest.approx(ekf.vel, abs=1e-6)
    assert ekf.ang_vel.tolist() == pytest.approx([0.4, 0.5, 0.6])


def test_sensor_values_are_in_si_units(bench):
    sen = bench.uav.sen
    assert sen.imu.acc_body.tolist() == pytest.approx([1, 2, -9.8])
    assert sen.imu.ang_vel.tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert sen.imu.mag.tolist() == pytest.approx([2e-5, 1e-5, 4e-5])
    assert (sen.baro.pressure, sen.baro.alt, sen.baro.temperature) == pytest.approx(
        (101325, 12.5, 21.0), rel=1e-5
    )
    assert sen.gps.pos.tolist() == pytest.approx([47.397742, 8.545594, 488.0])


def test_info_and_actuator_values(bench):
    info = bench.uav.info
    assert (info.flight_mode, info.is_armed, info.is_landed, info.is_connected) == (
        "AUTO.LAND",
        True,
        False,
        True,
    )
    assert (info.battery, info.drone_ns, info.mass, info.num_rotors) == (42.0, "uav1", 1.5, 4)
    assert bench.uav.act.output.tolist() == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert bench.uav.act.group == 1


FAST = [
    lambda u: u.ekf.pos,
    lambda u: u.ekf.vel,
    lambda u: u.ekf.vel_body,
    lambda u: u.ekf.att_q,
    lambda u: u.ekf.att_euler,
    lambda u: u.ekf.ang_vel,
    lambda u: u.sen.imu.acc_body,
    lambda u: u.sen.imu.ang_vel,
    lambda u: u.sen.imu.mag,
    lambda u: u.sen.mocap.pos,
    lambda u: u.sen.mocap.att_q,
    lambda u: u.sen.mocap.att_euler,
    lambda u: u.sen.baro.alt,
    lambda u: u.sen.emu.rel_pos,
    lambda u: u.sen.emu.rel_vel,
    lambda u: u.sen.neighbours["uav3"].pos,
    lambda u: u.sen.neighbours["uav3"].vel,
]
SLOW = [
    lambda u: u.sen.beacons["window"].range,
    lambda u: u.sen.beacons["window"].azimuth,
    lambda u: u.sen.beacons["window"].direction,
    lambda u: u.sen.gps.pos,
    lambda u: u.act.output,
    lambda u: u.act.group,
    lambda u: u.info.flight_mode,
    lambda u: u.info.is_armed,
    lambda u: u.info.is_landed,
    lambda u: u.info.battery,
]


@pytest.mark.parametrize("read", FAST + SLOW)
def test_value_that_never_arrived_raises(read):
    with pytest.raises(StaleDataError, match=r"uav1: no .* arrived yet"):
        read(Bench().uav)


@pytest.mark.parametrize(("read", "age"), [*((r, 0.6) for r in FAST), *((r, 10.5) for r in SLOW)])
def test_stale_value_raises_with_its_age(bench, read, age):
    bench.poses.receive("aero2", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), bench.now)
    for number in (2, 3):
        bench.measure(NeighbourMeasurement(99.9, number, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.01, 0.02))
    bench.measure(BeaconMeasurement(99.9, 2, 5.0, 0.5, -0.25, 0.1, 0.01, (1.0, -2.0, -3.0)))
    read(bench.uav)
    bench.now += age
    with pytest.raises(StaleDataError, match=f"{age:.2f} s old"):
        read(bench.uav)


def test_slow_messages_have_a_longer_age_limit(bench):
    bench.now += 1.5
    assert bench.uav.info.is_armed and bench.uav.info.battery == 42.0
    assert bench.uav.ekf.age_s == pytest.approx(1.5)


def test_is_connected_never_raises():
    assert Bench().uav.info.is_connected is False


def test_neighbours_are_read_by_name_in_the_order_of_the_yaml(bench):
    bench.measure(NeighbourMeasurement(99.9, 3, (-1.0, 0.5, 2.0), (0.0, 0.0, -1.0), 0.01, 0.02))
    bench.now += 0.1
    bench.measure(NeighbourMeasurement(100.0, 2, (1.0, 2.0, -3.0), (0.5, -0.25, 0.0), 0.01, 0.02))
    near = bench.uav.sen.neighbours
    assert list(near) == ["uav2", "uav3"]
    assert near["uav2"].pos.tolist() == [1.0, 2.0, -3.0] and near["uav2"].vel.tolist() == [0.5, -0.25, 0.0]
    assert near["uav3"].pos.tolist() == [-1.0, 0.5, 2.0]
    assert (near["uav2"].age_s, near["uav2"].stamp_s) == (0.0, 100.0)
    assert near["uav3"].age_s == pytest.approx(0.1)
    emu = bench.uav.sen.emu
    assert emu.rel_pos.tolist() == [[1.0, 2.0, -3.0], [-1.0, 0.5, 2.0]]
    assert emu.rel_vel.tolist() == [[0.5, -0.25, 0.0], [0.0, 0.0, -1.0]]
    assert emu.age_s == pytest.approx(0.1)


def test_missing_neighbour_makes_the_array_stale(bench):
    bench.measure(NeighbourMeasurement(99.9, 3, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.01, 0.02))
    assert bench.uav.sen.neighbours["uav3"].pos.shape == (3,)
    with pytest.raises(StaleDataError, match="uav2"):
        _ = bench.uav.sen.emu.rel_pos


def test_values_without_age_limit_contain_measurements_too(bench):
    bench.measure(NeighbourMeasurement(99.9, 2, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.01, 0.02))
    bench.now += 60.0
    last = Snapshot.of(dataclasses.replace(bench.source, stale_s=np.inf), BODY)
    assert last.sen.neighbours["uav2"].pos.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(StaleDataError):
        _ = bench.uav.sen.neighbours["uav2"].pos


def test_unknown_neighbour_is_refused_with_the_names(bench):
    with pytest.raises(KeyError, match="uav2, uav3"):
        _ = bench.uav.sen.neighbours["uav9"]
    with pytest.raises(KeyError, match="door, window"):
        _ = bench.uav.sen.beacons["roof"]


def test_direction_of_a_beacon_is_a_unit_vector_in_body_axes(bench):
    bench.measure(BeaconMeasurement(99.9, 2, 5.0, np.pi / 2, 0.5, 0.1, 0.01, (1.0, -2.0, -3.0)))
    window = bench.uav.sen.beacons["window"]
    assert (window.range, window.pos.tolist()) == (5.0, [1.0, -2.0, -3.0])
    assert window.direction == pytest.approx([0.0, np.cos(0.5), -np.sin(0.5)], abs=1e-6)
    assert [beacon.range for beacon in bench.uav.sen.beacons.in_range()] == [5.0]
    bench.now += 3.1
    assert bench.uav.sen.beacons.in_range() == []


def test_measurements_of_another_vehicle_are_ignored(bench):
    bench.measure(NeighbourMeasurement(99.9, 2, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0), 0.0, 0.0), system=2)
    with pytest.raises(StaleDataError, match="no measurement of neighbour uav2 has arrived yet"):
        _ = bench.uav.sen.neighbours["uav2"].pos


def test_snapshot_does_not_change(bench):
    bench.measure(NeighbourMeasurement(99.9, 2, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.0, 0.0))
    fixed = Snapshot.of(bench.source.fixed(), BODY)
    bench.now += 0.3
    bench.measure(NeighbourMeasurement(99.9, 2, (5.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.0, 0.0))
    bench.receive(mavlink.MAVLink_local_position_ned_message(1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0))
    assert fixed.ekf.pos[0] == 1.0 and bench.uav.ekf.pos[0] == 9.0
    assert fixed.ekf.age_s == 0.0
    assert fixed.sen.neighbours["uav2"].pos[0] == 1.0 and bench.uav.sen.neighbours["uav2"].pos[0] == 5.0


def test_returned_vectors_are_copies(bench):
    bench.uav.ekf.pos[:] = 7.0
    assert bench.uav.ekf.pos[0] == 1.0


def test_messages_of_other_systems_and_components_are_ignored(bench):
    for system, component in ((2, 1), (1, 191)):
        stranger = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        bench.telemetry.on_datagram(
            mavlink.MAVLink_heartbeat_message(2, 12, 0, 6 << 16, 4, 3).pack(stranger), bench.now
        )
    assert bench.uav.info.flight_mode == "AUTO.LAND"


def test_damaged_frame_is_dropped(bench):
    out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    data = bytearray(mavlink.MAVLink_heartbeat_message(2, 12, 0, 6 << 16, 4, 3).pack(out))
    data[12] ^= 0xFF
    assert bench.telemetry.on_datagram(bytes(data), bench.now) is False
    assert bench.uav.info.flight_mode == "AUTO.LAND"


def test_messages_after_random_bytes_are_received(bench):
    rng = np.random.default_rng(6)
    for size in rng.integers(1, 400, 500):
        bench.telemetry.on_datagram(rng.bytes(int(size)), bench.now)
        bench.telemetry.on_datagram(b"\xfd" + rng.bytes(int(size)), bench.now)
    bench.receive(mavlink.MAVLink_heartbeat_message(2, 12, 0, 6 << 16, 4, 3), prefix=b"\x00\x01\x02")
    assert bench.uav.info.flight_mode == "OFFBOARD"


def test_frame_after_a_damaged_one_is_received(bench):
    torn = bytearray(mavlink.MAVLink_extended_sys_state_message(0, 1).pack(bench._out))
    torn[-1] ^= 0xFF
    bench.receive(mavlink.MAVLink_heartbeat_message(2, 12, 0, 6 << 16, 4, 3), prefix=bytes(torn))
    assert bench.uav.info.flight_mode == "OFFBOARD"
    assert not bench.uav.info.is_landed


def test_chunks_of_a_long_text_are_joined(bench):
    bench.receive(
        mavlink.MAVLink_statustext_message(3, b"x" * 50, 9, 0),
        mavlink.MAVLink_statustext_message(3, b"end", 9, 1),
        mavlink.MAVLink_statustext_message(3, b"another", 10, 0),
        mavlink.MAVLink_statustext_message(6, b"plain"),
    )
    assert bench.telemetry.recent_texts(0.0) == ["x" * 50 + "end", "another", "plain"]
    assert bench.telemetry.recent_texts(0.0, worst=3) == ["x" * 50 + "end", "another"]
    assert bench.telemetry.recent_texts(bench.now + 1) == []


@pytest.mark.parametrize("words", ["OFFBOARD", "AUTO.LAND", "AUTO.LOITER", "AUTO.TAKEOFF", "POSCTL"])
def test_mode_names_and_numbers_agree(words):
    main, sub = mode_numbers(words)
    assert mode_words(main << 16 | sub << 24) == words
