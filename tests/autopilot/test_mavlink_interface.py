"""The MAVLink interface: acknowledgements, parameters, streams, and malformed bytes."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from flight import Flight, with_rotors
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

PX4_ONBOARD_HZ = {
    "ATTITUDE": 100,
    "ATTITUDE_QUATERNION": 50,
    "HIGHRES_IMU": 50,
    "LOCAL_POSITION_NED": 30,
    "ODOMETRY": 30,
    "ALTITUDE": 10,
    "SERVO_OUTPUT_RAW": 10,
    "TIMESYNC": 10,
    "VFR_HUD": 10,
    "EXTENDED_SYS_STATE": 5,
    "SYS_STATUS": 5,
    "HEARTBEAT": 1,
    "SYSTEM_TIME": 1,
}


def ready() -> Flight:
    """Return a flight of one vehicle that may be armed."""
    flight = Flight(1)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    return flight


@pytest.fixture(scope="module")
def shared() -> Flight:
    return ready()


@pytest.fixture
def flight(shared: Flight) -> Iterator[Flight]:
    """The shared flight: disarmed, in HOLD, without origin, home and setpoint."""
    vehicle = shared.pilots.vehicles[0]
    vehicle.origin = vehicle.home_n = None
    vehicle.offboard.level[0] = vehicle.offboard.contents[0] = 0
    vehicle.offboard.received_at[0] = -1e9
    shared.run(0.02)  # the streams read the changes
    shared.received.forget(0)
    yield shared
    shared.command(0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
    assert shared.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == 0
    shared.run(0.1)
    assert not shared.armed(0) and vehicle.ready_to_arm


@pytest.mark.parametrize(
    ("rotors", "mav_type"),
    [
        (4, mavlink.MAV_TYPE_QUADROTOR),
        (6, mavlink.MAV_TYPE_HEXAROTOR),
        (8, mavlink.MAV_TYPE_OCTOROTOR),
        (5, mavlink.MAV_TYPE_QUADROTOR),
    ],
)
def test_heartbeat_has_the_type_of_the_number_of_rotors(rotors, mav_type, monkeypatch):
    monkeypatch.setattr("flight.PROFILE", with_rotors(rotors))
    flight = Flight(1)
    flight.motors = np.zeros((1, rotors))
    flight.run(1.5)
    assert {m.type for m in flight.received[0] if m.get_type() == "HEARTBEAT"} == {mav_type}


def test_stream_rates_are_px4s(flight):
    flight.run(0.1)
    flight.received.forget(0)
    flight.run(5.0)
    counted = Counter(m.get_type() for m in flight.received[0])
    for name, hz in PX4_ONBOARD_HZ.items():
        assert abs(counted[name] / 5.0 - hz) <= max(0.2, 0.02 * hz), name


def test_message_intervals_can_be_set_and_messages_requested(flight):
    assert flight.command(0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 500_000) == 0
    flight.received.forget(0)
    flight.run(2.0)
    assert 3 <= sum(m.get_type() == "ATTITUDE" for m in flight.received[0]) <= 5
    assert flight.command(0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1) == 0
    flight.received.forget(0)
    flight.run(0.5)
    assert not any(m.get_type() == "ATTITUDE" for m in flight.received[0])
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == 0
    assert any(m.get_type() == "AUTOPILOT_VERSION" for m in flight.received[0])


def test_parameters_are_listed_and_written_unknown_names_ignored(flight):
    codec = flight.codec[0]
    flight.received.forget(0)
    flight.send(0, codec.param_request_list_encode(1, 1))
    flight.run(1.0)
    values = [m for m in flight.received[0] if m.get_type() == "PARAM_VALUE"]
    assert values[0].param_id == "_HASH_CHECK"
    assert len({m.param_id for m in values[1:]}) == values[0].param_count
    packed = struct.unpack("<f", struct.pack("<i", 5))[0]
    flight.send(0, codec.param_set_encode(1, 1, b"COM_OBL_RC_ACT", packed, mavlink.MAV_PARAM_TYPE_INT32))
    flight.send(0, codec.param_set_encode(1, 1, b"MPC_XY_P", 1.1, mavlink.MAV_PARAM_TYPE_REAL32))
    assert flight.pilots.params["COM_OBL_RC_ACT"][0] == 5
    assert abs(flight.pilots.params["MPC_XY_P"][0] - 1.1) < 1e-6
    flight.run(0.05)
    flight.received.forget(0)
    flight.send(0, codec.param_request_read_encode(1, 1, b"NO_SUCH_NAME", -1))
    flight.run(0.1)
    assert not any(m.get_type() == "PARAM_VALUE" for m in flight.received[0])


def test_ground_station_is_warned_of_a_parameter_without_effect(flight):
    codec = flight.codec[0]
    flight.received.forget(0)
    flight.send(0, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    flight.send(0, codec.param_set_encode(1, 1, b"MPC_ACC_HOR_MAX", 4.0, mavlink.MAV_PARAM_TYPE_REAL32))
    flight.send(0, codec.param_set_encode(1, 1, b"MPC_XY_P", 1.05, mavlink.MAV_PARAM_TYPE_REAL32))
    flight.run(0.3)
    texts = "".join(m.text for m in flight.received[0] if m.get_type() == "STATUSTEXT")
    assert "does not use MPC_ACC_HOR_MAX" in texts and "MPC_XY_P" not in texts, texts
    assert flight.pilots.params["MPC_ACC_HOR_MAX"][0] == 4.0


def test_parameter_out_of_range_or_not_finite_is_refused(flight):
    before = float(flight.pilots.params["MPC_XY_P"][0])
    for value in (float("nan"), float("inf"), 1e9, -1.0):
        flight.send(
            0, flight.codec[0].param_set_encode(1, 1, b"MPC_XY_P", value, mavlink.MAV_PARAM_TYPE_REAL32)
        )
    assert flight.pilots.params["MPC_XY_P"][0] == before


def test_arming_without_vision_is_refused_with_the_reason():
    flight = Flight(1)
    flight.vision_on[:] = False
    flight.run(1.0)
    flight.send(0, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    assert flight.arm(0) == 1
    assert "external vision" in "".join(m.text for m in flight.received[0] if m.get_type() == "STATUSTEXT")


def test_offboard_can_be_selected_disarmed_but_not_armed_without_setpoints(flight):
    assert flight.offboard(0) == 0
    assert flight.arm(0) == 1
    assert not flight.armed(0)


def test_armed_vehicle_refuses_offboard_without_setpoints(flight):
    assert flight.arm(0) == 0
    assert flight.offboard(0) == 1
    assert flight.mode(0) == "AUTO.LOITER"


def test_broadcast_commands_and_parameters_are_ignored(flight):
    for system, component in ((0, 0), (0, 1)):
        flight.received.forget(0)
        flight.send(
            0,
            mavlink.MAVLink_command_long_message(
                system, component, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
            ),
        )
        flight.send(
            0, mavlink.MAVLink_param_set_message(0, 1, b"MPC_XY_P", 1.1, mavlink.MAV_PARAM_TYPE_REAL32)
        )
        flight.run(0.1)
        assert not flight.armed(0)
        assert not any(m.get_type() in ("COMMAND_ACK", "PARAM_VALUE") for m in flight.received[0])
    assert flight.pilots.params["MPC_XY_P"][0] != 1.1


def test_flight_termination_needs_param1_of_1_and_an_armed_vehicle(flight):
    assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == 2
    assert flight.arm(0) == 0
    for value in (0.0, float("nan"), -1.0):
        assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, value) == 2
        assert flight.mode(0) == "AUTO.LOITER"
    assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == 0
    assert flight.mode(0) == "TERMINATION"


def test_forced_arming_skips_no_check(flight):
    flight.offboard(0)
    assert flight.command(0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196) == 1
    assert not flight.armed(0)


def test_request_of_a_message_without_content_is_denied(flight):
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == 2
    assert flight.command(0, mavlink.MAV_CMD_GET_HOME_POSITION) == 2
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    flight.run(0.1)
    assert flight.command(0, mavlink.MAV_CMD_GET_HOME_POSITION) == 0
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, 435) == 0
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == 2


def test_offboard_right_after_the_first_setpoint_is_accepted(flight):
    flight.setpoint(0, [0, 0, -1.0])
    assert flight.offboard(0) == 0


def test_global_position_is_reported_valid_only_with_an_origin(flight):

    def reported() -> bool:
        flight.received.forget(0)
        flight.run(0.25)
        status = next(m for m in flight.received[0] if m.get_type() == "SYS_STATUS")
        bit = mavlink.MAV_SYS_STATUS_SENSOR_GPS
        return bool(status.onboard_control_sensors_present & status.onboard_control_sensors_health & bit)

    assert not reported()
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    assert reported()


def test_commands_for_other_systems_or_components_are_ignored(flight):
    flight.send(0, mavlink.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.send(0, mavlink.MAVLink_command_long_message(1, 51, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.run(0.1)
    assert not flight.armed(0)


def test_estimator_type_mocap_and_invalid_poses_are_not_fused():
    flight = Flight(1)
    flight.vision_on[:] = False
    nan = float("nan")
    for estimator, x in ((mavlink.MAV_ESTIMATOR_TYPE_MOCAP, 0.0), (2, nan), (2, float("inf")), (2, 1e9)):
        m = mavlink.MAVLink_odometry_message(
            0, 1, 12, x, 0, 0, [1, 0, 0, 0], *[nan] * 6, [nan] * 21, [nan] * 21, 0, estimator, 0
        )
        flight.send(0, m, "vision")
    flight.run(0.1)
    assert not flight.pilots.est.aligned[0]


def test_origin_makes_global_and_home_position_valid(flight):
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    flight.received.forget(0)
    flight.run(2.1)
    found = {m.get_type(): m for m in flight.received[0]}
    assert abs(found["GLOBAL_POSITION_INT"].lat - 38.7e7) < 100
    assert abs(found["HOME_POSITION"].altitude - 100_050) < 200


def test_infinite_or_empty_setpoints_do_not_count_for_offboard(flight):
    assert flight.arm(0) == 0
    for mask, x in ((0b100111111000, float("inf")), (0b111111111111, 0.0)):
        flight.send(
            0,
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, x, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
            ),
        )
    assert flight.offboard(0) == 1


@pytest.fixture(scope="module")
def unpowered() -> Flight:
    return Flight(1)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(chunks=st.lists(st.binary(max_size=300), max_size=20))
def test_random_bytes_change_nothing(unpowered, chunks):
    for chunk in chunks:
        for link in ("router", "vision", "panic"):
            unpowered.pilots.receive(0, link, chunk)
    unpowered.run(0.02)
    assert not unpowered.armed(0)


def test_valid_frames_with_random_fields_do_not_arm():
    flight = ready()
    rng = np.random.default_rng(3)
    codec = mavlink.MAVLink(None, srcSystem=250, srcComponent=1)
    commands = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
    kinds = [c for k, c in mavlink.mavlink_map.items() if k not in commands]
    for n in range(4000):
        kind = kinds[rng.integers(len(kinds))]
        payload = rng.bytes(struct.calcsize(kind.unpacker.format))
        message = kind.__new__(kind)
        mavlink.MAVLink_message.__init__(message, kind.id, kind.msgname)
        flight.pilots.receive(
            0, ("router", "vision", "panic")[n % 3], message._pack(codec, kind.crc_extra, payload)
        )
        if n % 500 == 0:
            flight.run(0.02)
    assert not flight.armed(0)
    assert np.isfinite(flight.motors).all()
    assert np.all(flight.motors == 0.0)


def test_manual_control_is_reported_while_the_configured_source_is_received():
    def reported(f: Flight) -> bool:
        f.run(0.25)
        return bool(
            [m for m in f.received[0] if m.get_type() == "SYS_STATUS"][-1].onboard_control_sensors_present
            & radio
        )

    radio = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    flight = Flight(1, params={"COM_RC_LOSS_T": 1.0, "COM_RC_IN_MODE": 0})
    assert not reported(flight)
    for target, counts in ((2, False), (0, True)):
        flight.send(0, mavlink.MAVLink_rc_channels_override_message(target, 1, *(1500,) * 8))
        assert reported(flight) is counts
    flight.run(1.0)
    assert not reported(flight)
    for in_mode, target, counts in ((0, 1, False), (1, 2, False), (1, 1, True)):
        flight.run(0.8)
        flight.pilots.params.set(0, "COM_RC_IN_MODE", in_mode)
        flight.send(0, mavlink.MAVLink_manual_control_message(target, 0, 0, 500, 0, 0))
        assert reported(flight) is counts
    flight.pilots.params.set(0, "COM_RC_IN_MODE", 0)
    flight.pilots.sticks(0, True)
    assert reported(flight)
    flight.pilots.sticks(0, False)
    flight.run(1.0)
    assert not reported(flight)


def test_consumed_charge_is_reported(flight):
    drawn_a, sense = 30.0, flight.world.sense
    flight.world.sense = lambda: {**sense(), "battery_current_a": np.array([drawn_a])}
    flight.run(10.1)
    flight.world.sense = sense
    reported = [m.current_consumed for m in flight.received[0] if m.get_type() == "BATTERY_STATUS"][1:]
    assert len(reported) >= 4
    assert np.diff(reported) == pytest.approx(drawn_a * 1000 / 3600 * 2.0, abs=1.1), "mAh, sent every 2 s"


# -- found by fuzzing --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lat", "lon", "alt", "accepted"),
    [
        (90.0, 180.0, 0.0, True),
        (-90.0, -180.0, 0.0, True),
        (38.7, -9.1, 2147483.0, False),
        (38.7, -9.1, -12_001.0, False),
    ],
)
def test_origin_on_a_pole_is_accepted_and_one_in_space_refused(flight, lat, lon, alt, accepted):
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(lat * 1e7), int(lon * 1e7), int(alt * 1e3), 0)
    )
    flight.received.forget(0)
    flight.run(2.1)
    sent = [m for m in flight.received[0] if m.get_type() in ("GLOBAL_POSITION_INT", "HOME_POSITION")]
    assert bool(sent) == accepted
    for m in sent:
        places = (m.lat, m.lon) if m.get_type() == "GLOBAL_POSITION_INT" else (m.latitude, m.longitude)
        assert abs(places[0]) <= 90e7 and abs(places[1]) <= 180e7


def test_long_interval_is_clamped(flight):
    flight.send(0, mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 3e38, 0, 0, 0, 0, 0))
    flight.run(0.04)
    assert flight.command(0, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == 0
    sent = [m for m in flight.received[0] if m.get_type() == "MESSAGE_INTERVAL"]
    assert [m.interval_us for m in sent] == [2_147_000_000]


@pytest.mark.parametrize("frame", [1, 8])
def test_setpoint_with_an_absurd_value_is_refused(flight, frame):
    counts = flight.pilots.vehicles[0].counts
    before = counts["refused setpoint"]
    for k in range(9):
        values = [0.0] * 11
        values[k] = 3.4e38
        flight.send(0, mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, 0, *values))
    refused = 9 if frame == 1 else 6  # positions in body axes are ignored
    assert counts["refused setpoint"] - before == refused
