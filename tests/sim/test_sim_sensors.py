"""Sensor noise is as the profile says, seeded per vehicle; heading turns the compass and the map, nothing
else.
"""

from __future__ import annotations

import numpy as np
import pytest
from sim_slices import vehicle

from arena.geometry import matrix_from_quat, quat_from_euler
from arena.sim.sensors import Origin, Sensors
from arena.sim.vehicle_arrays import read_fleet

N = 5000
LISBON = Origin(lat_deg=38.7, lon_deg=-9.1, alt_m=100.0)
NO_IMU = {"accel_noise_m_s2": 0, "accel_bias_m_s2": 0, "gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0}
QUIET = {
    "imu": NO_IMU,
    "baro": {"noise_m": 0, "bias_m": 0},
    "mag": {"noise_gauss": 0, "bias_gauss": 0},
    "gps": {"horizontal_noise_m": 0, "vertical_noise_m": 0, "velocity_noise_m_s": 0},
}


def sensors(*vehicles, seed=1, heading_deg=0.0, origin=None):
    return Sensors(read_fleet(list(vehicles)), seed=seed, heading_rad=np.radians(heading_deg), origin=origin)


def still(made, count, vehicles=1):
    """`count` samples of vehicles that stand level and fall freely: nothing but noise and bias on the IMU."""
    zero = np.zeros((vehicles, 3))
    level = np.broadcast_to(np.eye(3), (vehicles, 3, 3))
    samples = [made.sense(accel_b=zero, omega_b=zero, r_nb=level, p_n=zero) for _ in range(count)]
    return {key: np.array([s[key] for s in samples]) for key in samples[0]}


def test_white_noise_has_the_profiles_deviation_and_the_bias_as_its_mean():
    made = sensors(vehicle())
    drawn = still(made, N)
    for key, sigma, columns in (("accel_b", 0.03, slice(0, 3)), ("gyro_b", 0.003, slice(3, 6))):
        assert drawn[key].std(axis=0)[0] == pytest.approx([sigma] * 3, rel=0.05)
        assert drawn[key].mean(axis=0)[0] == pytest.approx(made.bias[0, columns], abs=5 * sigma / N**0.5)
    assert drawn["baro_alt_m"].std() == pytest.approx(0.1, rel=0.05)
    lag_one = np.corrcoef(drawn["gyro_b"][:-1, 0, 0], drawn["gyro_b"][1:, 0, 0])[0, 1]
    assert abs(lag_one) < 0.05


def test_biases_over_many_seeds_have_the_profiles_deviation():
    biases = np.array([sensors(vehicle(), seed=seed).bias[0, 0:6] for seed in range(300)])
    assert biases.std(axis=0) == pytest.approx([0.05] * 3 + [0.003] * 3, rel=0.2)


def test_one_more_vehicle_changes_nobodys_noise():
    alone = still(sensors(vehicle("b", 7)), 600)
    among = still(sensors(vehicle("a", 2), vehicle("b", 7), vehicle("c", 9)), 600, 3)
    for key in alone:
        assert (alone[key][:, 0] == among[key][:, 1]).all()
        assert (among[key][:, 0] != among[key][:, 2]).any()


def test_samples_are_not_views_of_one_another():
    made = sensors(vehicle())
    zero, level = np.zeros((1, 3)), np.eye(3)[None]
    first = made.sense(accel_b=zero, omega_b=zero, r_nb=level, p_n=zero)
    kept = first["accel_b"].copy()
    made.sense(accel_b=zero, omega_b=zero, r_nb=level, p_n=zero)
    assert (first["accel_b"] == kept).all()


def test_an_impact_saturates_the_accelerometer_at_16_g():
    made = sensors(vehicle(sensors=QUIET))
    sensed = made.sense(
        accel_b=np.array([[0, 0, -400.0]]),
        omega_b=np.zeros((1, 3)),
        r_nb=np.eye(3)[None],
        p_n=np.zeros((1, 3)),
    )
    assert sensed["accel_b"][0, 2] == pytest.approx(-156.9)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -130.0])
def test_the_compass_reads_body_yaw_plus_the_arenas_heading(heading_deg):
    made = sensors(vehicle(sensors=QUIET), heading_deg=heading_deg)
    yaw = 0.6
    r_nb = matrix_from_quat(quat_from_euler([0.2, -0.1, yaw]))[None]
    zero = np.zeros((1, 3))
    mag_b = made.sense(accel_b=zero, omega_b=zero, r_nb=r_nb, p_n=zero)["mag_b"][0]
    level = matrix_from_quat(quat_from_euler([0.2, -0.1, 0.0])) @ mag_b
    true_yaw = np.arctan2(-level[1], level[0])
    assert np.exp(1j * true_yaw) == pytest.approx(np.exp(1j * (yaw + np.radians(heading_deg))))
    assert level[2] > 0, "the field dips down in the northern hemisphere"
    assert np.linalg.norm(mag_b) == pytest.approx(0.48)


def test_altitude_and_global_position_follow_the_origin_and_the_heading():
    made = sensors(vehicle(sensors=QUIET), heading_deg=90.0, origin=LISBON)
    p_n, zero = np.array([[111.19, 0.0, -3.0]]), np.zeros((1, 3))
    sensed = made.sense(accel_b=zero, omega_b=zero, r_nb=np.eye(3)[None], p_n=p_n)
    assert sensed["baro_alt_m"][0] == pytest.approx(103.0)
    found = made.gps(p_n=p_n, v_n=np.array([[2.0, 0.0, 0.5]]))
    assert found["lat_deg"][0] == pytest.approx(38.7, abs=1e-9), "the arena's north points east"
    assert found["lon_deg"][0] == pytest.approx(-9.1 + 0.001 / np.cos(np.radians(38.7)), abs=1e-6)
    assert found["alt_m"][0] == pytest.approx(103.0)
    assert found["v_true_n"][0] == pytest.approx([0.0, 2.0, 0.5], abs=1e-9)


def test_a_receivers_position_wanders_as_far_as_its_profile_says_and_no_faster_than_a_receiver_does():
    gps = {"horizontal_noise_m": 0.8, "vertical_noise_m": 1.8, "velocity_noise_m_s": 0.1, "rate_hz": 10}
    made = sensors(vehicle(sensors=QUIET | {"gps": gps}), origin=LISBON)
    zero = np.zeros((1, 3))
    alt = np.array([made.gps(p_n=zero, v_n=zero)["alt_m"][0] for _ in range(60_000)])
    assert alt.std() == pytest.approx(1.8, rel=0.35)  # a hundred times its correlation time
    assert np.diff(alt).std() == pytest.approx(1.8 * np.sqrt(2 * 0.1 / 60), rel=0.03)


def test_without_an_origin_there_is_no_gps():
    assert sensors(vehicle()).gps(p_n=np.zeros((1, 3)), v_n=np.zeros((1, 3))) == {}
