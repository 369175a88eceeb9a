"""Rates, armed flag and take-off of one vehicle."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.mavlink_framing import may_contain
from arena.recorder.vehicle_watch import VehicleWatch

OUT = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)


def heartbeat(armed: bool, system: int = 1, component: int = 1) -> bytes:
    codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, 0, 4, 3).pack(codec))


def attitude() -> bytes:
    return bytes(mavlink.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0, 0, 0.7).pack(OUT))


def landed(state: int) -> bytes:
    return bytes(mavlink.MAVLink_extended_sys_state_message(0, state).pack(OUT))


def reads_status(data: bytes) -> bool:
    return may_contain(data, mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)


def test_status_is_found_anywhere_in_a_datagram():
    for status in (heartbeat(True), landed(1)):
        assert reads_status(attitude() * 3 + status + attitude())
    assert not reads_status(attitude() * 5)
    assert not reads_status(b"")


def test_signed_frames_are_skipped_as_a_whole():
    signed = attitude()[:2] + b"\x01" + attitude()[3:] + b"\0" * 13
    assert not reads_status(signed * 2)
    assert reads_status(signed + heartbeat(True))


def test_mavlink_1_may_be_a_status():
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    assert reads_status(mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3).pack(codec, force_mavlink1=True))


def received(watch: VehicleWatch, up: bool, data: bytes, time_s: float) -> bool:
    return watch.datagrams.count(up, data, time_s) and watch.on_status(data)


def test_armed_follows_the_heartbeats_of_the_autopilot_only():
    watch = VehicleWatch(1)
    assert not watch.armed
    received(watch, False, heartbeat(True), 0.0)
    assert watch.armed
    received(watch, False, heartbeat(False, component=191), 0.1)
    received(watch, False, heartbeat(False, system=2), 0.2)
    received(watch, True, heartbeat(False), 0.3)
    assert watch.armed
    received(watch, False, heartbeat(False), 0.4)
    assert not watch.armed


def test_take_off_is_reported_by_the_land_detector_while_armed():
    watch = VehicleWatch(1)
    on_ground, in_air = (
        mavlink.MAV_LANDED_STATE_ON_GROUND,
        mavlink.MAV_LANDED_STATE_IN_AIR,
    )
    assert not received(watch, False, landed(in_air), 0.0), "not armed"
    received(watch, False, heartbeat(True), 0.1)
    assert not received(watch, False, landed(on_ground), 0.2)
    assert received(watch, False, landed(in_air), 0.3)
    watch.airborne_unix_s = 5.0
    assert not received(watch, False, landed(in_air), 0.4), "only the first take-off"


def test_height_above_the_first_one_is_above_the_floor():
    watch = VehicleWatch(1)
    assert not watch.is_above_floor(0.2)
    assert not watch.is_above_floor(0.24)
    assert watch.is_above_floor(0.26)


def test_rates_are_means_since_the_first_datagram():
    watch = VehicleWatch(1)
    for i in range(200):
        received(watch, False, attitude(), 10.0 + 0.01 * i)
        received(watch, True, heartbeat(False), 10.0 + 0.01 * i)
        if i % 2:
            watch.poses.add(10.0 + 0.01 * i)
    assert watch.stats(12.0) == {"datagrams_hz": 100.0, "commands_hz": 100.0, "mocap_hz": 50.0}
