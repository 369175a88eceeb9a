"""The MAVLink face: acknowledgements, parameters, streams, and bytes that mean harm."""

from __future__ import annotations

import struct
from collections import Counter

import numpy as np
from flight import Flight
from hypothesis import given, settings
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
    flight = Flight(1)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    return flight


def test_streams_have_px4s_rates():
    flight = ready()
    flight.run(1.0)
    flight.heard[0].clear()
    flight.run(10.0)
    counted = Counter(m.get_type() for m in flight.heard[0])
    for name, hz in PX4_ONBOARD_HZ.items():
        assert abs(counted[name] / 10.0 - hz) <= max(0.1, 0.02 * hz), name


def test_message_intervals_can_be_set_asked_for_and_set_back():
    flight = ready()
    assert flight.command(0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 500_000) == 0
    flight.heard[0].clear()
    flight.run(4.0)
    assert 7 <= sum(m.get_type() == "ATTITUDE" for m in flight.heard[0]) <= 9
    assert flight.command(0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1) == 0
    flight.heard[0].clear()
    flight.run(1.0)
    assert not any(m.get_type() == "ATTITUDE" for m in flight.heard[0])
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == 0
    assert any(m.get_type() == "AUTOPILOT_VERSION" for m in flight.heard[0])


def test_parameters_are_listed_read_written_and_unknown_ones_met_with_silence():
    flight = ready()
    codec = flight.codec[0]
    flight.heard[0].clear()
    flight.send(0, codec.param_request_list_encode(1, 1))
    flight.run(1.0)
    values = [m for m in flight.heard[0] if m.get_type() == "PARAM_VALUE"]
    assert values[0].param_id == "_HASH_CHECK"
    assert len({m.param_id for m in values[1:]}) == values[0].param_count
    packed = struct.unpack("<f", struct.pack("<i", 5))[0]
    flight.send(0, codec.param_set_encode(1, 1, b"COM_OBL_RC_ACT", packed, mavlink.MAV_PARAM_TYPE_INT32))
    flight.send(0, codec.param_set_encode(1, 1, b"MPC_XY_P", 1.1, mavlink.MAV_PARAM_TYPE_REAL32))
    assert flight.pilots.params["COM_OBL_RC_ACT"][0] == 5
    assert abs(flight.pilots.params["MPC_XY_P"][0] - 1.1) < 1e-6
    flight.run(0.05)
    flight.heard[0].clear()
    flight.send(0, codec.param_request_read_encode(1, 1, b"NO_SUCH_NAME", -1))
    flight.run(0.1)
    assert not any(m.get_type() == "PARAM_VALUE" for m in flight.heard[0])


def test_a_parameter_out_of_range_or_not_finite_is_not_taken():
    flight = ready()
    before = float(flight.pilots.params["MPC_XY_P"][0])
    for value in (float("nan"), float("inf"), 1e9, -1.0):
        flight.send(
            0, flight.codec[0].param_set_encode(1, 1, b"MPC_XY_P", value, mavlink.MAV_PARAM_TYPE_REAL32)
        )
    assert flight.pilots.params["MPC_XY_P"][0] == before


def test_arming_is_refused_with_its_reason_without_vision():
    flight = Flight(1)
    flight.vision_on[:] = False
    flight.run(1.0)
    flight.send(0, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    assert flight.arm(0) == 1
    assert "external vision" in "".join(m.text for m in flight.heard[0] if m.get_type() == "STATUSTEXT")


def test_disarmed_every_mode_may_be_chosen_but_offboard_does_not_arm_without_a_stream_of_setpoints():
    flight = ready()
    assert flight.offboard(0) == 0
    assert flight.arm(0) == 1
    assert not flight.armed(0)


def test_an_armed_vehicle_is_refused_offboard_without_a_stream_of_setpoints():
    flight = ready()
    assert flight.arm(0) == 0
    assert flight.offboard(0) == 1
    assert flight.mode(0) == "AUTO.LOITER"


def test_a_command_to_everybody_moves_nobody():
    flight = ready()
    for system, component in ((0, 0), (0, 1)):
        flight.heard[0].clear()
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
        assert not any(m.get_type() in ("COMMAND_ACK", "PARAM_VALUE") for m in flight.heard[0])
    assert flight.pilots.params["MPC_XY_P"][0] != 1.1


def test_flight_termination_needs_a_one_and_an_armed_vehicle():
    flight = ready()
    assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == 2
    assert flight.arm(0) == 0
    for value in (0.0, float("nan"), -1.0):
        assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, value) == 2
        assert flight.mode(0) == "AUTO.LOITER"
    assert flight.command(0, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == 0
    assert flight.mode(0) == "TERMINATION"


def test_arming_by_force_skips_no_check():
    flight = ready()
    flight.offboard(0)
    assert flight.command(0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196) == 1
    assert not flight.armed(0)


def test_a_message_that_has_nothing_to_say_is_denied_and_modes_are_told():
    flight = ready()
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == 2
    assert flight.command(0, mavlink.MAV_CMD_GET_HOME_POSITION) == 2
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    flight.run(0.1)
    assert flight.command(0, mavlink.MAV_CMD_GET_HOME_POSITION) == 0
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, 435) == 0
    assert flight.command(0, mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == 2


def test_offboard_asked_for_right_after_the_first_setpoint_is_granted():
    flight = ready()
    flight.setpoint(0, [0, 0, -1.0])
    assert flight.offboard(0) == 0


def test_the_global_position_is_told_to_be_good_only_once_there_is_an_origin():
    flight = ready()

    def said() -> bool:
        flight.heard[0].clear()
        flight.run(0.5)
        status = next(m for m in flight.heard[0] if m.get_type() == "SYS_STATUS")
        bit = mavlink.MAV_SYS_STATUS_SENSOR_GPS
        return bool(status.onboard_control_sensors_present & status.onboard_control_sensors_health & bit)

    assert not said()
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    assert said()


def test_messages_for_others_are_not_obeyed():
    flight = ready()
    flight.send(0, mavlink.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.send(0, mavlink.MAVLink_command_long_message(1, 51, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.run(0.1)
    assert not flight.armed(0)


def test_motion_capture_estimator_type_and_nan_poses_are_not_fused():
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


def test_a_global_origin_makes_global_and_home_position_valid_on_vision_alone():
    flight = ready()
    flight.send(
        0, mavlink.MAVLink_set_gps_global_origin_message(1, int(38.7e7), int(-9.1e7), 100_000, 0), "vision"
    )
    flight.heard[0].clear()
    flight.run(3.0)
    found = {m.get_type(): m for m in flight.heard[0]}
    assert abs(found["GLOBAL_POSITION_INT"].lat - 38.7e7) < 100
    assert abs(found["HOME_POSITION"].altitude - 100_050) < 200


def test_offboard_setpoints_that_are_infinite_or_empty_do_not_count_as_a_stream():
    flight = ready()
    assert flight.arm(0) == 0
    for mask, x in ((0b100111111000, float("inf")), (0b111111111111, 0.0)):
        flight.send(
            0,
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, x, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
            ),
        )
    assert flight.offboard(0) == 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=20))
def test_random_bytes_change_nothing(chunks):
    flight = _SHARED
    for chunk in chunks:
        for link in ("router", "vision", "panic"):
            flight.pilots.receive(0, link, chunk)
    flight.run(0.02)
    assert not flight.armed(0)


def test_valid_frames_with_random_fields_never_break_or_arm_it():
    flight = ready()
    rng = np.random.default_rng(3)
    codec = mavlink.MAVLink(None, srcSystem=250, srcComponent=1)
    commands = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
    kinds = [c for k, c in mavlink.mavlink_map.items() if k not in commands]
    for n in range(6000):
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


_SHARED = Flight(1)


def test_a_radio_is_told_while_it_is_heard_and_a_joystick_only_where_it_counts():
    def told(f: Flight) -> bool:
        f.run(0.5)
        return bool(
            [m for m in f.heard[0] if m.get_type() == "SYS_STATUS"][-1].onboard_control_sensors_present
            & radio
        )

    radio = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    flight = Flight(1, params={"COM_RC_LOSS_T": 1.0, "COM_RC_IN_MODE": 0})
    assert not told(flight)
    for target, heard in ((2, False), (0, True)):
        flight.send(0, mavlink.MAVLink_rc_channels_override_message(target, 1, *(1500,) * 8))
        assert told(flight) is heard
    flight.run(1.0)
    assert not told(flight)
    for in_mode, target, heard in ((0, 1, False), (1, 2, False), (1, 1, True)):
        flight.run(1.0)
        flight.pilots.params.set(0, "COM_RC_IN_MODE", in_mode)
        flight.send(0, mavlink.MAVLink_manual_control_message(target, 0, 0, 500, 0, 0))
        assert told(flight) is heard
    flight.pilots.params.set(0, "COM_RC_IN_MODE", 0)
    flight.pilots.sticks(0, True)
    assert told(flight)
    flight.pilots.sticks(0, False)
    flight.run(1.0)
    assert not told(flight)
