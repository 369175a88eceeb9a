"""Routing and priorities of the link, its requests, and its reports about a silent or noisy connection."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.send_queue import MAX_BYTES
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Stream, parse_frames

from .link_rig import ENDS, ID, Rig, arm, attitude, heartbeat, local, odometry, sys_status


def sensor(us: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_hil_sensor_message(us, *[0.1] * 13, 0x1FFF, 0)


def setpoint(i: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        i, ID, 1, 1, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0
    )


# -- routing ---------------------------------------------------------------------------------------------------------------


def test_the_router_gets_all_messages_and_the_forwarder_some():
    rig = Rig()
    rig.receive(
        heartbeat(),
        sys_status(),
        mavlink.MAVLink_system_time_message(0, 5),
        attitude(),
        local(),
        mavlink.MAVLink_gps_global_origin_message(1, 2, 3, 4),
    )
    assert len(rig.got["router"]) == 6
    assert [m.get_type() for m in rig.got["vision"]] == [
        "HEARTBEAT",
        "SYS_STATUS",
        "SYSTEM_TIME",
        "GPS_GLOBAL_ORIGIN",
    ]
    assert rig.got["panic"] == rig.got["simulator"] == []


def test_land_all_gets_all_messages_while_it_sends():
    rig = Rig()
    rig.send("panic", mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    rig.now += 4.9
    rig.receive(heartbeat(), attitude())
    assert len(rig.got["panic"]) == 2
    rig.now += 0.2
    rig.receive(heartbeat())
    assert len(rig.got["panic"]) == 2


def test_timesync_replies_do_not_reach_the_vehicle():
    rig = Rig()
    for link in ENDS:
        rig.send(link, mavlink.MAVLink_timesync_message(123, 456), mavlink.MAVLink_timesync_message(0, 456))
    assert [m.tc1 for m in rig.sent("TIMESYNC")] == [0, 0, 0]
    assert rig.core.counts["to the vehicle: TIMESYNC reply"] == 3


def test_frames_of_a_foreign_system_are_counted_and_dropped():
    rig = Rig()
    rig.receive(heartbeat(armed=True), local(), codec=Codec(ID + 1, 1))
    assert rig.got["router"] == []
    assert not rig.core.ever_connected
    assert not rig.core.checks.armed
    assert rig.core.counts["from the vehicle: foreign system"] == 2


def test_a_companion_computer_is_not_the_autopilot():
    rig = Rig()
    rig.receive(heartbeat(armed=True), codec=Codec(ID, 191))
    assert len(rig.got["router"]) == 1
    assert rig.got["vision"] == []
    assert not rig.core.ever_connected


def test_motor_commands_in_the_loop_go_only_to_the_world():
    rig = Rig(simulator=["127.71.0.1", 24079], simulated=True)
    rig.receive(mavlink.MAVLink_hil_actuator_controls_message(1, [0.5] * 16, 128, 0), heartbeat())
    assert [m.get_type() for m in rig.got["simulator"]] == ["HIL_ACTUATOR_CONTROLS"]
    assert [m.get_type() for m in rig.got["router"]] == ["HEARTBEAT"]


def test_the_controller_gets_sensors_and_no_truth():
    rig = Rig(simulator=["127.71.0.1", 24079], simulated=True)
    world = Codec(1, 200)
    truth = mavlink.MAVLink_hil_state_quaternion_message(1, [1, 0, 0, 0], *[0] * 14)
    data = world.pack(sensor(1)) + world.pack(truth)
    rig.core.from_simulator(data, parse_frames(data), rig.now)
    assert [m.get_type() for m in rig.flush()] == ["HIL_SENSOR"]


@pytest.mark.parametrize("link", ["router", "panic"])
def test_poses_of_other_senders_than_the_forwarder_are_dropped(link):
    """PX4 fuses the poses of all senders: those of a MAVROS relay, for example, pass no check of the forwarder."""
    rig = Rig()
    other = mavlink.MAVLink_vision_position_estimate_message(0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    fill(rig, (link, odometry()), (link, other), (link, other), ("vision", odometry()))
    assert [m.get_type() for m in rig.flush()] == ["ODOMETRY"]
    assert rig.core.counts["to the vehicle: pose of another sender"] == 3
    found = [event for event in rig.core.events() if "is not sent to the vehicle" in event]
    assert [event.split()[1] for event in found] == ["ODOMETRY", "VISION_POSITION_ESTIMATE"]


def test_poses_of_programs_pass_without_a_forwarder():
    rig = Rig(preflight={"poses": False})
    fill(rig, ("router", odometry()))
    assert [m.get_type() for m in rig.flush()] == ["ODOMETRY"]


# -- priorities ------------------------------------------------------------------------------------------------------------


POSITION_RESETS = {
    "origin": mavlink.MAVLink_set_gps_global_origin_message(ID, 387000000, -91000000, 0),
    "position": mavlink.MAVLink_command_int_message(
        ID, 1, 0, 43003, 0, 0, 0, 0, 1, 0, 387000000, -91000000, 0
    ),
    "position by long": mavlink.MAVLink_command_long_message(ID, 1, 43003, 0, 0, 0, 1, 0, 38.7, -9.1, 0),
    "position of all": mavlink.MAVLink_command_long_message(0, 0, 43003, 0, 0, 0, 1, 0, 38.7, -9.1, 0),
}


@pytest.mark.parametrize("forwarded", [True, False])
@pytest.mark.parametrize("link", ["router", "panic"])
@pytest.mark.parametrize("message", POSITION_RESETS.values(), ids=POSITION_RESETS.keys())
def test_position_resets_of_an_armed_vehicle_are_dropped(message, link, forwarded):
    """PX4 moves its local position, and the vehicle flies after it."""
    rig = Rig(preflight={"poses": forwarded})
    rig.receive(heartbeat(armed=True))
    fill(rig, (link, message), (link, message))
    assert rig.flush() == []
    assert rig.core.counts["to the vehicle: position reset of an armed vehicle"] == 2
    assert len([e for e in rig.core.events() if "its position would jump" in e]) == 1


def test_sender_of_a_position_reset_gets_a_refusal():
    rig = Rig()
    rig.receive(heartbeat(armed=True))
    rig.send("router", *POSITION_RESETS.values())
    acks = [(a.command, a.result) for a in rig.received("router", "COMMAND_ACK")]
    assert acks == [(43003, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)] * 3
    (text,) = rig.received("router", "STATUSTEXT")
    assert text.text == "refused: position reset of an armed vehicle"


@pytest.mark.parametrize(("link", "armed"), [("vision", True), ("vision", False), ("router", False)])
@pytest.mark.parametrize("message", POSITION_RESETS.values(), ids=POSITION_RESETS.keys())
def test_position_resets_of_the_forwarder_or_on_the_ground_pass(message, link, armed):
    rig = Rig()
    rig.receive(heartbeat(armed=armed))
    fill(rig, (link, message))
    assert [m.get_msgId() for m in rig.flush()] == [message.get_msgId()]


def test_position_reset_of_another_vehicle_passes():
    rig = Rig()
    rig.receive(heartbeat(armed=True))
    fill(rig, ("router", mavlink.MAVLink_set_gps_global_origin_message(ID + 1, 387000000, -91000000, 0)))
    assert len(rig.flush()) == 1


def fill(rig: Rig, *what: tuple[str, mavlink.MAVLink_message]) -> None:
    """Queue messages; nothing is sent meanwhile."""
    for link, message in what:
        if link == "simulator":
            data = rig.program.pack(message)
            rig.core.from_simulator(data, parse_frames(data), rig.now)
        else:
            rig.core.from_link(link, rig.program.pack(message), rig.now)


def test_frames_are_sent_by_priority():
    rig = Rig(simulator=["127.71.0.1", 24079])
    fill(
        rig,
        ("vision", odometry()),
        ("simulator", sensor(1)),
        ("router", setpoint(1)),
        ("panic", arm(param1=0.0)),
    )
    kinds = [m.get_type() for m in rig.flush()]
    assert kinds == ["COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED", "HIL_SENSOR", "ODOMETRY"]


def test_a_newer_pose_or_sensor_sample_replaces_the_waiting_one():
    rig = Rig(simulator=["127.71.0.1", 24079])
    for i in range(20):
        fill(rig, ("vision", odometry((i * 0.1, 0, -0.1))), ("simulator", sensor(i)))
    out = rig.flush()
    assert [m.x for m in out if m.get_type() == "ODOMETRY"] == [pytest.approx(1.9)]
    assert [m.time_usec for m in out if m.get_type() == "HIL_SENSOR"] == [19]


def test_a_full_queue_drops_the_largest_part_never_landings():
    rig = Rig()
    fill(rig, ("panic", arm(param1=0.0)), ("vision", odometry()))
    for _ in range(400):
        fill(rig, ("router", mavlink.MAVLink_param_request_read_message(ID, 1, b"EKF2_EV_CTRL", -1)))
    out = rig.flush()
    kinds = [m.get_type() for m in out]
    assert kinds[0] == "COMMAND_LONG"
    assert "ODOMETRY" in kinds
    assert sum(len(m.get_msgbuf()) for m in out) <= MAX_BYTES
    assert rig.core.counts["to the vehicle: queue full (vision)"] == 0
    assert rig.core.counts["to the vehicle: queue full (router)"] == 400 - kinds.count("PARAM_REQUEST_READ")


def test_a_frame_older_than_a_second_is_not_sent():
    rig = Rig()
    fill(rig, ("router", setpoint(1)))
    rig.now += 1.1
    fill(rig, ("router", setpoint(2)))
    assert [m.time_boot_ms for m in rig.flush()] == [2]


def test_frames_are_dropped_while_the_connection_is_away():
    rig = Rig()
    fill(rig, ("router", setpoint(1)), ("panic", arm(param1=0.0)))
    rig.core.queue.clear()
    assert rig.flush() == []
    assert rig.core.counts["to the vehicle: not connected (panic)"] == 1


# -- reports --------------------------------------------------------------------------------------------------------------


def events_after(rig: Rig, seconds: float, *data: bytes) -> list[str]:
    for _ in range(round(seconds * 20)):
        rig.now += 0.05
        for piece in data:
            rig.core.from_vehicle(piece, parse_frames(piece), rig.now)
        rig.core.tick(rig.now)
        rig.flush()
    return rig.core.events()


def test_silence_noise_and_a_wrong_id_are_reported_differently():
    assert (
        events_after(Rig(), 21.0)
        == [
            "uav7: udpin 127.71.0.1:14540: no data for 10 s: is the vehicle switched on, and does it send to this address?"
        ]
        * 2
    )
    serial = {"kind": "serial", "device": "/dev/ttyACM0", "baud": 57600}
    assert events_after(Rig(wire=serial), 11.0, b"\x00\xff\x80noise") == [
        "uav7: /dev/ttyACM0 at 57600 baud: received data, but no MAVLink: is the baud rate right?"
    ]
    (text,) = events_after(Rig(), 11.0, Codec(1, 1).pack(heartbeat()))
    assert "received system 1 component 1" in text
    assert "set the vehicle's MAV_SYS_ID to 7" in text


def test_connecting_and_reconnecting_are_reported():
    rig = Rig()
    rig.receive(heartbeat())
    rig.fly(5.0, telemetry=False)
    rig.receive(heartbeat())
    assert rig.core.events() == ["uav7: connected", "uav7: connected again after 5 s"]


def test_the_heartbeat_is_of_an_onboard_computer():
    rig = Rig()
    rig.fly(5.0, telemetry=False)
    beats = [m for m in rig.sent("HEARTBEAT") if m.get_srcComponent() == 192]
    assert len(beats) in (5, 6)
    assert {(m.get_srcSystem(), m.type) for m in beats} == {(ID, 18)}


# -- streams ---------------------------------------------------------------------------------------------------------------


def answers(rig: Rig, asked: list[int], result: int) -> None:
    """Acknowledge each request for a stream."""
    for m in rig.flush():
        if m.get_type() == "COMMAND_LONG" and m.command == 511:
            asked.append(int(m.param1))
            rig.receive(mavlink.MAVLink_command_ack_message(511, result, 0, 0, ID, 192))


def run_thin(rig: Rig, seconds: float, result: int | None = 0) -> list[int]:
    """Simulate a vehicle that sends only heartbeats and 30 Hz of position. Return the requested message ids."""
    asked: list[int] = []
    for i in range(round(seconds * 30)):
        rig.now += 1 / 30
        rig.receive(local(), *([heartbeat()] if i % 30 == 0 else []))
        rig.core.tick(rig.now)
        if result is None:
            asked += [
                int(m.param1) for m in rig.flush() if m.get_type() == "COMMAND_LONG" and m.command == 511
            ]
        else:
            answers(rig, asked, result)
    return asked


def test_only_missing_streams_are_requested_once():
    asked = run_thin(Rig(), 8.0)
    assert mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED not in asked
    for needed in (
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "EXTENDED_SYS_STATE",
        "SYS_STATUS",
        "BATTERY_STATUS",
        "SYSTEM_TIME",
    ):
        assert asked.count(getattr(mavlink, f"MAVLINK_MSG_ID_{needed}")) == 1, needed


def test_streams_for_logs_are_not_requested_on_a_slow_serial_line():
    wire = {"kind": "serial", "device": "/dev/ttyUSB0", "baud": 57600}
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET in run_thin(Rig(), 6.0)
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET not in run_thin(Rig(wire=wire), 6.0)


def test_unanswered_stream_requests_are_repeated_and_reported():
    rig = Rig()
    asked = run_thin(rig, 12.0, result=None)
    assert asked.count(mavlink.MAVLINK_MSG_ID_ATTITUDE) == 5
    assert any("no answer to 5 requests for ATTITUDE at 50 Hz" in e for e in rig.core.events())


def test_streams_are_requested_again_after_a_reboot():
    rig = Rig()
    rig.receive(mavlink.MAVLink_system_time_message(0, 60_000))
    assert run_thin(rig, 6.0).count(mavlink.MAVLINK_MSG_ID_ATTITUDE) == 1
    rig.receive(mavlink.MAVLink_system_time_message(0, 59_900))  # out of order
    assert run_thin(rig, 3.0).count(mavlink.MAVLINK_MSG_ID_ATTITUDE) == 0
    rig.receive(mavlink.MAVLink_system_time_message(0, 900))
    assert run_thin(rig, 6.0).count(mavlink.MAVLINK_MSG_ID_ATTITUDE) == 1
    assert any("has rebooted" in e for e in rig.core.events())


# -- hostile bytes ---------------------------------------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(st.sampled_from(["wire", "stream", "simulator", *ENDS]), st.binary(max_size=120)),
        max_size=30,
    )
)
@settings(max_examples=150)
def test_random_bytes_from_any_side_never_raise(pieces):
    rig, stream = Rig(simulator=["127.71.0.1", 24079], params={"SYS_HITL": 1}), Stream()
    feed(rig, stream, pieces)


def feed(rig: Rig, stream: Stream, pieces: list[tuple[str, bytes]]) -> None:
    for end, data in pieces:
        rig.now += 0.05
        rig.identify()
        if end == "wire":
            rig.core.from_vehicle(data, parse_frames(data), rig.now)
        elif end == "stream":
            rig.core.from_vehicle(*stream.feed(data), rig.now)
        elif end == "simulator":
            rig.core.from_simulator(*stream.feed(data), rig.now)
        else:
            rig.core.from_link(end, data, rig.now)
        rig.core.tick(rig.now)
        rig.flush()


def test_whole_frames_with_any_payload_never_raise():
    """Every message that is read, with random contents and a correct checksum."""
    rng, sender = random.Random(3), mavlink.MAVLink(None, srcSystem=ID, srcComponent=1)
    rig, stream = Rig(simulator=["127.71.0.1", 24079], params={"SYS_HITL": 1, "MPC_XY_P": 0.95}), Stream()
    kinds = (0, 1, 2, 22, 30, 31, 32, 69, 70, 75, 76, 77, 93, 107, 111, 147, 148, 253, 331, 345)
    pieces = []
    for _ in range(1500):
        kind = rng.choice(kinds)
        whole = struct.calcsize(mavlink.mavlink_map[kind].unpacker.format)
        payload = rng.choice([rng.randbytes(whole), b"\xff" * whole, b"", rng.randbytes(whole + 3)])
        message = mavlink.MAVLink_message(kind, "x")
        message._crc_extra = mavlink.mavlink_map[kind].crc_extra
        frame = message._pack(sender, mavlink.mavlink_map[kind].crc_extra, payload)
        pieces.append((rng.choice(["wire", "stream", "simulator", *ENDS]), frame[: rng.choice([None, -3])]))
    feed(rig, stream, pieces)
    assert rig.core.flow["from_vehicle"] > 200
