"""The world as a vehicle meets it: hover, fall, torques, floor, walls, wind, determinism."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.geometry import euler_from_quat, matrix_from_quat, quat_from_euler
from arena.sim.world import World, substeps

from .sim_slices import PROFILE, slice_of, vehicle

ALOFT = [0.0, 0.0, -2.5]
GENERIC_RPY = np.radians([10.0, -20.0, 35.0]).tolist()
QUIET = {
    "imu": {"accel_noise_m_s2": 0, "accel_bias_m_s2": 0, "gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0},
    "baro": {"noise_m": 0, "bias_m": 0},
    "mag": {"noise_gauss": 0, "bias_gauss": 0},
}


def hover(world, add=0.0):
    """Return the command that carries every vehicle, plus `add` per rotor (V, R)."""
    return np.repeat(world.hover[:, None], world.rotors, axis=1) + np.array(add)


def fly(world, motors, seconds):
    for _ in range(round(seconds / world.period_s)):
        world.step(motors)


def settled(world):
    """Bring rotors to hover speed and put the vehicles back at their start, at rest."""
    fly(world, hover(world), 0.3)
    for i in range(world.fleet.size):
        world.bodies.place(i, p_n=world.fleet.start_p_n[i], q_nb=world.fleet.start_q_nb[i])
    return world


def test_hover_thrust_carries_the_vehicle(build):
    world = settled(build(vehicle(position=ALOFT)))
    before = world.bodies.p_n.copy()
    fly(world, hover(world), 2.0)
    assert world.bodies.p_n == pytest.approx(before, abs=2e-3)
    assert world.truth().accel_b[0] == pytest.approx([0, 0, -GRAVITY_M_S2], abs=1e-3)


def test_motors_off_is_free_fall_at_exactly_g_and_weightless(build):
    world = build(vehicle(position=[0, 0, -4]))
    fly(world, np.zeros((1, 4)), 0.5)
    assert world.truth().v_n[0] == pytest.approx([0, 0, 0.5 * GRAVITY_M_S2], rel=1e-9)
    assert world.truth().accel_b[0] == pytest.approx([0, 0, 0], abs=1e-9)


# PX4's quadrotor x: 1 front right ccw, 2 rear left ccw, 3 front left cw, 4 rear right cw.
@pytest.mark.parametrize(
    ("more", "axis"),
    [((0, 1, 1, 0), 0), ((1, 0, 1, 0), 1), ((1, 1, 0, 0), 2)],
    ids=["left rotors roll it right", "front rotors pitch it up", "ccw rotors yaw it right"],
)
def test_torque_signs(build, more, axis):
    world = settled(build(vehicle(position=ALOFT)))
    fly(world, hover(world, 0.02 * np.array(more) - 0.02 * (1 - np.array(more))), 0.1)
    turned = euler_from_quat(world.truth().q_nb[0])
    assert turned[axis] > 1e-3
    assert np.delete(turned, axis) == pytest.approx([0, 0], abs=1e-4)
    assert world.truth().omega_b[0, axis] > 0.01


def test_accelerometer_measures_thrust_in_body_axes(build):
    world = settled(build(vehicle(position=ALOFT, rpy=GENERIC_RPY, sensors=QUIET)))
    fly(world, hover(world), 0.02)
    assert world.sense()["accel_b"][0] == pytest.approx([0, 0, -GRAVITY_M_S2], abs=1e-4)
    expected_n = matrix_from_quat(quat_from_euler(GENERIC_RPY)) @ [0, 0, -GRAVITY_M_S2] + [0, 0, GRAVITY_M_S2]
    assert world.truth().v_n[0] / 0.02 == pytest.approx(expected_n, abs=1e-4)


def test_gyro_is_in_body_axes_at_a_generic_attitude(build):
    world = settled(build(vehicle(position=ALOFT, rpy=GENERIC_RPY, sensors=QUIET)))
    omega_b = np.array([0.5, -0.6, 0.7])
    world.bodies.place(0, p_n=np.array(ALOFT), q_nb=quat_from_euler(GENERIC_RPY), omega_b=omega_b)
    assert world.sense()["gyro_b"][0] == pytest.approx(omega_b)


def test_a_standing_vehicle_measures_one_g(build):
    world = build(vehicle(sensors=QUIET))
    assert world.sense()["accel_b"][0] == pytest.approx([0, 0, -GRAVITY_M_S2])
    fly(world, np.zeros((1, 4)), 1.0)
    assert world.sense()["accel_b"][0] == pytest.approx([0, 0, -GRAVITY_M_S2], abs=1e-3)


@pytest.mark.parametrize("command", [0.0, 0.15])
def test_a_standing_vehicle_does_not_drift(build, command):
    world = build(vehicle(position=[1, 2, 0], rpy=[0, 0, 0.7]), vehicle("uav2", 2, position=[-1, 0, 0]))
    before, attitude = world.bodies.p_n.copy(), world.bodies.q_nb.copy()
    fly(world, np.full((2, 4), command), 10.0)
    assert world.bodies.p_n == pytest.approx(before, abs=1e-3)
    assert np.abs((world.bodies.q_nb * attitude).sum(axis=1)) == pytest.approx([1.0, 1.0], abs=1e-7)
    assert world.flights()["uav1"]["crashed"] == ""
    assert world.flights()["uav1"]["airborne_s"] < 0.1


def test_start_position_is_that_of_the_lowest_point(build):
    world = build(vehicle(position=[0, 0, 0]), vehicle("uav2", 2, position=[2, 0, -1], rpy=[0.3, 0, 0]))
    assert world.bodies.p_n[0, 2] == pytest.approx(-PROFILE["ground_clearance_m"])
    leaning = 0.05 * np.cos(0.3) + 0.275 * np.sin(0.3)
    assert world.bodies.p_n[1, 2] == pytest.approx(-1 - leaning, abs=1e-3)


def test_a_tall_body_stands_at_its_ground_clearance(build):
    world = build(vehicle(height_m=0.3, ground_clearance_m=0.1))
    fly(world, np.zeros((1, 4)), 1.0)
    assert world.bodies.p_n[0, 2] == pytest.approx(-0.1, abs=1e-3)


def test_a_collision_crashes_both_and_names_the_other(build):
    world = settled(build(vehicle(position=ALOFT), vehicle("uav2", 2, position=[1.0, 0.1, -2.5])))
    world.bodies.place(0, p_n=np.array(ALOFT), q_nb=np.array([1.0, 0, 0, 0]), v_n=np.array([2.0, 0, 0]))
    fly(world, hover(world), 0.5)
    verdicts = world.flights()
    assert "touched uav2 at" in verdicts["uav1"]["crashed"]
    assert "touched uav1 at" in verdicts["uav2"]["crashed"]
    assert world.bodies.v_n[1, 0] > 0.5, "it was pushed"
    assert sorted(line.split()[0] for line in world.events()) == ["uav1", "uav2"]
    assert world.events() == []


@pytest.mark.parametrize(
    ("towards", "wall"), [((1, 0), "north"), ((-1, 0), "south"), ((0, 1), "east"), ((0, -1), "west")]
)
def test_a_wall_stops_a_vehicle_and_is_named(build, towards, wall):
    world = settled(build(vehicle(position=ALOFT)))
    edge = np.array([6.0, 4.0]) * towards
    start = np.array([*(edge - 0.6 * np.array(towards)), -2.5])
    world.bodies.place(0, p_n=start, q_nb=np.array([1.0, 0, 0, 0]), v_n=np.array([*towards, 0]) * 3.0)
    fly(world, hover(world), 0.5)
    assert f"touched the {wall} wall" in world.flights()["uav1"]["crashed"]
    assert np.abs(world.bodies.p_n[0, :2]).max() < 6.0


def rising(build, **room):
    """Return a vehicle's height after it rose at 3 m/s for 0.8 s from 1 m below the top of a room, and its crash."""
    world = settled(build(vehicle(position=[0, 0, -2]), **room))
    world.bodies.place(
        0, p_n=np.array([1.0, 0.5, -4.0]), q_nb=np.array([1.0, 0, 0, 0]), v_n=np.array([0, 0, -3.0])
    )
    fly(world, hover(world), 0.8)
    return -world.bodies.p_n[0, 2], world.flights()["uav1"]["crashed"]


def test_the_ceiling_stops_a_vehicle_and_is_named(build):
    height, crashed = rising(build)
    assert height < 5.0
    assert "touched the ceiling" in crashed


def test_a_room_without_ceiling_is_open_to_the_sky(build):
    height, crashed = rising(build, ceiling=False)
    assert height > 6.0
    assert crashed == ""


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 50.0])
def test_hard_touchdown_is_a_crash_whatever_part_of_a_step_it_takes(build, tilt_deg):
    """pybullet can brake a body in the step before the contact."""
    half = np.radians(tilt_deg) / 2
    speeds = []
    for k in range(16):
        world = build(vehicle(position=[0, 0, -0.6]))
        place = np.array([0.0, 0.0, -0.6 - 0.001 * k])
        attitude = np.array([np.cos(half), np.sin(half), 0.0, 0.0])
        world.bodies.place(0, p_n=place, q_nb=attitude, v_n=np.array([0.0, 0.0, 3.8]))
        for _ in range(100):
            world.step(np.zeros((1, 4)))
        crash = world.flights()["uav1"]["crashed"]
        speeds.append(float(crash.split()[3]) if crash.startswith("touched down at") else 0.0)
    assert min(speeds) > 3.5, speeds


@pytest.mark.parametrize(("speed", "crashes"), [(0.7, False), (1.3, False), (1.8, True)])
def test_touchdown_speed_decides(build, speed, crashes):
    world = settled(build(vehicle(position=[0, 0, -0.5])))
    world.bodies.place(
        0, p_n=np.array([0.5, 0.2, -0.5]), q_nb=np.array([1.0, 0, 0, 0]), v_n=np.array([0, 0, speed])
    )
    for _ in range(500):
        world.step(hover(world) if not world.flights()["uav1"]["landings"] else np.zeros((1, 4)))
    verdict = world.flights()["uav1"]
    assert verdict["touchdown_m_s"] == pytest.approx(speed, abs=0.05)
    assert bool(verdict["crashed"]) is crashes
    assert verdict["landed_p_n"] == pytest.approx([0.5, 0.2, -0.05], abs=0.01)
    assert world.bodies.p_n[0] == pytest.approx([0.5, 0.2, -0.05], abs=2e-3), "it does not bounce away"


def test_tilt_is_a_crash(build):
    world = build(vehicle(position=[0, 0, -4]))
    world.bodies.place(
        0, p_n=np.array([0, 0, -4.0]), q_nb=quat_from_euler([0, 0, 0]), omega_b=np.array([6.0, 0, 0])
    )
    fly(world, np.zeros((1, 4)), 0.3)
    assert "tilted 6" in world.flights()["uav1"]["crashed"]


def test_wind_pushes_what_has_drag(build):
    world = settled(build(vehicle(position=ALOFT, drag_kg_s=[0.5, 0.5, 0.0]), wind_m_s=[1.0, -2.0, 0.0]))
    fly(world, hover(world), 0.5)
    assert world.bodies.v_n[0, 0] > 0.1
    assert world.bodies.v_n[0, 1] == pytest.approx(-2 * world.bodies.v_n[0, 0])


def test_thrust_fades_with_speed(build):
    curve = {**PROFILE["thrust_curve"], "fade_speed_m_s": 25.0}
    world = settled(build(vehicle(position=ALOFT, thrust_curve=curve)))
    world.bodies.place(0, p_n=np.array(ALOFT), q_nb=np.array([1.0, 0, 0, 0]), v_n=np.array([5.0, 0, 0]))
    world.step(hover(world))
    assert world.truth().accel_b[0, 2] == pytest.approx(-GRAVITY_M_S2 * (1 - 5 / 25), rel=1e-3)


def test_rotors_follow_the_command_with_their_lag(build):
    world = build(vehicle(position=[0, 0, -4]))
    world.step(np.full((1, 4), 0.8))
    assert world.truth().motors[0] == pytest.approx([0.8 * (1 - np.exp(-0.004 / 0.0125))] * 4)
    fly(world, np.full((1, 4), 0.8), 0.2)
    world.step(np.zeros((1, 4)))
    assert world.truth().motors[0] == pytest.approx([0.8 * np.exp(-0.004 / 0.025)] * 4, rel=1e-4)


def test_commands_are_clamped_to_0_and_1(build):
    world = build(vehicle(position=[0, 0, -4]))
    world.step(np.array([[np.nan, np.inf, -3.0, 7.0]]))
    assert np.isfinite(world.truth().p_n).all()
    assert (world.truth().motors >= 0).all() and (world.truth().motors <= 1).all()


def test_the_same_seed_gives_an_identical_world():
    def run(seed):
        world = World(slice_of(vehicle(), vehicle("uav2", 2, position=[0.7, 0, 0]), seed=seed))
        heard = []
        for k in range(500):
            sensed = world.sense()
            world.step(np.clip(0.6 + 0.1 * sensed["gyro_b"][:, :1] * [1, -1, 1, -1] - 0.001 * k, 0, 1))
            truth = world.truth()
            heard.append(np.concatenate([truth.p_n, truth.q_nb, truth.omega_b, sensed["accel_b"]], axis=1))
        world.close()
        return np.array(heard)

    first, again, other = run(3), run(3), run(4)
    assert (first == again).all()
    assert (first != other).any()


def test_vehicles_may_have_different_rotor_counts(build):
    six = [
        {"position_m": [0.2 * np.cos(a), 0.2 * np.sin(a), 0], "direction": "cw" if i % 2 else "ccw"}
        for i, a in enumerate(np.radians(np.arange(30, 390, 60)))
    ]
    world = settled(
        build(vehicle(position=ALOFT), vehicle("hexa", 2, position=[2, 0, -2.5], rotors=six, num_rotors=6))
    )
    assert world.rotors == 6
    fly(world, hover(world), 1.0)
    assert world.bodies.p_n[:, 2] == pytest.approx([-2.55, -2.55], abs=2e-3)
    assert world.truth().motors.shape == (2, 6)
    assert world.truth().motors[1] == pytest.approx([world.hover[1]] * 6, rel=1e-3)


def test_the_battery_empties_as_the_profile_says(build):
    world = settled(build(vehicle(position=ALOFT)))
    assert world.sense()["battery_v"][0] < 3 * 4.2
    before = world.sense()["battery_remaining"][0]
    fly(world, hover(world), 1.0)
    sensed = world.sense()
    assert sensed["battery_current_a"][0] == pytest.approx(20.0, rel=1e-3)
    assert before - sensed["battery_remaining"][0] == pytest.approx(20.0 / 3600 / 5.1, rel=1e-3)


def test_physics_rate_must_be_a_multiple_of_the_sensor_rate():
    assert substeps(500, 250) == 2
    with pytest.raises(
        InputError, match=r"physics_hz: got 600, expected an integer multiple of sensor_hz \(250\)\. Try 500"
    ):
        substeps(600, 250)
    with pytest.raises(InputError, match="physics_hz"):
        substeps(100, 250)


def test_vehicle_with_an_empty_battery_falls(build):
    world = settled(build(vehicle(position=[0.0, 0.0, -3.0])))
    world.override_discharge(0, 1.0)
    fly(world, hover(world), 0.97)
    assert abs(world.truth().v_n[0, 2]) < 0.1, "full thrust down to the reserve"
    fly(world, hover(world), 0.5)
    assert world.truth().v_n[0, 2] > 3.0 and world.truth().motors.max() < 0.01


def test_world_that_is_deleted_frees_its_memory_in_pybullet() -> None:
    pybullet = pytest.importorskip("pybullet")
    gc.collect()
    before = clients(pybullet)
    world = World(slice_of(vehicle()))
    assert clients(pybullet) == before + 1
    del world
    gc.collect()
    assert clients(pybullet) == before


def clients(pybullet: Any) -> int:
    """Return the number of physics simulations in this process."""
    return sum(pybullet.isConnected(client) for client in range(1024))
