"""Messages and commands that ground stations and SDKs request from the built-in autopilot."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.actuator_tests import ActuatorTests
from arena.autopilot.autopilots import REPEATABLE_BOOT_UNIX_US
from arena.autopilot.mavlink import streams
from arena.autopilot.mavlink.param_protocol import HASH_NAME
from arena.wire import px4_messages
from arena.wire.mavlink_frame import SEEDS, pack_frame, parse_frames
from arena.wire.px4_messages import px4_crc32

NAN = float("nan")
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
LAT, LON, ALT = 38.7, -9.1, 100.0


@pytest.fixture(scope="module")
def shared() -> Flight:
    """A flight of one vehicle on the ground that may be armed and has an origin."""
    flight = Flight(1)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    place = (round(LAT * 1e7), round(LON * 1e7), round(ALT * 1e3))
    flight.send(0, mavlink.MAVLink_set_gps_global_origin_message(1, *place, 0))
    flight.run(0.1)
    return flight


@pytest.fixture
def flight(shared: Flight) -> Iterator[Flight]:
    shared.received.forget(0)
    yield shared
    shared.command(0, 400, 0, 21196)
    shared.command(0, 176, 1, 4, 3)
    shared.run(0.1)


def request(flight: Flight, msgid: int) -> tuple[int, list[bytes]]:
    """Request a message; return the MAV_RESULT and the payloads of the replies with this id."""
    raw: list[bytes] = []
    link = flight.pilots.interfaces[0].links["router"]
    take_datagram = link.take_datagram

    def keep() -> bytes:
        data = take_datagram()
        frames = parse_frames(data).frames
        raw.extend(data[f.payload : f.payload + f.size] for f in frames if f.msgid == msgid)
        return data

    link.take_datagram = keep  # type: ignore[method-assign]
    try:
        return flight.command(0, 512, msgid), raw
    finally:
        del link.take_datagram  # type: ignore[method-assign]


@pytest.mark.parametrize(
    "msgid",
    [
        mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION,
        mavlink.MAVLINK_MSG_ID_VIBRATION,
        px4_messages.PROTOCOL_VERSION,
        px4_messages.COMPONENT_METADATA,
        px4_messages.COMPONENT_INFORMATION,
        px4_messages.ESC_INFO,
        px4_messages.ESC_STATUS,
    ],
)
def test_requested_message_is_sent(flight, msgid):
    result, found = request(flight, msgid)
    assert result == ACCEPTED and found


@pytest.mark.parametrize(
    "msgid",
    [
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,  # no radio
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,  # disarmed
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        mavlink.MAVLINK_MSG_ID_WIND_COV,  # no estimate of the wind
    ],
)
def test_request_without_valid_content_is_denied(flight, msgid):
    assert request(flight, msgid) == (DENIED, [])


def test_system_time_counts_from_a_fixed_date_so_that_flights_are_repeatable(flight):
    flight.run(1.1)
    (m, *_) = [m for m in flight.received[0] if m.get_type() == "SYSTEM_TIME"]
    assert m.time_unix_usec // 1000 == REPEATABLE_BOOT_UNIX_US // 1000 + m.time_boot_ms


def test_satellite_fix_is_the_estimated_position(flight):
    flight.run(0.5)
    fix = [m for m in flight.received[0] if m.get_type() == "GPS_RAW_INT"][-1]
    place = [m for m in flight.received[0] if m.get_type() == "GLOBAL_POSITION_INT"][-1]
    assert fix.fix_type == mavlink.GPS_FIX_TYPE_3D_FIX and fix.satellites_visible == 255
    assert abs(fix.lat - place.lat) < 5 and abs(fix.lon - place.lon) < 5 and abs(fix.alt - place.alt) < 50
    assert abs(fix.alt / 1e3 - ALT) < 0.5


def test_radio_channels_are_sent_while_the_radio_is_on(flight):
    flight.pilots.sticks(0, True)
    flight.run(0.3)
    flight.pilots.sticks(0, False)
    found = [m for m in flight.received[0] if m.get_type() == "RC_CHANNELS"]
    assert len(found) >= 3
    assert (found[-1].chancount, found[-1].chan1_raw, found[-1].chan9_raw) == (8, 1500, 65535)


def test_hash_is_computed_from_names_and_values_as_clients_do(flight):
    flight.send(0, mavlink.MAVLink_param_request_list_message(1, 1))
    flight.run(1.0)
    values = {m.param_id: m for m in flight.received[0] if m.get_type() == "PARAM_VALUE"}
    crc = 0
    for name in sorted(values.keys() - {HASH_NAME}):
        crc = px4_crc32(name.encode() + struct.pack("<f", values[name].param_value), crc)
    assert struct.pack("<f", values[HASH_NAME].param_value) == struct.pack("<I", crc)


@pytest.mark.parametrize(("target", "replies"), [((1, 1), 1), ((1, 0), 1), ((2, 1), 0), ((1, 100), 0)])
def test_requested_event_is_reported_as_unavailable_to_its_client_only(flight, target, replies):
    payload = struct.pack("<2H2B", 30000, 30000, *target)
    interface = flight.pilots.interfaces[0]
    own = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    link = interface.links["router"]
    before = len(link.queue)
    interface.receive("router", pack_frame(412, payload, own, SEEDS[412]), flight.now)
    sent = b"".join(link.queue[before:])
    found = [f for f in parse_frames(sent).frames if f.msgid == px4_messages.RESPONSE_EVENT_ERROR]
    assert [(f.target_sys, f.target_comp) for f in found] == [(255, 190)] * replies


# -- commands ----------------------------------------------------------------------------------------------------------


def test_motor_turns_in_a_test_of_a_disarmed_vehicle_and_stops_by_itself(flight):
    assert flight.command(0, 310, 0.2, 0.5, 0, 0, 2) == ACCEPTED
    flight.run(0.1)
    assert flight.pilots.motors[0].tolist() == pytest.approx([0.0, 0.2, 0.0, 0.0])
    flight.run(0.6)
    assert not flight.pilots.motors.any()


def test_arming_ends_motor_tests_and_an_armed_vehicle_refuses_them(flight):
    assert flight.command(0, 310, 0.9, 3.0, 0, 0, 1) == ACCEPTED
    assert flight.command(0, 400, 1) == ACCEPTED
    assert flight.command(0, 310, 0.9, 3.0, 0, 0, 1) == DENIED
    flight.run(0.1)
    assert flight.pilots.motors.max() < 0.2  # the motors idle


@pytest.mark.parametrize(
    ("p", "result"),
    [
        ((0.1, 1, 0, 0, 0), UNSUPPORTED),
        ((0.1, 1, 0, 0, 20), UNSUPPORTED),
        ((0.1, 1, 0, 0, NAN), UNSUPPORTED),
        ((1.5, 1, 0, 0, 1), DENIED),
        ((0.1, NAN, 0, 0, 1), DENIED),
        ((0.1, 1, 0, 0, 9), ACCEPTED),  # no such motor
        ((0.1, 1, 0, 0, 33), ACCEPTED),  # a servo
    ],
)
def test_meaningless_motor_test_turns_nothing(p, result):
    tests = ActuatorTests()
    assert tests.request(p, 0.0, 4, armed=False) == result
    assert not tests


def test_motor_test_lasts_at_most_three_seconds_and_ends_on_request():
    tests, motors = ActuatorTests(), np.zeros(4)
    tests.request((0.5, 100.0, 0, 0, 1104), 10.0, 4, armed=False)
    tests.apply(motors, 12.9)
    assert motors.tolist() == [0, 0, 0, 0.5]
    tests.apply(motors, 13.0)
    assert not tests
    tests.request((0.5, 1.0, 0, 0, 1), 10.0, 4, armed=False)
    tests.request((NAN, 1.0, 0, 0, 1), 10.0, 4, armed=False)
    assert not tests


def test_calibration_is_refused_with_the_text_that_ground_stations_read(flight):
    flight.pilots.interfaces[0].links["router"].gcs_heartbeat_at = flight.now
    assert flight.command(0, 241) == ACCEPTED  # the end of a calibration
    assert flight.command(0, 241, 1) == DENIED
    flight.run(0.1)
    texts = [m.text for m in flight.received[0] if m.get_type() == "STATUSTEXT"]
    assert any(text.startswith("[cal] calibration failed: ") for text in texts)
    assert flight.command(0, 400, 1) == ACCEPTED
    assert flight.command(0, 241, 1) == REJECTED


def test_flight_information_has_the_time_of_arming(flight):
    flight.command(0, 400, 1)
    armed_at = flight.now
    flight.run(1.0)
    _, (payload,) = request(flight, mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION)
    arming_us, takeoff_us = struct.unpack_from("<QQ", payload.ljust(28, b"\0"))
    assert abs(arming_us * 1e-6 - armed_at) < 0.1 and takeoff_us == 0


@pytest.mark.parametrize(("index", "result"), [(0.0, DENIED), (-1.0, DENIED), (NAN, DENIED)])
def test_mission_item_cannot_be_selected_without_a_mission(flight, index, result):
    assert flight.command(0, 224, index) == result


def test_every_streamed_message_can_be_requested():
    for link, rates in streams.LINK_RATES.items():
        assert rates.keys() <= streams.SUPPORTED, link


def test_request_of_the_mode_orbit_enters_no_manual_mode(flight):
    assert flight.command(0, 176, 1, 3, 1) != ACCEPTED
    assert flight.mode(0) == "AUTO.LOITER"


@pytest.mark.parametrize(("target", "replies"), [((1, 1), 1), ((0, 0), 1), ((2, 1), 0), ((1, 100), 0)])
def test_files_are_read_by_requests_to_the_vehicle_or_to_all(flight, target, replies):
    reset = struct.pack("<HBBBBBBI", 5, 0, 2, 0, 0, 0, 0, 0).ljust(251, b"\0")
    flight.send(0, mavlink.MAVLink_file_transfer_protocol_message(0, *target, reset))
    flight.run(0.1)
    found = [m for m in flight.received[0] if m.get_type() == "FILE_TRANSFER_PROTOCOL"]
    assert len(found) == replies
