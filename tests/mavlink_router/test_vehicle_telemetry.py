"""Height, battery and warnings of a vehicle, from messages that pymavlink packs."""

from __future__ import annotations

import pytest
from fleet import Fleet, packed, sys_status
from pymavlink.dialects.v20 import common as mavlink

CRITICAL, INFO = mavlink.MAV_SEVERITY_CRITICAL, mavlink.MAV_SEVERITY_INFO


@pytest.fixture
def fleet() -> Fleet:
    return Fleet()


def text(words: str, severity: int = CRITICAL, number: int = 0, chunk: int = 0, system: int = 1) -> bytes:
    return packed(mavlink.MAVLink_statustext_message(severity, words.encode(), number, chunk), system)


def local_position(z: float, system: int = 1) -> bytes:
    return packed(mavlink.MAVLink_local_position_ned_message(5, 1.0, 2.0, z, 0, 0, 0), system)


def test_height_and_battery_are_none_before_the_first_message(fleet: Fleet) -> None:
    assert fleet.router.telemetry()["uav1"] == {"height_m": None, "battery": None}


def test_height_is_minus_z_and_battery_is_per_vehicle(fleet: Fleet) -> None:
    fleet.send_as("autopilot1", local_position(-1.05) + sys_status(97))
    fleet.send_as("autopilot2", local_position(0.0, 2) + sys_status(-1, 2))
    assert fleet.router.telemetry() == {
        "uav1": {"height_m": 1.05, "battery": 97},
        "uav2": {"height_m": 0.0, "battery": None},
    }


def test_a_warning_is_reported_once_with_its_vehicle(fleet: Fleet) -> None:
    fleet.send_as("autopilot2", text("Failsafe activated: setpoints lost\t", system=2))
    assert fleet.router.warnings() == ["uav2: Failsafe activated: setpoints lost"]
    assert fleet.router.warnings() == []


def test_a_text_below_warning_is_not_reported(fleet: Fleet) -> None:
    fleet.send_as("autopilot1", text("Takeoff detected", INFO))
    assert fleet.router.warnings() == []


def test_the_chunks_of_a_long_text_are_joined(fleet: Fleet) -> None:
    words = "Failsafe activated: no offboard setpoints for 0.5 s: AUTO.LAND of this vehicle"
    fleet.send_as("autopilot1", text(words[:50], number=7) + text(words[50:], number=7, chunk=1))
    assert fleet.router.warnings() == [f"uav1: {words}"]


def test_a_repeated_warning_is_reported_again_after_ten_seconds(fleet: Fleet) -> None:
    fleet.send_as("autopilot1", text("Arming denied") + text("Arming denied"))
    assert len(fleet.router.warnings()) == 1
    fleet.now += 11.0
    fleet.send_as("autopilot1", text("Arming denied"))
    assert len(fleet.router.warnings()) == 1


def test_a_text_of_a_gimbal_is_not_the_autopilots(fleet: Fleet) -> None:
    message = mavlink.MAVLink_statustext_message(CRITICAL, b"gimbal stuck")
    fleet.send_as("autopilot1", packed(message, 1, 154))
    assert fleet.router.warnings() == []
