"""Packed telemetry: its values after decoding by pymavlink, and equal bytes of the compiled and the interpreted kernel."""

from __future__ import annotations

import math
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development

from arena.autopilot.flight_modes import Mode
from arena.autopilot.mavlink import packed_messages
from arena.autopilot.mavlink.packed_messages import FREQUENT, PACKED, RARE
from arena.autopilot.mavlink.telemetry_packer import HAS_CONTENT, TelemetryPacker
from arena.autopilot.navigation.mission_items import Origin
from arena.geometry import (
    euler_from_matrix,
    globe_from_local,
    matrix_from_quat,
    turn_horizontal,
    yaw_from_quat,
)
from arena.kernels.standard_atmosphere import pressure_hpa
from arena.kernels.telemetry_quantities import BITS, COLUMNS, VALUES
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.px4_messages import CURRENT_EVENT_SEQUENCE, ESC_INFO, ESC_STATUS
from arena.wire.px4_mode import CURRENT_MODE
from tests.kernels.kernel_versions import interpreted_modules, needs_compiled

VEHICLES, ROTORS = 3, 4
HEADING = 0.4
XY_VALID, Z_VALID = np.array([True, True, False]), np.array([True, False, True])
BOOT_UNIX_US = 1_767_225_600_123_457


class Rig:
    """Random states of three vehicles: the first has neither origin nor home, the last is controlled by rates."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        v = VEHICLES
        q_nb, q_sp = rng.normal(size=(v, 4)), rng.normal(size=(v, 4))
        q_nb /= np.linalg.norm(q_nb, axis=1, keepdims=True)
        p_n = rng.normal(0, 5, (v, 3))
        self.est = SimpleNamespace(
            p_n=p_n,
            v_n=rng.normal(0, 3, (v, 3)),
            q_nb=q_nb,
            r_nb=matrix_from_quat(q_nb),
            omega_b=rng.normal(size=(v, 3)),
            cov=np.stack([np.diag(rng.random(15)) for _ in range(v)]),
            reset_counter=rng.integers(0, 1000, v),
            xy_valid=lambda now: XY_VALID,
            z_valid=lambda now: Z_VALID,
            test_ratio=np.where(rng.random((v, 2)) < 0.3, np.inf, rng.random((v, 2))),
            sensed_accel_b=rng.normal(0, 9, (v, 3)),
            sensed_gyro_b=rng.normal(size=(v, 3)),
        )
        self.sp = SimpleNamespace(
            level=np.array([3, 3, 1]),
            p_n=np.where(rng.random((v, 3)) < 0.5, np.nan, 1.5),
            yaw=np.array([0.7, np.nan, np.nan]),
            yaw_rate=np.array([np.nan, 0.1, np.nan]),
        )
        position = SimpleNamespace(v_sp_n=rng.normal(size=(v, 3)), a_sp_n=rng.normal(size=(v, 3)))
        self.cascade = SimpleNamespace(position=position, q_sp=q_sp, omega_sp=rng.normal(size=(v, 3)))
        now = float(rng.uniform(0, 5000))
        self.state = SimpleNamespace(
            now_s=now,
            ms=int(now * 1e3),
            us=int(now * 1e6),
            accel_b=self.est.sensed_accel_b,
            gyro_b=self.est.sensed_gyro_b,
            mag_b=rng.normal(size=(v, 3)),
            baro_alt_m=rng.uniform(0, 500, v),
            battery_v=rng.uniform(10, 70, v),
            battery_a=rng.normal(0, 300, v),
            battery=rng.random(v),
            thrust=rng.random(v),
            motors=rng.random((v, ROTORS)),
            consumed_mah=rng.uniform(0, 5000, v),
        )
        origin = Origin(38.7, -9.1, 100.0, HEADING)
        self.vehicles = [self.vehicle(0, None, None)]
        self.vehicles += [self.vehicle(i, origin, [0.5, 0.5, -2.0]) for i in (1, 2)]
        self.packer = self.new_packer(self.state.motors)
        self.begin(self.packer)
        for v in self.vehicles:
            self.packer.set_status(v)
            self.packer.set_place(v)
            self.packer.set_newest_event(v, 65526 + v.row, int(v.row == 0))

    def new_packer(self, motors: Any) -> TelemetryPacker:
        given: Any = (self.est, self.sp, self.cascade, self.state.thrust, motors, self.state.consumed_mah)
        return TelemetryPacker(*given, links=2 * VEHICLES, boot_unix_us=BOOT_UNIX_US)

    def begin(self, packer: TelemetryPacker) -> None:
        """Pass the sensor values of the state to a packer."""
        s = self.state
        readings = {"mag_b": s.mag_b, "baro_alt_m": s.baro_alt_m, "battery_v": s.battery_v}
        readings |= {"battery_current_a": s.battery_a, "battery_remaining": s.battery}
        packer.begin(s.now_s, readings)

    def vehicle(self, row: int, origin: Origin | None, home_n: list[float] | None) -> Any:
        mode = Mode.LAND if row == 2 else Mode.OFFBOARD
        commander = SimpleNamespace(mode=mode, intended=Mode.OFFBOARD, armed=row > 0, failsafe=row == 2)
        return SimpleNamespace(
            row=row,
            system_id=row + 1,
            mav_type=2 + row,
            commander=commander,
            commander_params=SimpleNamespace(bat_low_thr=0.5, bat_crit_thr=0.3, bat_emergen_thr=0.1),
            aligned=row > 0,
            inputs=SimpleNamespace(manual_control=row == 1),
            landed_state=2,
            is_logged=row == 1,
            ready_to_arm=True,
            origin=origin,
            home_n=home_n,
            heading=HEADING,
            rotors=ROTORS,
        )

    def decoded(self, row: int, msgid: int) -> Any:
        (message,) = Codec(9, 9).parse(self.packer.pack(self.vehicles[row], [msgid], 0, 7))
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (row + 1, 1, 7)
        return message


def close(*values: float) -> Any:
    return pytest.approx(values, rel=1e-6, abs=1e-6, nan_ok=True)


@pytest.fixture(params=range(3), ids=lambda seed: f"seed{seed}")
def rig(request: pytest.FixtureRequest) -> Rig:
    return Rig(request.param)


def test_attitude_messages_have_the_estimated_attitude_and_rates(rig):
    for i in range(VEHICLES):
        m, q = rig.decoded(i, mavlink.MAVLINK_MSG_ID_ATTITUDE), rig.decoded(i, 31)
        assert m.time_boot_ms == q.time_boot_ms == rig.state.ms
        assert (m.roll, m.pitch, m.yaw) == close(*euler_from_matrix(rig.est.r_nb[i]))
        assert (q.q1, q.q2, q.q3, q.q4) == close(*rig.est.q_nb[i])
        for each in (m, q):
            assert (each.rollspeed, each.pitchspeed, each.yawspeed) == close(*rig.est.omega_b[i])


def test_odometry_has_the_variances_of_position_attitude_and_velocity(rig):
    for i in range(VEHICLES):
        m, cov = rig.decoded(i, mavlink.MAVLINK_MSG_ID_ODOMETRY), np.diagonal(rig.est.cov[i])
        assert (m.x, m.y, m.z) == close(*rig.est.p_n[i]) and (m.vx, m.vy, m.vz) == close(*rig.est.v_n[i])
        assert tuple(m.q) == close(*rig.est.q_nb[i])
        diagonal = (0, 6, 11, 15, 18, 20)
        assert tuple(m.pose_covariance[k] for k in diagonal) == close(*cov[0:3], *cov[6:9])
        assert tuple(m.velocity_covariance[k] for k in diagonal[:3]) == close(*cov[3:6])
        assert sum(map(math.isfinite, m.pose_covariance)) == 6
        assert sum(map(math.isfinite, m.velocity_covariance)) == 3
        assert (m.frame_id, m.child_frame_id, m.reset_counter) == (1, 1, rig.est.reset_counter[i] % 256)
        assert m.time_usec == rig.state.us


def test_global_position_is_that_of_the_turned_local_frame(rig):
    for i in (1, 2):
        m, p, v = rig.decoded(i, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), rig.est.p_n[i], rig.est.v_n[i]
        lat, lon = globe_from_local(38.7, -9.1, p[0], p[1], HEADING)
        assert (m.lat, m.lon) == pytest.approx((lat * 1e7, lon * 1e7), abs=0.6)
        assert (m.alt, m.relative_alt) == pytest.approx(((100.0 - p[2]) * 1e3, (-2.0 - p[2]) * 1e3), abs=1)
        north, east = turn_horizontal(v[0], v[1], HEADING)
        assert (m.vx, m.vy, m.vz) == pytest.approx((north * 100, east * 100, v[2] * 100), abs=1)
        yaw = euler_from_matrix(rig.est.r_nb[i])[2]
        assert m.hdg == pytest.approx(math.degrees(yaw + HEADING) % 360 * 100, abs=1)


def test_altitude_is_nan_without_origin_and_home(rig):
    without, m = rig.decoded(0, mavlink.MAVLINK_MSG_ID_ALTITUDE), rig.decoded(1, 141)
    assert math.isnan(without.altitude_amsl) and math.isnan(without.altitude_relative)
    up = -rig.est.p_n[1, 2]
    assert (m.altitude_monotonic, m.altitude_amsl) == close(rig.state.baro_alt_m[1], up + 100.0)
    assert (m.altitude_local, m.altitude_relative) == close(up, up - 2.0)
    assert math.isnan(m.altitude_terrain) and math.isnan(m.bottom_clearance)


def test_sensor_messages_have_the_measured_values(rig):
    m, s = rig.decoded(1, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU), rig.state
    assert (m.xacc, m.yacc, m.zacc) == close(*s.accel_b[1]) and (m.xgyro, m.ygyro, m.zgyro) == close(
        *s.gyro_b[1]
    )
    assert (m.xmag, m.ymag, m.zmag) == close(*s.mag_b[1])
    assert (m.abs_pressure, m.pressure_alt) == close(pressure_hpa(s.baro_alt_m[1]), s.baro_alt_m[1])
    assert (m.temperature, m.fields_updated, m.time_usec) == (25.0, 0x1BFF, s.us)


def test_servo_outputs_are_those_of_the_motors_while_armed(rig):
    for i in range(VEHICLES):
        m, armed = rig.decoded(i, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW), i > 0
        found = [getattr(m, f"servo{k}_raw") for k in range(1, 9)]
        motors = [int(1000 + 1000 * u) for u in rig.state.motors[i]] if armed else [900] * ROTORS
        assert found == motors + [900] * 4
        assert m.time_usec == rig.state.us % 2**32


def test_position_target_marks_values_that_are_not_controlled(rig):
    for i in range(VEHICLES):
        m, by_position = rig.decoded(i, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED), i < 2
        nan, position = [math.nan] * 3, rig.cascade.position
        yaw = [0.7, float(yaw_from_quat(rig.cascade.q_sp[1])), math.nan][i]
        expected = [*rig.sp.p_n[i], *(position.v_sp_n[i] if by_position else nan)]
        expected += [*(position.a_sp_n[i] if by_position else nan), yaw, rig.sp.yaw_rate[i]]
        found = (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw, m.yaw_rate)
        assert found == close(*expected)
        bits = (*range(9), 10, 11)
        mask = sum(1 << bit for bit, x in zip(bits, expected, strict=True) if not math.isfinite(x))
        assert (m.type_mask, m.coordinate_frame) == (mask, mavlink.MAV_FRAME_LOCAL_NED)


def test_attitude_target_and_hud_have_setpoint_and_speed(rig):
    m, hud = rig.decoded(1, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET), rig.decoded(1, 74)
    assert (*m.q, m.thrust) == close(*rig.cascade.q_sp[1], rig.state.thrust[1])
    assert (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate) == close(*rig.cascade.omega_sp[1])
    v = rig.est.v_n[1]
    assert (hud.groundspeed, hud.airspeed, hud.climb) == close(
        math.hypot(v[0], v[1]), math.hypot(v[0], v[1]), -v[2]
    )
    assert (hud.alt, hud.throttle) == close(100.0 - rig.est.p_n[1, 2], int(100 * rig.state.thrust[1]))


def test_status_messages_have_mode_arming_and_battery(rig):
    s = rig.state
    for i in range(VEHICLES):
        heart, status = rig.decoded(i, mavlink.MAVLINK_MSG_ID_HEARTBEAT), rig.decoded(i, 1)
        assert (heart.type, heart.autopilot, heart.mavlink_version) == (2 + i, mavlink.MAV_AUTOPILOT_PX4, 3)
        assert heart.custom_mode == rig.vehicles[i].commander.mode.custom_mode
        assert bool(heart.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) == (i > 0)
        assert heart.system_status == (3, 4, 5)[i]
        assert status.voltage_battery == min(int(s.battery_v[i] * 1e3), 65534)
        assert status.current_battery == int(min(max(s.battery_a[i] * 100, -32768), 32767))
        assert status.battery_remaining == round(100 * s.battery[i])
        gps = bool(status.onboard_control_sensors_present & mavlink.MAV_SYS_STATUS_SENSOR_GPS)
        assert gps == (i == 1)
        vision = bool(status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION)
        assert vision == (i < 2)
        assert rig.decoded(i, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE).landed_state == 2
    assert rig.decoded(0, mavlink.MAVLINK_MSG_ID_TIMESYNC).ts1 == int(s.now_s * 1e9)


@pytest.mark.parametrize("escs", [3, 4])
def test_esc_messages_divide_the_current_by_the_motor_commands(rig, escs):
    s, v = rig.state, rig.vehicles[1]
    v.rotors = escs
    rig.packer.set_place(v)
    info, status = (
        payload_of(rig.packer.pack(v, [ESC_INFO], 0, 0)),
        payload_of(rig.packer.pack(v, [ESC_STATUS], 0, 0)),
    )
    values = struct.unpack("<Q4i4f4fB", status.ljust(57, b"\0"))
    motors, absent = s.motors[1][:escs], [0.0] * (4 - escs)
    assert list(values[1:5]) == [int(6000 * u) for u in motors] + absent
    assert values[5:9] == close(*[s.battery_v[1]] * escs, *absent)
    assert values[9:13] == close(*(s.battery_a[1] * motors / motors.sum()), *absent)
    counter = math.floor(s.now_s * 10 + 0.5) & 0xFFFF
    expected = (s.us, 0, 0, 0, 0, counter, 0, 0, 0, 0, *[32767] * 4, 0, escs, 0, 2**escs - 1)
    assert struct.unpack("<Q4IH4H4h4B", info.ljust(46, b"\0")) == expected


def test_a_vehicle_with_six_rotors_sends_two_esc_messages(rig):
    motors = np.tile(np.arange(1.0, 7.0) / 10, (VEHICLES, 1))
    packer = rig.new_packer(motors)
    rig.begin(packer)
    v = rig.vehicles[1]
    v.rotors = 6
    packer.set_place(v)
    data = packer.pack(v, [30, ESC_STATUS, 31], 0, 254)
    frames = parse_frames(data).frames
    assert [f.msgid for f in frames] == [30, ESC_STATUS, ESC_STATUS, 31]
    assert [data[f.start + 4] for f in frames] == [254, 255, 0, 1]
    assert packer.frame_count(v, [30, ESC_STATUS, 31]) == 4
    second = data[frames[2].payload : frames[2].payload + frames[2].size].ljust(57, b"\0")
    assert second[56] == 4 and struct.unpack_from("<4i", second, 8) == (3000, 3600, 0, 0)


def payload_of(data: bytes) -> bytes:
    (frame,) = parse_frames(data).frames
    return data[frame.payload : frame.payload + frame.size]


def test_several_messages_have_increasing_sequence_numbers(rig):
    found = Codec(9, 9).parse(rig.packer.pack(rig.vehicles[1], [30, 31, 32, 105], 0, 254))
    assert [(m.get_msgId(), m.get_seq()) for m in found] == [(30, 254), (31, 255), (32, 0), (105, 1)]


def test_quantity_of_another_size_than_its_fields_is_refused(monkeypatch):
    monkeypatch.setitem(PACKED, 30, {"roll pitch": "rpy"})
    with pytest.raises(ValueError, match=r"message 30: .* contain 2 numbers, expected 3"):
        packed_messages.writers()


def test_each_message_is_either_frequent_or_rare():
    assert not FREQUENT.keys() & RARE.keys() and PACKED == FREQUENT | RARE


def framed(rig, row, message, dialect=mavlink):
    """Return the frame of a message of pymavlink, sent by a vehicle as frame 7."""
    sender = dialect.MAVLink(None, srcSystem=row + 1, srcComponent=1)
    sender.seq = 7
    return bytes(message.pack(sender))


def packed(rig, row, msgid, link=0):
    return rig.packer.pack(rig.vehicles[row], [msgid], link, 7)


def test_rare_messages_about_time_and_sensors_have_pymavlinks_bytes(rig):
    s = rig.state
    for i in range(VEHICLES):
        pressure = pressure_hpa(s.baro_alt_m[i])
        for message in (
            mavlink.MAVLink_system_time_message(BOOT_UNIX_US + s.us, s.ms),
            mavlink.MAVLink_scaled_pressure_message(s.ms, pressure, 0.0, 2500),
            mavlink.MAVLink_vibration_message(s.us, 0.0, 0.0, 0.0, 0, 0, 0),
        ):
            assert packed(rig, i, message.get_msgId()) == framed(rig, i, message)


@pytest.mark.parametrize(
    ("left", "state"), [(0.51, 1), (0.5, 2), (0.31, 2), (0.3, 3), (0.11, 3), (0.1, 4), (0.0, 4)]
)
def test_battery_status_has_pymavlinks_bytes_and_the_charge_state_of_the_thresholds(rig, left, state):
    s = rig.state
    s.battery[1] = left
    rig.begin(rig.packer)
    cells = [min(int(1e3 * s.battery_v[1]), 65534)] + [65535] * 9
    current = int(min(max(100.0 * s.battery_a[1], -32768), 32767))
    consumed, percent = int(s.consumed_mah[1]), round(100 * left)
    expected = mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells,
        current,
        consumed,
        -1,
        percent,
        0,
        state,
    )
    assert packed(rig, 1, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS) == framed(rig, 1, expected)


def test_changed_battery_thresholds_change_the_charge_state(rig):
    rig.state.battery[1] = 0.7
    rig.vehicles[1].commander_params.bat_low_thr = 0.8
    rig.begin(rig.packer)
    rig.packer.set_status(rig.vehicles[1])
    assert rig.decoded(1, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS).charge_state == 2


def test_unknown_battery_current_is_sent_as_zero(rig):
    rig.state.battery_a[1] = math.nan
    rig.begin(rig.packer)
    assert rig.decoded(1, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS).current_battery == 0


def test_home_position_has_pymavlinks_bytes(rig):
    (n, e, d), s = rig.vehicles[1].home_n, rig.state
    lat, lon = (round(x * 1e7) for x in globe_from_local(38.7, -9.1, n, e, HEADING))
    level = [1.0, 0.0, 0.0, 0.0]
    for us in (s.us, 2**32 - 1, 2**32, 2**40 + 3):
        rig.packer.law.set_time(0, us, 0)
        expected = mavlink.MAVLink_home_position_message(lat, lon, 102_000, n, e, d, level, 0.0, 0.0, 0.0, us)
        assert packed(rig, 1, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == framed(rig, 1, expected)


def test_vehicle_without_origin_or_home_has_no_home_position(rig):
    has_home, v = HAS_CONTENT[mavlink.MAVLINK_MSG_ID_HOME_POSITION], rig.vehicles[1]
    assert not has_home(rig.vehicles[0]) and has_home(v)
    v.home_n = None
    assert not has_home(v)


def test_estimator_status_has_pymavlinks_bytes(rig):
    for i, flags in enumerate((0b100101110, 0b100011011, 0b000100101)):  # the first is not aligned
        ratio, cov = np.minimum(rig.est.test_ratio[i], 3.4e38).tolist(), np.diagonal(rig.est.cov[i])
        accuracy = math.sqrt(cov[0] + cov[1]), math.sqrt(cov[2])
        given = (ratio[0], ratio[0], ratio[1], math.nan, math.nan, *accuracy)
        expected = mavlink.MAVLink_estimator_status_message(rig.state.us, flags, 0.0, *given)
        assert packed(rig, i, mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS) == framed(rig, i, expected)


def test_current_mode_has_pymavlinks_bytes(rig):
    offboard, land = Mode.OFFBOARD.custom_mode, Mode.LAND.custom_mode
    for i, (mode, standard) in enumerate(((offboard, 0), (offboard, 0), (land, 7))):
        expected = development.MAVLink_current_mode_message(standard, mode, offboard)
        assert packed(rig, i, CURRENT_MODE) == framed(rig, i, expected, development)


def test_current_event_sequence_has_the_newest_event(rig):
    for i in range(VEHICLES):
        payload = payload_of(packed(rig, i, CURRENT_EVENT_SEQUENCE)).ljust(3, b"\0")
        assert struct.unpack("<HB", payload) == (65526 + i, i == 0)


def test_each_link_numbers_its_own_pings(rig):
    ping = mavlink.MAVLINK_MSG_ID_PING
    for link, expected in ((0, [1, 2]), (3, [1, 2]), (0, [3, 4])):
        found = Codec(9, 9).parse(rig.packer.pack(rig.vehicles[0], [ping, 30, ping], link, 0))
        assert [m.seq for m in found if m.get_msgId() == ping] == expected
    first = mavlink.MAVLink_ping_message(rig.state.us, 1, 0, 0)
    assert packed(rig, 1, ping, link=2) == framed(rig, 1, first)


@pytest.mark.parametrize("number", [n for n in PACKED if n != mavlink.MAVLINK_MSG_ID_PING])
def test_a_message_alone_has_the_bytes_that_it_has_among_all(rig, number):
    """The kernel computes only what the messages of a datagram contain, so a value must not be that of another vehicle."""
    law = rig.packer.law
    for i in range(VEHICLES):
        law.pack(i, list(PACKED), 0, 0, i + 1, 1)
        among_all = law.pack(i, [number], 0, 0, i + 1, 1)
        law.pack((i + 1) % VEHICLES, list(PACKED), 0, 0, 1, 1)
        assert law.pack(i, [number], 0, 0, i + 1, 1) == among_all


def test_needs_of_a_message_follow_from_its_fields(rig):
    writers = rig.packer.law.writers
    needs = {
        mavlink.MAVLINK_MSG_ID_ATTITUDE: ("time", "angles", "motion"),
        mavlink.MAVLINK_MSG_ID_PING: ("time", "ping"),
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: ("time", "rare", "status"),
        ESC_INFO: ("time", "escs"),
    }
    for number, groups in needs.items():
        assert writers[number].needs == sum(BITS[group] for group in groups)


@needs_compiled
def test_compiled_and_interpreted_kernel_pack_the_same_bytes(rig):
    """Also with values beyond the range of their fields. The sign of NaN has no meaning, so no estimate is NaN."""
    modules = interpreted_modules("payload_writer", "telemetry_packing")
    compiled = rig.packer.law
    for scale in (1.0, 1e6, 1e300, math.inf, math.nan):
        rig.state.battery_a[1] = rig.state.accel_b[0] = scale
        if not math.isnan(scale):
            rig.est.p_n[1] = rig.est.v_n[2] = scale
        rig.begin(rig.packer)
        same = _interpreted_copy(modules, compiled)
        for i in range(VEHICLES):
            given = (i, list(PACKED), i, 3, i + 1, 1)
            assert compiled.pack(*given) == same.pack(*given)


def _interpreted_copy(modules: Any, packing: Any) -> Any:
    """Return a packing of the interpreted modules with the same inputs."""
    source, writer = modules["telemetry_packing"], modules["payload_writer"].PayloadWriter
    writers = [
        writer(w.number, w.size, w.seed, memoryview(w.fields), memoryview(w.ranges), w.needs)
        for w in packing.writers.values()
    ]
    constants = list(packing.values[VALUES:])
    given = (memoryview(each) for each in (packing.thrust, packing.motors, packing.consumed_mah))
    pings = memoryview(np.array(packing.pings))
    found = source.TelemetryPacking(*given, pings, constants, writers, packing.earth_m, packing.boot_unix_us)
    names = ("inputs", "rare_inputs", "mag_b", "baro_alt", "battery_v", "battery_a", "battery", "escs")
    for name in names:
        np.asarray(getattr(found, name))[...] = np.asarray(getattr(packing, name))
    estimates = ("accel_b", "gyro_b", "p_n", "v_n", "q_nb", "r_nb", "omega_b", "cov", "resets", "xy_valid")
    found.read_estimates_from(*(memoryview(getattr(packing, name)) for name in estimates))
    found.read_validity_from(memoryview(packing.z_valid), memoryview(packing.test_ratio))
    setpoints = ("level", "sp_p_n", "sp_yaw", "sp_yaw_rate", "v_sp_n", "a_sp_n", "q_sp", "omega_sp")
    found.read_setpoints_from(*(memoryview(getattr(packing, name)) for name in setpoints))
    times = [packing.values[COLUMNS[name]] for name in ("time_ms", "time_us", "time_ns")]
    found.set_time(*times)
    return found
