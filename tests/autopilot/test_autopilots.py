"""Flights of the built-in autopilots in the simulated world, side by side: setpoints, failsafes, faults."""

from __future__ import annotations

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink
from scenarios import Lane, Scenarios

from arena.geometry import quat_multiply

scenario = Scenarios()
lanes = scenario.fixture(origin=False)


@scenario
def test_setpoints_are_reached_and_the_landing_is_soft(v: Lane):
    yield from v.take_off_offboard()
    for target, yaw in (([1.0, 0.5, -1.8], 0.5), ([0.5, -0.5, -1.2], -1.0)):
        yield from v.run(6.0, v.holding(target, yaw))
        assert v.away(target) < 0.10
    assert (yield from v.command(mavlink.MAV_CMD_NAV_LAND)) == 0
    yield from v.until(lambda: not v.armed, 15)
    assert v.away_level(0.5, -0.5) < 0.1
    assert not v.flight.world.flights()[f"uav{v.i + 1}"]["crashed"]


@scenario(MPC_LAND_ALT1=3.0, MPC_LAND_ALT2=1.5, MPC_Z_VEL_MAX_DN=1.5, MPC_LAND_SPEED=0.6)
def test_landing_slows_down_between_its_two_heights(v: Lane):
    sink: dict[str, list[float]] = {"high": [], "between": [], "low": []}

    def note() -> None:
        up, down = -v.position[2], float(v.v_n[2])
        if 3.2 < up < 4.0:
            sink["high"].append(down)
        elif 2.15 < up < 2.35:
            sink["between"].append(down)
        elif 0.5 < up < 1.2:
            sink["low"].append(down)

    yield from v.take_off_offboard()
    yield from v.run(6.0, v.holding([0, 0, -5.5]))
    assert (yield from v.command(mavlink.MAV_CMD_NAV_LAND)) == 0
    yield from v.until(lambda: not v.armed, 20, note)
    assert 1.35 < np.mean(sink["high"]) < 1.8
    assert 0.9 < np.mean(sink["between"]) < 1.35
    assert 0.5 < np.mean(sink["low"]) < 0.75


@scenario
def test_silent_program_triggers_the_offboard_failsafe_and_lands(v: Lane):
    yield from v.take_off_offboard()
    took = yield from v.until(lambda: v.mode != "OFFBOARD", 5)
    assert 0.9 < took < 1.15
    assert v.mode == "AUTO.LAND"
    yield from v.until(lambda: not v.armed, 15)
    assert "offboard control lost" in v.texts()
    assert v.away_level() < 0.3


@scenario
def test_lost_vision_triggers_a_failsafe_and_ends_disarmed(v: Lane):
    stream = yield from v.take_off_offboard()
    v.flight.vision_on[v.i] = False
    took = yield from v.until(lambda: v.mode != "OFFBOARD", 5, stream)
    assert 0.9 < took < 1.2
    assert "external vision lost" in v.vehicle.commander.failsafe
    yield from v.until(lambda: not v.armed, 20, stream)
    assert v.position[2] > -0.1


@scenario
def test_vision_gap_of_300_ms_changes_nothing(v: Lane):
    stream = yield from v.take_off_offboard()
    v.flight.vision_on[v.i] = False
    yield from v.run(0.3, stream)
    v.flight.vision_on[v.i] = True
    yield from v.run(2.0, stream)
    assert v.mode == "OFFBOARD"
    assert v.away([0, 0, -1.2]) < 0.1


def vision_fault(name: str, fault):
    def fly(v: Lane):
        stream = yield from v.take_off_offboard()
        v.flight.faults[v.i] = fault
        yield from v.until(lambda: v.mode != "OFFBOARD", 5, stream)
        yield from v.until(lambda: not v.armed, 20, stream)
        assert v.away_level() < 0.3

    return scenario.add(name, fly)


test_position_jump_of_the_rigid_body_is_not_followed = vision_fault(
    "test_position_jump_of_the_rigid_body_is_not_followed", lambda p, q: (p + np.array([0.5, 0.0, 0.0]), q)
)
test_yaw_flip_of_the_rigid_body_is_not_followed = vision_fault(
    "test_yaw_flip_of_the_rigid_body_is_not_followed",
    lambda p, q: (p, quat_multiply([0.0, 0.0, 0.0, 1.0], q)),
)


@scenario
def test_offboard_is_not_re_entered_after_a_pilot_took_over(v: Lane):
    stream = yield from v.take_off_offboard()
    assert (yield from v.set_mode(4, 3)) == 0
    yield from v.run(3.0, stream)
    assert v.mode == "AUTO.LOITER"
    assert v.armed


@scenario
def test_disarming_in_flight_needs_force(v: Lane):
    yield from v.take_off_offboard()
    assert (yield from v.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)) == 1
    assert v.armed
    assert (yield from v.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)) == 0
    assert not v.armed


@scenario(MIS_TAKEOFF_ALT=1.5)
def test_takeoff_command_climbs_and_holds(v: Lane):
    assert (yield from v.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, float("nan"))) == 0
    assert (yield from v.arm()) == 0
    yield from v.until(lambda: v.mode == "AUTO.LOITER", 15)
    yield from v.run(3.0)
    assert abs(v.position[2] + 1.55) < 0.2


@scenario(COM_LOW_BAT_ACT=2)
def test_critical_battery_lands_if_configured(v: Lane):
    stream = yield from v.take_off_offboard()
    v.flight.battery[v.i] = 0.06
    yield from v.until(lambda: v.mode == "AUTO.LAND", 1, stream)
    assert "Critical battery" in v.texts()


@scenario
def test_armed_vehicle_without_takeoff_disarms(v: Lane):
    assert (yield from v.arm()) == 0
    took = yield from v.until(lambda: not v.armed, 12)
    assert 9.5 < took < 10.5


@scenario
def test_velocity_attitude_and_rate_setpoints_move_the_right_way(v: Lane):
    stream = yield from v.take_off_offboard(3.0)
    system = v.i + 1
    north = mavlink.MAVLink_set_position_target_local_ned_message(
        0, system, 1, 1, 0b110111000111, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
    )
    yield from v.run(2.0, lambda: v.send(north))
    assert abs(v.v_n[0] - 0.5) < 0.1
    yield from v.run(2.0, stream)
    # Nose down: the vehicle must accelerate forward, which is north.
    q = [np.cos(-0.05), 0.0, np.sin(-0.05), 0.0]
    thrust = float(v.flight.pilots.thrust[v.i])
    before = v.v_n[0]
    tilt = mavlink.MAVLink_set_attitude_target_message(0, system, 1, 7, q, 0, 0, 0, thrust)
    yield from v.run(1.0, lambda: v.send(tilt))
    assert v.v_n[0] - before > 0.4
    yield from v.run(3.0, stream)
    turn = mavlink.MAVLink_set_attitude_target_message(0, system, 1, 128, [1, 0, 0, 0], 0, 0, 0.5, thrust)
    yield from v.run(0.3, lambda: v.send(turn))
    assert v.flight.world.truth().omega_b[v.i][2] > 0.15


def rotor_lost(breaker: int):
    def fly(v: Lane):
        stream = yield from v.take_off_offboard(12.0)
        v.flight.world.scale_rotor_thrust(v.i, 0, 0.0)
        stopped = []

        def fall() -> None:
            stream()
            stopped.append(bool(np.max(v.flight.motors[v.i]) < 0.05))

        yield from v.until(lambda: v.position[2] > -1.0, 6, fall)
        assert any(stopped) is (breaker == 0)
        assert v.mode == ("TERMINATION" if breaker == 0 else "OFFBOARD")

    return scenario.add(f"test_lost_rotor_with_cbrk_flightterm_{breaker}", fly, CBRK_FLIGHTTERM=breaker)


test_lost_rotor_with_cbrk_flightterm_0 = rotor_lost(0)
test_lost_rotor_with_cbrk_flightterm_121212 = rotor_lost(121212)


def offboard_with(v: Lane, seconds: float, **fields: float):
    """Take off, then send one setpoint of velocity and acceleration all the time."""
    yield from v.take_off_offboard(5.0)
    unset = dict.fromkeys(("afx", "afy", "afz", "yaw", "yaw_rate"), float("nan"))
    values = {"vx": 0.0, "vy": 0.0, "vz": 0.0} | unset | fields
    m = mavlink.MAVLink_set_position_target_local_ned_message(
        0, v.i + 1, 1, 1, 0b111, 0, 0, 0, *values.values()
    )
    yield from v.run(seconds, lambda: v.send(m))


@scenario
def test_absurd_acceleration_does_not_wind_up_the_integral(v: Lane):
    yield from offboard_with(v, 0.5, afx=9e5, afy=0.0)
    assert np.abs(v.flight.pilots.cascade.position.integral[v.i]).max() < 10.0


@scenario
def test_absurd_yaw_rate_does_not_tip_the_vehicle_over(v: Lane):
    yield from offboard_with(v, 1.0, vx=5.0, yaw_rate=9e5)
    assert v.mode == "OFFBOARD"
    assert v.flight.pilots.est.r_nb[v.i, 2, 2] > np.cos(np.radians(60))
    assert np.abs(v.flight.world.truth().omega_b[v.i]).max() < np.radians(260)


@scenario
def test_jumping_poses_prevent_arming(v: Lane):
    yield from v.run(2.0)
    assert v.vehicle.ready_to_arm
    v.flight.faults[v.i] = lambda p, q: (p + np.array([3.0, 0.0, 0.0]), q)
    yield from v.run(0.5)
    assert not v.vehicle.ready_to_arm
    assert (yield from v.arm()) != 0


def test_single_vehicle_flies_as_in_a_fleet():
    flight = Flight(1)
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    flight.run(0.3, lambda f: f.setpoint(0, [0, 0, -1.2]))
    assert flight.offboard(0) == flight.arm(0) == 0
    flight.until(lambda f: f.position(0)[2] < -1.05, 12, lambda f: f.setpoint(0, [0, 0, -1.2]))
    flight.run(2.0, lambda f: f.setpoint(0, [0, 0, -1.2]))
    assert np.linalg.norm(flight.position(0) - [0, 0, -1.2]) < 0.1


@pytest.mark.parametrize("sensor_hz", [50, 100, 250, 500, 1000])
def test_decisions_are_made_50_times_a_second_at_any_sensor_rate(sensor_hz):
    flight = Flight(1, sensor_hz=sensor_hz, physics_hz=1000)
    pilots, decided, fused = flight.pilots, [], []
    decide, fuse = pilots.land.update, pilots.est.fuse_baro
    pilots.land.update = lambda now, *rest: (decided.append(now), decide(now, *rest))  # type: ignore[method-assign]
    pilots.est.fuse_baro = lambda height, now: (fused.append(now), fuse(height, now))  # type: ignore[method-assign]
    for _ in range(sensor_hz):
        flight._step()
    assert len(decided) == len(fused) == 50


@pytest.mark.parametrize(("sensor_hz", "rate"), [(100, 100), (250, 125), (1000, 125)])
def test_position_is_controlled_125_times_a_second(sensor_hz, rate):
    flight = Flight(1, sensor_hz=sensor_hz, physics_hz=1000)
    cascade, times = flight.pilots.cascade, []
    begin = cascade.begin
    cascade.begin = lambda sp: times.append(begin(sp)) or times[-1]  # type: ignore[method-assign]
    for _ in range(sensor_hz):
        flight._step()
    assert sum(times) == rate
