"""The built-in autopilot of an arena refuses commands of senders that must not command the vehicle."""

from __future__ import annotations

import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots
from arena.process_context import SUPERVISOR_LOST

LAND = (1, 4, 6)


@pytest.fixture
def flight():
    """Return a flight that hovers at 1 m in OFFBOARD, with authority enforced as in an arena."""
    f = Flight()
    f.pilots = Autopilots(f.settings, f.world.period_s, authority=True)
    f.run(3.0)
    f.run(0.2, hover)
    assert f.offboard(0) == mavlink.MAV_RESULT_ACCEPTED and f.arm(0) == mavlink.MAV_RESULT_ACCEPTED
    f.run(3.0, hover)
    return f


def hover(f):
    f.setpoint(0, (0.0, 0.0, -1.0))


def land_all(f, system=253):
    """Send land mode on the panic link."""
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=195)
    m = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, *LAND, 0, 0, 0, 0)
    f.pilots.receive(0, "panic", m.pack(sender))
    f.run(0.1, hover)


@pytest.mark.parametrize("system", [253, 251])
def test_program_cannot_fly_on_after_land_all_until_release(flight, system):
    land_all(flight, system)
    assert flight.mode(0) == "AUTO.LAND"
    assert flight.offboard(0) == mavlink.MAV_RESULT_DENIED
    assert flight.mode(0) == "AUTO.LAND"
    (text,) = [m.text for m in flight.received[0] if m.get_type() == "STATUSTEXT"]
    assert text.endswith("has control: run `arena release`")
    flight.until(lambda f: not f.armed(0), 20.0, hover)
    assert flight.arm(0) == mavlink.MAV_RESULT_DENIED
    flight.pilots.on_request({"do": "release", "vehicle": "uav1", "by": "ada"})
    flight.run(0.1, hover)
    assert flight.offboard(0) == mavlink.MAV_RESULT_ACCEPTED and flight.arm(0) == mavlink.MAV_RESULT_ACCEPTED


@pytest.mark.parametrize(
    "request_", [{"do": "refuse_arming", "why": "the run is ending"}, SUPERVISOR_LOST], ids=["end", "lost"]
)
def test_nobody_arms_once_the_run_ends(flight, request_):  # review fault 6
    flight.pilots.on_request(request_)
    land_all(flight)
    flight.until(lambda f: not f.armed(0), 20.0, hover)
    assert flight.arm(0) == mavlink.MAV_RESULT_DENIED and not flight.armed(0)


def test_program_flies_and_lands_and_flies_again_without_release(flight):
    for _ in range(2):
        assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, *LAND) == mavlink.MAV_RESULT_ACCEPTED
        flight.until(lambda f: not f.armed(0), 20.0, hover)
        flight.run(0.1, hover)
        assert flight.offboard(0) == mavlink.MAV_RESULT_ACCEPTED
        assert flight.arm(0) == mavlink.MAV_RESULT_ACCEPTED
        flight.run(3.0, hover)


def test_stand_in_for_px4_obeys_every_sender(flight):
    f = Flight()
    assert f.pilots.gates == [] and f.pilots.interfaces[0].gate is None


@pytest.mark.parametrize("target", [1, 0], ids=["own id", "all"])
@pytest.mark.parametrize("link", ["router", "ground"])
def test_setpoint_of_a_ground_station_does_not_mix_with_those_of_the_program(flight, link, target):
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    away = (3.0, 0.0, -3.0, 0, 0, 0, 0, 0, 0)
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, target, 1, 1, 0b100111111000, *away, 0, 0
    )
    flight.run(0.1)
    before = flight.pilots.vehicles[0].offboard_setpoint_at
    assert before < flight.now
    flight.pilots.receive(0, link, message.pack(station))
    assert flight.pilots.vehicles[0].offboard_setpoint_at == before


def test_setpoint_after_land_all_is_refused(flight):
    land_all(flight)
    flight.run(0.1)
    before = flight.pilots.vehicles[0].offboard_setpoint_at
    assert before < flight.now
    flight.setpoint(0, (3.0, 0.0, -3.0))
    assert flight.pilots.vehicles[0].offboard_setpoint_at == before
