"""HOLD of one vehicle: what is sent, and when the hold is confirmed."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import Authority, CommandGate, Role
from arena.authority.command_gate import role_of_tool
from arena.authority.requests import Kind, parse_request
from arena.monitor.hold import RETRY_S, TIMEOUT_S, Hold
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_ids import HOLD

OFFBOARD, LOITER, POSCTL = 6 << 16, 4 << 16 | 3 << 24, 3 << 16
ARMED = 128


def heartbeat(mode, armed=True):
    return packed(mavlink.MAVLink_heartbeat_message(2, 12, ARMED * armed, mode, 4, 3))


def packed(message):
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))


def commands_of(frames):
    return [message.command for frame in frames for message in Codec(255, 1).parse(frame)]


def test_mode_is_commanded_only_after_the_vehicle_has_reported_its_mode():
    one = Hold("uav1", 1, 0.0, simulated=False)
    assert commands_of(one.due(0.0)) == [mavlink.MAV_CMD_REQUEST_MESSAGE]
    one.on_datagram(heartbeat(OFFBOARD), 0.1)
    assert commands_of(one.due(0.2)) == [], "too early to repeat"
    assert commands_of(one.due(RETRY_S)) == [mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_REQUEST_MESSAGE]


def test_command_is_a_ground_stations_request_for_loiter():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(OFFBOARD), 0.0)
    data = one.due(0.0)[0]
    request = parse_request(data, parse_frames(data).frames[0])
    assert request is not None and (request.kind, request.mode) == (Kind.MODE, "AUTO.LOITER")
    assert role_of_tool(HOLD.system) is Role.GROUND_STATION


def test_every_hold_has_the_same_ids_at_a_vehicle_that_signs(monkeypatch):
    found = set()
    for pid in (1000, 1001):
        monkeypatch.setattr("os.getpid", lambda pid=pid: pid)
        one = Hold("uav1", 1, 0.0, simulated=False, signs=True)
        found |= {(f.sysid, f.compid) for data in one.due(0.0) for f in parse_frames(data).frames}
    assert found == {(HOLD.system, HOLD.signed)}


def test_programs_cannot_fly_the_vehicle_after_a_hold():
    gate = CommandGate("uav1", 1, simulated=True, radio=False)
    gate.on_state(True, "OFFBOARD", 0.0)
    one = Hold("uav1", 1, 0.0, simulated=True)
    one.on_datagram(heartbeat(OFFBOARD), 0.0)
    data = one.due(0.0)[0]
    assert (
        gate.refusal(Role.GROUND_STATION, data, parse_frames(data).frames[0], 0.0, ("127.0.0.1", 1)) is None
    )
    gate.on_state(True, "AUTO.LOITER", 0.1)
    assert isinstance(gate.authority, Authority) and gate.authority.blocked


def test_hold_is_confirmed_by_the_mode():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(OFFBOARD), 0.1)
    assert one.due(0.1) and not one.result
    one.on_datagram(heartbeat(LOITER), 0.4)
    assert one.confirmed and one.result == "uav1: holds its position (AUTO.LOITER) after 0.4 s"
    assert one.due(1.0) == []


def test_vehicle_that_loiters_already_is_commanded_before_it_is_confirmed():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(LOITER), 0.1)
    assert not one.result, "nobody has commanded it: a program may be about to switch to OFFBOARD"
    assert mavlink.MAV_CMD_DO_SET_MODE in commands_of(one.due(0.1))
    one.on_datagram(heartbeat(LOITER), 0.2)
    assert one.confirmed and "a program may take it to OFFBOARD" in one.result


def test_warning_is_true_to_the_authority_over_the_vehicle():
    for mode, blocked in ((OFFBOARD, True), (LOITER, False)):
        gate = CommandGate("uav1", 1, simulated=True, radio=False)
        gate.on_state(True, {OFFBOARD: "OFFBOARD", LOITER: "AUTO.LOITER"}[mode], 0.0)
        one = Hold("uav1", 1, 0.0, simulated=True)
        one.on_datagram(heartbeat(mode), 0.0)
        data = one.due(0.0)[0]
        gate.refusal(Role.GROUND_STATION, data, parse_frames(data).frames[0], 0.0, ("127.0.0.1", 1))
        gate.on_state(True, "AUTO.LOITER", 0.1)
        one.on_datagram(heartbeat(LOITER), 0.1)
        assert one.confirmed and ("a program may" in one.result) is not blocked
        assert bool(gate.authority.blocked) is blocked


def test_pilot_keeps_a_real_vehicle():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(POSCTL), 0.1)
    assert not one.confirmed and "NOT CONFIRMED: pilot has control" in one.result
    simulated = Hold("uav1", 1, 0.0, simulated=True)
    simulated.on_datagram(heartbeat(POSCTL), 0.1)
    assert not simulated.result


def test_disarmed_vehicle_is_not_commanded():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(LOITER, armed=False), 0.1)
    assert "disarmed" in one.result and not one.confirmed and one.due(1.0) == []


def test_refusal_shows_its_reason():
    one = Hold("uav1", 1, 0.0, simulated=False)
    one.on_datagram(heartbeat(OFFBOARD), 0.1)
    text = mavlink.MAVLink_statustext_message(4, b"land-all has control: run `arena release`")
    ack = mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_DENIED)
    one.on_datagram(packed(ack) + packed(text) + heartbeat(OFFBOARD), 0.2)
    assert "NOT CONFIRMED: refused" in one.result and "land-all has control" in one.result


def test_silent_vehicle_is_not_confirmed_after_the_time_limit():
    one = Hold("uav1", 1, 0.0, simulated=False)
    assert one.due(TIMEOUT_S) == []
    assert one.result == f"uav1: NOT CONFIRMED: no heartbeat after {TIMEOUT_S:g} s"
