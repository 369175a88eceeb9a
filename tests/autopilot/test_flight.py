"""Whole flights of the built-in autopilot in the simulated world, in one process."""

from __future__ import annotations

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import quat_multiply


def airborne(vehicles: int = 1, height: float = 1.2, **settings) -> tuple[Flight, object]:
    """A flight hovering in OFFBOARD, and the callback that keeps its setpoints coming."""
    flight = Flight(vehicles, **settings)
    flight.until(lambda f: all(v.ready_to_arm for v in f.pilots.vehicles), 20)

    def stream(f: Flight) -> None:
        for i in range(vehicles):
            f.setpoint(i, [0, 2.0 * i, -height])

    flight.run(0.5, stream)
    for i in range(vehicles):
        assert flight.offboard(i) == 0
        stream(flight)
        assert flight.arm(i) == 0
    flight.until(lambda f: all(f.position(i)[2] < -height + 0.15 for i in range(vehicles)), 12, stream)
    flight.run(2.0, stream)
    flight.send(0, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    return flight, stream


def texts(flight: Flight, i: int = 0) -> str:
    return "".join(m.text for m in flight.heard[i] if m.get_type() == "STATUSTEXT")


def test_setpoints_are_reached_and_the_landing_is_soft_and_where_it_was_told():
    flight, _ = airborne()
    for target, yaw in (([1.0, 0.5, -1.8], 0.5), ([0.5, -0.5, -1.2], -1.0)):
        flight.run(6.0, lambda f, t=target, y=yaw: f.setpoint(0, t, y))
        assert np.linalg.norm(flight.position(0) - target) < 0.10
    assert flight.command(0, mavlink.MAV_CMD_NAV_LAND) == 0
    flight.until(lambda f: not f.armed(0), 15)
    assert np.hypot(*(flight.position(0)[:2] - [0.5, -0.5])) < 0.1
    verdict = flight.world.flights()["uav1"]
    assert "crashed" not in verdict or not verdict["crashed"]


def test_every_vehicle_of_a_fleet_flies_its_own_setpoint():
    flight, _ = airborne(3)
    for i in range(3):
        assert np.linalg.norm(flight.position(i) - [0, 2.0 * i, -1.2]) < 0.1


def test_a_silent_program_meets_the_offboard_failsafe_after_its_time_and_lands():
    flight, _ = airborne()
    flight.heard[0].clear()
    took = flight.until(lambda f: f.mode(0) != "OFFBOARD", 5)
    assert 0.9 < took < 1.15
    assert flight.mode(0) == "AUTO.LAND"
    flight.until(lambda f: not f.armed(0), 15)
    assert "offboard control lost" in texts(flight)
    assert np.hypot(*flight.position(0)[:2]) < 0.3


def test_lost_vision_is_declared_and_ends_on_the_ground_disarmed():
    flight, stream = airborne()
    flight.vision_on[:] = False
    took = flight.until(lambda f: f.mode(0) != "OFFBOARD", 5, stream)
    assert 0.9 < took < 1.2
    assert "external vision lost" in flight.pilots.vehicles[0].commander.failsafe
    flight.until(lambda f: not f.armed(0), 20, stream)
    assert flight.position(0)[2] > -0.1


def test_a_gap_of_three_tenths_of_a_second_in_vision_is_flown_through():
    flight, stream = airborne()
    flight.vision_on[:] = False
    flight.run(0.3, stream)
    flight.vision_on[:] = True
    flight.run(2.0, stream)
    assert flight.mode(0) == "OFFBOARD"
    assert np.linalg.norm(flight.position(0) - [0, 0, -1.2]) < 0.1


@pytest.mark.parametrize("fault", ["jump", "yaw flip"])
def test_a_body_that_jumps_or_flips_is_never_flown_after(fault):
    flight, stream = airborne()
    honest = flight._see
    if fault == "jump":
        flight._see = lambda p, q: honest(p + np.array([0.5, 0.0, 0.0]), q)
    else:
        flight._see = lambda p, q: honest(p, quat_multiply([0.0, 0.0, 0.0, 1.0], q))
    flight.until(lambda f: f.mode(0) != "OFFBOARD", 5, stream)
    flight.until(lambda f: not f.armed(0), 20, stream)
    assert np.hypot(*flight.position(0)[:2]) < 0.3


def test_nothing_re_enters_offboard_by_itself_after_a_pilot_took_over():
    flight, stream = airborne()
    assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == 0
    flight.run(3.0, stream)
    assert flight.mode(0) == "AUTO.LOITER"
    assert flight.armed(0)


def test_disarming_in_the_air_is_refused_unless_forced():
    flight, _ = airborne()
    assert flight.command(0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == 1
    assert flight.armed(0)
    assert flight.command(0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == 0
    assert not flight.armed(0)


def test_take_off_and_hold_by_command_alone():
    flight = Flight(1, params={"MIS_TAKEOFF_ALT": 1.5})
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    assert flight.command(0, mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, float("nan")) == 0
    assert flight.arm(0) == 0
    flight.until(lambda f: f.mode(0) == "AUTO.LOITER", 15)
    flight.run(3.0)
    assert abs(flight.position(0)[2] + 1.55) < 0.2


def test_a_critical_battery_lands_when_told_to():
    flight, stream = airborne(params={"COM_LOW_BAT_ACT": 2})
    flight.world.sense = _with_battery(flight.world.sense, 0.06)
    flight.until(lambda f: f.mode(0) == "AUTO.LAND", 1, stream)
    assert "Critical battery" in texts(flight)


def _with_battery(sense, remaining):
    def low():
        found = dict(sense())
        found["battery_remaining"] = np.full_like(found["battery_remaining"], remaining)
        return found

    return low


def test_an_armed_vehicle_that_does_not_take_off_disarms_itself():
    flight = Flight(1)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    assert flight.arm(0) == 0
    took = flight.until(lambda f: not f.armed(0), 12)
    assert 9.5 < took < 10.5


def test_velocity_attitude_and_rate_setpoints_move_the_right_way():
    flight, stream = airborne(height=3.0)
    north = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110111000111, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
    )
    flight.run(2.0, lambda f: f.send(0, north))
    assert abs(flight.world.truth().v_n[0][0] - 0.5) < 0.1
    flight.run(2.0, stream)
    # Nose down: the vehicle must go forward, which is north.
    q = [np.cos(-0.05), 0.0, np.sin(-0.05), 0.0]
    thrust = float(flight.pilots.thrust[0])
    before = flight.world.truth().v_n[0][0]
    flight.run(
        1.0, lambda f: f.send(0, mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, q, 0, 0, 0, thrust))
    )
    assert flight.world.truth().v_n[0][0] - before > 0.4
    flight.run(3.0, stream)
    turn = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 128, [1, 0, 0, 0], 0, 0, 0.5, thrust)
    flight.run(0.3, lambda f: f.send(0, turn))
    assert flight.world.truth().omega_b[0][2] > 0.15


@pytest.mark.parametrize("breaker", [0, 121212])
def test_with_a_rotor_lost_the_motors_stop_in_the_air_only_where_the_breaker_is_open(breaker):
    flight, stream = airborne(height=12.0, params={"CBRK_FLIGHTTERM": breaker})
    flight.world.scale_rotor_thrust(0, 0, 0.0)
    stopped = []

    def fall(f: Flight) -> None:
        stream(f)
        stopped.append(bool(np.max(f.motors[0]) < 0.05))

    flight.until(lambda f: f.position(0)[2] > -1.0, 6, fall)
    assert any(stopped) is (breaker == 0)
    assert flight.mode(0) == ("TERMINATION" if breaker == 0 else "OFFBOARD")
