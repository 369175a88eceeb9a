"""Tests of the position PID and of the formation law, with simple models of a vehicle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.constants import GRAVITY_M_S2
from arena.controllers import FormationLaw, Gains, PositionPid, attitude_thrust, formation_reference
from arena.geometry import euler_from_quat, quat_rotate
from arena.trajectories import Lissajous, Reference

MASS_KG = 1.4


@pytest.mark.parametrize("yaw", [0.0, 0.6, -2.5])
@pytest.mark.parametrize("force", [[1.0, -2.0, -14.0], [-4.0, 3.0, -9.0], [0.0, 0.0, -13.0]])
def test_attitude_and_thrust_produce_the_force(force, yaw):
    found = attitude_thrust(force, yaw)
    np.testing.assert_allclose(quat_rotate(found.q_nb, np.array([0, 0, -found.thrust_n])), force, atol=1e-9)
    ahead = quat_rotate(found.q_nb, np.array([1.0, 0, 0]))
    assert math.remainder(math.atan2(ahead[1], ahead[0]) - yaw, 2 * math.pi) == pytest.approx(0.0, abs=0.2)


def test_level_hover_needs_the_weight():
    found = PositionPid(MASS_KG).update(Reference(pos=np.zeros(3), yaw=0.5), [0, 0, 0], [0, 0, 0], 0.0)
    assert found.thrust_n == pytest.approx(MASS_KG * GRAVITY_M_S2) and found.tilt == pytest.approx(
        0.0, abs=1e-6
    )
    assert euler_from_quat(found.q_nb)[2] == pytest.approx(0.5)


@pytest.mark.parametrize(("ahead", "pitch_sign", "roll_sign"), [([1, 0, 0], -1, 0), ([0, 1, 0], 0, 1)])
def test_a_goal_ahead_tilts_towards_it(ahead, pitch_sign, roll_sign):
    found = PositionPid(MASS_KG).update(Reference(pos=np.array(ahead, float)), [0, 0, 0], [0, 0, 0], 0.0)
    roll, pitch, _ = euler_from_quat(found.q_nb)
    assert np.sign(round(pitch, 6)) == pitch_sign and np.sign(round(roll, 6)) == roll_sign


def test_tilt_and_thrust_stay_within_their_limits_and_the_integral_waits():
    pid = PositionPid(MASS_KG, max_tilt=0.4, max_thrust_n=20.0)
    for k in range(100):
        found = pid.update(Reference(pos=np.array([50.0, -80.0, -60.0])), [0, 0, 0], [0, 0, 0], 0.02 * k)
        assert found.tilt <= 0.4 + 1e-9 and found.thrust_n <= 20.0 + 1e-9
    assert not pid.integral.any()


def test_a_goal_far_below_does_not_turn_the_vehicle_over():
    found = PositionPid(MASS_KG).update(Reference(pos=np.array([0, 0, 100.0])), [0, 0, 0], [0, 0, 0], 0.0)
    assert found.tilt < 0.1 and 0.0 < found.thrust_n < 0.1 * MASS_KG * GRAVITY_M_S2


def flown(trajectory, *, mass_kg, wind_m_s2, gains=None):
    """Fly a point mass whose force follows the setpoint at once. Return the error of the last half [m] (n, 3)."""
    pid, step_s = PositionPid(MASS_KG, gains), 0.02
    pos, vel = trajectory.at(0.0).pos.copy(), np.zeros(3)
    errors = []
    for t in np.arange(0.0, trajectory.duration_s, step_s):
        wanted = trajectory.at(t)
        found = pid.update(wanted, pos, vel, t)
        force = quat_rotate(found.q_nb, np.array([0, 0, -found.thrust_n]))
        vel = vel + step_s * (force / mass_kg + np.array([0, 0, GRAVITY_M_S2]) + wind_m_s2)
        pos = pos + step_s * vel
        errors.append(pos - trajectory.at(t + step_s).pos)
    return np.array(errors[len(errors) // 2 :])


def test_a_lissajous_figure_is_tracked_within_a_centimetre():
    trajectory = Lissajous([0, 0, -1.5], [1.2, 0.8, 0.0], [1, 2, 0], lap_s=6.0, laps=4)
    assert np.linalg.norm(flown(trajectory, mass_kg=MASS_KG, wind_m_s2=np.zeros(3)), axis=1).max() < 0.02


def test_the_integral_removes_the_error_of_wind_and_mass():
    trajectory = Lissajous([0, 0, -1.5], [0.01, 0, 0], [1, 0, 0], lap_s=30.0, laps=2)
    wind = np.array([0.6, -0.4, 0.0])
    with_integral = flown(trajectory, mass_kg=1.05 * MASS_KG, wind_m_s2=wind)[-1]
    without = flown(trajectory, mass_kg=1.05 * MASS_KG, wind_m_s2=wind, gains=Gains(i=(0, 0, 0)))[-1]
    assert np.linalg.norm(with_integral) < 0.02 < 0.1 < np.linalg.norm(without)


# -- formation ---------------------------------------------------------------------------------------------------------


def followed(law, *, noise_m_s=0.0, lag_s=0.25):
    """Fly a leader on a circle and three followers with a velocity loop of first order. Return their last errors [m] (3,)."""
    rng, step_s = np.random.default_rng(3), 0.02
    wanted = np.array([[-1.0, 0, 0], [0, -1, 0], [-1, -1, 0.3]])  # of each follower, relative to the leader
    pos, vel = wanted + rng.normal(0, 0.5, (3, 3)), np.zeros((3, 3))
    for t in np.arange(0.0, 40.0, step_s):
        leader = np.array([2 * math.cos(0.3 * t) - 2, 2 * math.sin(0.3 * t), 0.0])
        speed = 0.6 * np.array([-math.sin(0.3 * t), math.cos(0.3 * t), 0.0])
        for i in range(3):
            others = [k for k in range(3) if k != i]
            rel = np.array([leader - pos[i], *(pos[k] - pos[i] for k in others)])
            rel_vel = np.array([speed - vel[i], *(vel[k] - vel[i] for k in others)]) + rng.normal(
                0, noise_m_s, (3, 3)
            )
            desired = np.array([-wanted[i], *(wanted[k] - wanted[i] for k in others)])
            setpoint = law.velocity(rel, rel_vel, desired, vel[i])
            vel[i] += step_s / lag_s * (setpoint - vel[i])
        pos += step_s * vel
    return np.linalg.norm(pos - (leader + wanted), axis=1)


def test_followers_converge_to_the_formation_of_a_moving_leader():
    assert followed(FormationLaw()).max() < 0.15


def test_measurement_noise_does_not_break_the_formation():
    assert followed(FormationLaw(), noise_m_s=0.13).max() < 0.2


def test_a_formation_that_changes_its_shape_is_followed():
    law = FormationLaw(position_gain=0.0)
    found = law.velocity([[1, 0, 0]], [[0.5, 0, 0]], [[1, 0, 0]], [0.1, 0, 0], [[0.2, 0, 0]])
    np.testing.assert_allclose(found, [0.1 + 0.5 - 0.2, 0, 0])


def test_the_setpoint_is_limited():
    found = FormationLaw(max_speed_m_s=1.0).velocity([[100, 0, 0]], [[0, 0, 0]], [[0, 0, 0]], [0, 0, 0])
    np.testing.assert_allclose(found, [1, 0, 0])


def test_vehicle_in_its_place_needs_only_its_planned_acceleration():
    wanted = [[-1.5, 0.5, 0.25], [2.0, -1.0, 0.0]]
    speeds = [[0.1, 0.2, 0.3], [-0.1, 0.0, 0.2]]
    found = formation_reference(wanted, speeds, wanted, speeds, [0.3, -0.2, 0.1], 0.5)
    assert not found.pos.any() and not found.vel.any()
    assert found.acc.tolist() == [0.3, -0.2, 0.1] and found.yaw == 0.5


def test_force_law_moves_towards_a_neighbour_that_is_too_far():
    near = formation_reference(
        [[2.0, 0.0, 0.0]], [[0.0, 0.5, 0.0]], [[1.5, 0.0, 0.0]], [[0.0] * 3], [0.0] * 3
    )
    assert near.pos.tolist() == [0.5, 0.0, 0.0] and near.vel.tolist() == [0.0, 0.5, 0.0]
    found = PositionPid(MASS_KG).update(near, [0, 0, 0], [0, 0, 0], 0.0)
    force = quat_rotate(found.q_nb, np.array([0, 0, -found.thrust_n]))
    assert force[0] > 0.1 and force[1] > 0.1


def test_follower_with_the_force_law_converges_to_its_place():
    pid, step_s = PositionPid(MASS_KG, Gains(p=(2.6,) * 3, d=(1.3,) * 3, i=(0.16,) * 3)), 0.02
    leader, pos, vel = np.array([0.0, 0.0, -1.2]), np.array([-2.0, 1.0, -1.0]), np.zeros(3)
    place = np.array([-1.0, -0.5, 0.0])
    for t in np.arange(0.0, 25.0, step_s):
        wanted = formation_reference(
            [leader - pos], [np.array([0.3, 0.0, 0.0]) - vel], [-place], [[0.0] * 3], [0.0] * 3
        )
        found = pid.update(wanted, [0, 0, 0], [0, 0, 0], t)
        force = quat_rotate(found.q_nb, np.array([0, 0, -found.thrust_n]))
        vel = vel + step_s * (force / MASS_KG + np.array([0, 0, GRAVITY_M_S2]))
        pos, leader = pos + step_s * vel, leader + step_s * np.array([0.3, 0.0, 0.0])
    assert np.linalg.norm(pos - leader - place) < 0.03
