"""Requests to arm and to spin a motor are refused while a check fails; disarming and landing always pass."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.authority import parse_request
from arena.clock import WallClock
from arena.fcu_link import harmless_commands
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_ids import PROGRAM_COMPONENT as PROGRAM
from arena.wire.telemetry import Telemetry

from .link_rig import ENDS, ID, POSE, Rig, arm

NAN = float("nan")
LAND = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4, 6)


def command_int(number: int, param1: float, param2: float = 0.0, target: int = ID) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_int_message(target, 1, 0, number, 0, 0, param1, param2, 0, 0, 0, 0, 0)


def command(number: int, *params: float, target: int = ID) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_long_message(target, 1, number, 0, *params, *[0.0] * (7 - len(params)))


def rig_with_reasons() -> Rig:
    rig = Rig()
    rig.fly(1.5, p_n=(POSE[0] + 1.0, POSE[1], POSE[2]), battery=5)
    rig.out.clear()
    return rig


ARMING = {
    "COMMAND_LONG": arm(),
    "with the force magic": arm(magic=21196.0),
    "to every system": arm(target=0),
    "to every component": arm(component=0),
    "COMMAND_INT": command_int(400, 1.0),
    "COMMAND_INT by force": command_int(400, 1.0, 21196.0),
    "COMMAND_INT to every system": command_int(400, 1.0, target=0),
    "what PX4 rounds to 1": arm(param1=0.6),
    "what PX4 takes for 1 when it cuts it to a byte": arm(param1=257.0),
    "MISSION_START": command(300),
    "COMMAND_INT MISSION_START": command_int(300, 0.0),
    "DO_LAND_START": command(189),
    "COMMAND_INT DO_LAND_START": command_int(189, 0.0),
}


@pytest.mark.parametrize("link", ENDS)
@pytest.mark.parametrize("message", ARMING.values(), ids=ARMING.keys())
def test_arming_is_refused_on_every_link_while_a_check_fails(link, message):
    rig = rig_with_reasons()
    rig.send(link, message)
    assert not rig.sent("COMMAND_LONG")
    assert not rig.sent("COMMAND_INT")


@pytest.mark.parametrize("link", ENDS)
@pytest.mark.parametrize("message", ARMING.values(), ids=ARMING.keys())
def test_arming_passes_when_all_checks_pass(link, message):
    rig = Rig()
    rig.fly(2.0)
    rig.send(link, message)
    assert rig.arming_passed(message.command)
    assert not rig.received("router", "STATUSTEXT")


@pytest.mark.parametrize("link", ENDS)
def test_a_refusal_has_the_reasons_in_the_autopilots_name(link):
    rig = rig_with_reasons()
    rig.send(link, arm())
    for end in {link, "router"}:
        (ack,) = rig.received(end, "COMMAND_ACK")
        assert (ack.command, ack.result) == (400, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        assert (ack.target_system, ack.target_component) == (ID, 191)
        assert (ack.get_srcSystem(), ack.get_srcComponent()) == (ID, 1)
        texts = rig.received(end, "STATUSTEXT")
        assert {t.text for t in texts} == set(rig.reasons())
        assert {t.severity for t in texts} == {mavlink.MAV_SEVERITY_ERROR}
    assert not [end for end in ENDS if end not in (link, "router") and rig.received(end, "COMMAND_ACK")]


def test_repeated_requests_get_the_reasons_only_now_and_then():
    rig = rig_with_reasons()
    for _ in range(10):
        rig.now += 0.01
        rig.send("router", arm())
    assert len(rig.received("router", "COMMAND_ACK")) == 10
    assert len(rig.received("router", "STATUSTEXT")) == len(rig.reasons())


def test_a_program_reads_the_reasons_with_its_own_codec():
    """Acknowledgement and texts, decoded as `arena.uav` does."""
    rig = rig_with_reasons()
    telemetry, now = Telemetry(ID), WallClock().now()
    data = b"".join(
        d
        for end, d in rig.core.from_link("router", Codec(ID, PROGRAM).pack(arm()), rig.now)
        if end == "router"
    )
    telemetry.on_datagram(data, now)
    assert [(a.command, a.result, a.target) for a in telemetry.acks] == [(400, 1, (ID, PROGRAM))]
    said = telemetry.recent_texts(now - 1.0, mavlink.MAV_SEVERITY_WARNING)
    assert said == list(reversed(rig.reasons()))


@pytest.mark.parametrize("link", ENDS)
@pytest.mark.parametrize(
    "message",
    [
        arm(param1=0.0),
        arm(param1=0.0, magic=21196.0),
        arm(param1=0.4),
        command_int(400, 0.0),
        command(176, *LAND),
        command(21),
        command(185, 1.0),
        command(20),
        command(22),
        mavlink.MAVLink_set_mode_message(ID, 1, 4 << 16 | 6 << 24),
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, ID, 1, 1, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0
        ),
        mavlink.MAVLink_param_request_read_message(ID, 1, b"SYS_AUTOSTART", -1),
    ],
    ids=[
        "disarm",
        "kill",
        "nearly 0",
        "disarm by int",
        "land mode",
        "land",
        "terminate",
        "return",
        "takeoff",
        "set mode",
        "setpoint",
        "param",
    ],
)
def test_disarming_landing_modes_and_setpoints_always_pass(link, message):
    rig = Rig()  # no telemetry, no pose: every check fails
    assert rig.reasons()
    rig.send(link, message)
    assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


def shell(text: bytes) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_serial_control_message(10, 6, 0, 0, len(text), list(text.ljust(70, b"\0")))


def tunnel(kind: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_tunnel_message(ID, 1, kind, 1, [0] * 128)


SPINNING = {  # review fault 16
    "ACTUATOR_TEST": command(310, 1.0, 1.0, 0, 0, 1.0),
    "ACTUATOR_TEST by int": command_int(310, 1.0),
    "DO_MOTOR_TEST": command(209, 1.0, 1.0, 1.0),
    "DO_MOTOR_TEST to every system": command(209, 1.0, 1.0, 1.0, target=0),
    "DO_SET_SERVO": command(183, 1.0, 2000.0),
    "DO_SET_ACTUATOR": command(187, 1.0),
    "CONFIGURE_ACTUATOR": command(311, 1.0),
    "PREFLIGHT_CALIBRATION of ESCs": command(241, 0, 0, 0, 0, 0, 0, 1.0),
    "PREFLIGHT_CALIBRATION that PX4 cuts to 1": command(241, 0, 0, 0, 0, 0, 0, 1.9),
    "PREFLIGHT_UAVCAN": command(243, 1.0),
    "an unknown command": command(31010, 1.0),
    "a command of PX4 itself": command(100),
    "INJECT_FAILURE": command(420, 101.0, 1.0),
    "end of INJECT_FAILURE": command(420, 101.0, 0.0),
    "SERIAL_CONTROL": shell(b"commander arm\n"),
    "TUNNEL to the ESCs": tunnel(211),
}


@pytest.mark.parametrize("link", ENDS)
@pytest.mark.parametrize("message", SPINNING.values(), ids=SPINNING.keys())
def test_fault_16_requests_that_can_spin_a_motor_are_refused(link, message):
    rig = rig_with_reasons()
    rig.send(link, message)
    assert [m for m in rig.out if m.get_msgId() == message.get_msgId()] == []
    for end in {link, "router"}:
        assert {t.text for t in rig.received(end, "STATUSTEXT")} == set(rig.reasons())
        acks = [(a.command, a.result) for a in rig.received(end, "COMMAND_ACK")]
        number = getattr(message, "command", None)
        assert acks == ([(number, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)] if number else [])


@pytest.mark.parametrize("message", SPINNING.values(), ids=SPINNING.keys())
def test_requests_that_can_spin_a_motor_pass_when_all_checks_pass(message):
    rig = Rig()
    rig.fly(2.0)
    rig.out.clear()
    rig.send("router", message)
    assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


@pytest.mark.parametrize("message", SPINNING.values(), ids=SPINNING.keys())
def test_commands_of_a_flight_pass_in_flight_while_a_check_fails(message):
    rig = Rig()
    rig.fly(1.0, armed=True, poses=False)
    assert rig.reasons()
    rig.out.clear()
    rig.send("router", message)
    assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


def test_a_refused_motor_test_is_reported_with_its_name():
    rig = rig_with_reasons()
    rig.core.events()
    rig.send("router", SPINNING["DO_MOTOR_TEST"])
    (line,) = [e for e in rig.core.events() if "refused" in e]
    assert line.startswith("uav7: DO_MOTOR_TEST (command 209) refused (requested by 7/191): Preflight: ")


def test_the_same_refusal_is_shown_every_ten_seconds_and_another_one_at_once():
    rig = rig_with_reasons()
    rig.core.events()
    shown = []
    for k in range(25):
        rig.fly(1.0, p_n=(POSE[0] + 1.0, POSE[1], POSE[2] + 0.01 * k), battery=5)
        rig.core.from_link("router", Codec(ID, PROGRAM).pack(arm()), rig.now)
        shown += [e for e in rig.core.events() if "refused" in e]
    assert len(shown) == 3, shown
    rig.fly(1.0, p_n=(POSE[0] + 1.0, POSE[1], POSE[2]), battery=5)
    rig.send("router", SPINNING["DO_MOTOR_TEST"])
    assert any("DO_MOTOR_TEST" in e for e in rig.core.events())


HARMLESS = {
    "REQUEST_MESSAGE": command(512, 148.0),
    "SET_MESSAGE_INTERVAL": command(511, 30.0, 20000.0),
    "calibration of the gyroscope": command(241, 1.0, 0, 0, 0, 0, 0, 0),
    "calibration with an unused param7": command(241, 1.0, 0, 0, 0, 0, 0, NAN),
    "end of a UAVCAN configuration": command(243, 0.0),
    "reboot": command(246, 1.0),
    "parachute": command(208, 2.0),
    "FTP": mavlink.MAVLink_file_transfer_protocol_message(0, ID, 1, [0] * 251),
    "PARAM_SET": mavlink.MAVLink_param_set_message(ID, 1, b"MPC_XY_P", 0.9, 9),
    "mission upload": mavlink.MAVLink_mission_count_message(ID, 1, 3),
    "mission item": mavlink.MAVLink_mission_item_int_message(ID, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 0, 0, 1.0),
    "tunnel to a gimbal": tunnel(200),
}


@pytest.mark.parametrize("message", HARMLESS.values(), ids=HARMLESS.keys())
def test_harmless_messages_always_pass(message):
    rig = Rig()
    assert rig.reasons()
    rig.send("router", message)
    assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


def test_harmless_commands_exclude_all_that_move_the_vehicle():
    for number in harmless_commands.HARMLESS:
        data = Codec(ID, PROGRAM).pack(command(number, target=ID))
        (frame,) = parse_frames(data).frames
        assert parse_request(data, frame) is None, number


def test_in_flight_without_poses_commands_pass():
    rig = Rig()
    rig.fly(1.0, armed=True)
    rig.fly(1.0, armed=True, poses=False)
    assert rig.reasons()
    rig.out.clear()
    stick = mavlink.MAVLink_manual_control_message(ID, 0, 0, 500, 0, 0)
    rig.send("router", command(176, *LAND), stick, command(300), command(189))
    assert [m.get_type() for m in rig.out] == ["COMMAND_LONG", "MANUAL_CONTROL", *["COMMAND_LONG"] * 2]


@pytest.mark.parametrize(
    "sticks",
    [
        mavlink.MAVLink_manual_control_message(ID, 0, 0, 0, 1000, 0),
        mavlink.MAVLink_rc_channels_override_message(ID, 1, *[1500] * 8),
    ],
)
def test_sticks_are_refused_while_a_check_fails(sticks):
    rig = rig_with_reasons()
    rig.send("router", sticks)
    assert rig.out == []
    assert rig.core.counts["to the vehicle: sticks refused"] == 1
    rig.fly(1.5)
    rig.out.clear()
    rig.send("router", sticks)
    assert len(rig.out) == 1


def test_arming_of_another_system_is_not_answered():
    rig = rig_with_reasons()
    rig.send("router", arm(target=ID + 1))
    assert rig.received("router", "COMMAND_ACK") == []


def test_a_refused_command_does_not_stop_others_of_its_datagram():
    rig = rig_with_reasons()
    rig.send("router", command(176, *LAND), arm(), arm(param1=0.0))
    assert [(m.command, m.param1) for m in rig.out] == [(176, 1.0), (400, 0.0)]


def test_arming_by_radio_despite_a_failed_check_is_reported_once():
    rig = rig_with_reasons()
    rig.core.events()
    rig.fly(3.0, armed=True, battery=5)
    told = [e for e in rig.core.events() if "is armed although" in e]
    assert len(told) == 1
    assert "battery at 5 %" in told[0]
    assert told[0].startswith("uav7: ")


def test_a_silent_armed_vehicle_stays_armed_only_when_real():
    real, simulated = Rig(), Rig(simulated=True)
    for rig in (real, simulated):
        rig.fly(1.0, armed=True)
        rig.fly(6.0, telemetry=False, poses=False)
    assert real.core.armed(real.now)
    assert not simulated.core.armed(simulated.now)


def landed(state: int = mavlink.MAV_LANDED_STATE_ON_GROUND) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def armed_rig(*reports: mavlink.MAVLink_message) -> Rig:
    """Return a link whose vehicle was armed in its last heartbeat, has sent `reports`, and fails a check."""
    rig = Rig()
    rig.fly(1.0, armed=True, poses=False)
    rig.receive(*reports)
    assert rig.reasons() and rig.core.armed(rig.now)
    rig.out.clear()
    return rig


STARTS = {"MISSION_START": command(300), "DO_LAND_START": command(189), **SPINNING}
GESTURE = mavlink.MAVLink_manual_control_message(ID, 0, 0, 50, 950, 0)


@pytest.mark.parametrize("message", [*STARTS.values(), GESTURE], ids=[*STARTS.keys(), "stick gesture"])
def test_starts_are_refused_on_the_ground_after_an_armed_heartbeat(message):
    """PX4 sends its HEARTBEAT once a second, so a vehicle can be disarmed although it was armed in the last one."""
    rig = armed_rig(landed())
    rig.send("router", message)
    assert [m for m in rig.out if m.get_msgId() == message.get_msgId()] == []


@pytest.mark.parametrize("message", [*STARTS.values(), GESTURE], ids=[*STARTS.keys(), "stick gesture"])
def test_armed_vehicle_with_unknown_landed_state_is_treated_as_flying(message):
    silent = armed_rig(landed())
    silent.fly(1.6, armed=True, poses=False)  # no more EXTENDED_SYS_STATE
    for state in (0, 2, 3, 4):
        for rig in (armed_rig(landed(), landed(state)), armed_rig(landed(state)), silent):
            rig.out.clear()
            rig.send("router", message)
            assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


STICKS = {
    "disarming gesture": mavlink.MAVLink_manual_control_message(ID, 0, 0, 0, -1000, 0),
    "take-off": mavlink.MAVLink_manual_control_message(ID, 0, 0, 800, 0, 0),
    "yaw that PX4 ignores": mavlink.MAVLink_manual_control_message(ID, 0, 0, 0, 1001, 0),
    "override": mavlink.MAVLink_rc_channels_override_message(ID, 1, *[1000] * 8),
}


@pytest.mark.parametrize("message", STICKS.values(), ids=STICKS.keys())
def test_other_sticks_pass_to_an_armed_vehicle_on_the_ground(message):
    """PX4 takes missing stick positions for a lost radio, and its pilot must be able to disarm."""
    rig = armed_rig(landed())
    rig.send("router", message)
    assert [m.get_msgId() for m in rig.out] == [message.get_msgId()]


@pytest.mark.parametrize(
    "message",
    [arm(param1=0.0), arm(param1=0.0, magic=21196.0), command(21), command(185, 1.0), command(176, *LAND)],
)
def test_disarming_and_landing_pass_to_an_armed_vehicle_on_the_ground(message):
    rig = armed_rig(landed())
    rig.send("router", message)
    assert [m.command for m in rig.out] == [message.command]
