"""Sensors: noise is as the profile says and seeded per vehicle; heading turns magnetometer and global position only."""

from __future__ import annotations

import numpy as np
import pytest

from arena.geometry import matrix_from_quat, quat_from_euler
from arena.recorder.columns import columns
from arena.schema.profile import Sensors
from arena.sim.sensors import SENSORS, Channel, GlobalOrigin, Motion, Sensor, SensorSuite, Site
from arena.wire.hil import HilMessage

from .sim_slices import vehicle

N = 5000
LISBON = GlobalOrigin(lat_deg=38.7, lon_deg=-9.1, alt_m=100.0)
NO_IMU = {"accel_noise_m_s2": 0, "accel_bias_m_s2": 0, "gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0}
QUIET = {
    "imu": NO_IMU,
    "baro": {"noise_m": 0, "bias_m": 0},
    "mag": {"noise_gauss": 0, "bias_gauss": 0},
    "gps": {"horizontal_noise_m": 0, "vertical_noise_m": 0, "velocity_noise_m_s": 0},
}


def sensors(*vehicles, seed=1, heading_deg=0.0, origin=None, table=SENSORS):
    return SensorSuite(
        table,
        [v["profile"] for v in vehicles],
        [v["id"] for v in vehicles],
        seed=seed,
        site=Site(heading_rad=np.radians(heading_deg), origin=origin),
    )


def motion(vehicles=1, **changes):
    """Vehicles that stand level and fall freely, with some values changed."""
    zero = np.zeros((vehicles, 3))
    level = np.broadcast_to(np.eye(3), (vehicles, 3, 3))
    return Motion(**{"accel_b": zero, "omega_b": zero, "r_nb": level, "p_n": zero, "v_n": zero, **changes})


def still(made, count, vehicles=1):
    """Return `count` samples of vehicles in free fall: nothing but noise and bias on the IMU."""
    samples = [made.sample(motion(vehicles)) for _ in range(count)]
    return {key: np.array([s[key] for s in samples]) for key in samples[0]}


def test_white_noise_has_the_profiles_deviation_and_bias():
    made = sensors(vehicle())
    drawn = still(made, N)
    for key, sigma, at in (("accel_b", 0.03, slice(0, 3)), ("gyro_b", 0.003, slice(3, 6))):
        assert drawn[key].std(axis=0)[0] == pytest.approx([sigma] * 3, rel=0.05)
        assert drawn[key].mean(axis=0)[0] == pytest.approx(
            made.biases()["imu"][0, at], abs=5 * sigma / N**0.5
        )
    assert drawn["baro_alt_m"].std() == pytest.approx(0.1, rel=0.05)
    lag_one = np.corrcoef(drawn["gyro_b"][:-1, 0, 0], drawn["gyro_b"][1:, 0, 0])[0, 1]
    assert abs(lag_one) < 0.05


def test_biases_over_many_seeds_have_the_profiles_deviation():
    biases = np.array([sensors(vehicle(), seed=seed).biases()["imu"][0] for seed in range(300)])
    assert biases.std(axis=0) == pytest.approx([0.05] * 3 + [0.003] * 3, rel=0.2)


def test_another_vehicle_changes_no_noise():
    alone = still(sensors(vehicle("b", 7)), 600)
    among = still(sensors(vehicle("a", 2), vehicle("b", 7), vehicle("c", 9)), 600, 3)
    for key in alone:
        assert (alone[key][:, 0] == among[key][:, 1]).all()
        assert (among[key][:, 0] != among[key][:, 2]).any()


def test_samples_are_not_views_of_one_another():
    made = sensors(vehicle())
    first = made.sample(motion())
    kept = first["accel_b"].copy()
    made.sample(motion())
    assert (first["accel_b"] == kept).all()


def test_an_impact_saturates_the_accelerometer_at_16_g():
    made = sensors(vehicle(sensors=QUIET))
    sensed = made.sample(motion(accel_b=np.array([[0, 0, -400.0]])))
    assert sensed["accel_b"][0, 2] == pytest.approx(-156.9)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -130.0])
def test_magnetometer_yaw_is_body_yaw_plus_heading(heading_deg):
    made = sensors(vehicle(sensors=QUIET), heading_deg=heading_deg)
    yaw = 0.6
    r_nb = matrix_from_quat(quat_from_euler([0.2, -0.1, yaw]))[None]
    mag_b = made.sample(motion(r_nb=r_nb))["mag_b"][0]
    level = matrix_from_quat(quat_from_euler([0.2, -0.1, 0.0])) @ mag_b
    true_yaw = np.arctan2(-level[1], level[0])
    assert np.exp(1j * true_yaw) == pytest.approx(np.exp(1j * (yaw + np.radians(heading_deg))))
    assert level[2] > 0, "the field dips down in the northern hemisphere"
    assert np.linalg.norm(mag_b) == pytest.approx(0.48)


def test_global_position_follows_origin_and_heading():
    made = sensors(vehicle(sensors=QUIET), heading_deg=90.0, origin=LISBON)
    p_n, v_n = np.array([[111.19, 0.0, -3.0]]), np.array([[2.0, 0.0, 0.5]])
    found = made.sample(motion(p_n=p_n, v_n=v_n), ("gps",))
    assert found["baro_alt_m"][0] == pytest.approx(103.0)
    assert found["lat_deg"][0] == pytest.approx(38.7, abs=1e-9), "the arena's north points east"
    assert found["lon_deg"][0] == pytest.approx(-9.1 + 0.001 / np.cos(np.radians(38.7)), abs=1e-6)
    assert found["alt_m"][0] == pytest.approx(103.0)
    assert found["v_true_n"][0] == pytest.approx([0.0, 2.0, 0.5], abs=1e-9)


def test_gps_error_wanders_with_a_60_s_correlation():
    gps = {"horizontal_noise_m": 0.8, "vertical_noise_m": 1.8, "velocity_noise_m_s": 0.1, "rate_hz": 10}
    fleet = [vehicle(f"uav{k}", k, sensors=QUIET | {"gps": gps}) for k in range(1, 41)]
    made = sensors(*fleet, origin=LISBON)
    alt = np.array([made.sample(motion(40), ("gps",))["alt_m"] for _ in range(1500)])
    assert alt.std() == pytest.approx(1.8, rel=0.2)  # a hundred times its correlation time
    assert np.diff(alt, axis=0).std() == pytest.approx(1.8 * np.sqrt(2 * 0.1 / 60), rel=0.03)


def test_without_an_origin_there_is_no_gps():
    assert "lat_deg" not in sensors(vehicle()).sample(motion(), ("gps",))


class Rangefinder(Sensor):
    """A sensor that this project does not have: height above the floor [m]."""

    stream = 3
    channels = (Channel(axes=1, noise="noise_m", default_noise=0.01, range="range_m", default_range=4.0),)
    readings = ("range_m",)
    on_request = False
    log_columns = ()
    hil = HilMessage(name="range", every=5, reading="range_m", pack=lambda *_: b"")

    def __init__(self, profiles, site):
        pass

    def sample(self, noise, motion):
        height = noise[:, 0]
        height += -motion.p_n[:, 2]
        return {"range_m": height}


def test_a_new_sensor_needs_one_table_row_and_changes_no_other():
    own = vehicle(sensors={**vehicle()["profile"]["sensors"], "range": {"noise_m": 0.1, "range_m": 3.0}})
    more = still(sensors(own, table={"range": Rangefinder, **SENSORS}), N)
    for key, values in still(sensors(vehicle()), N).items():
        assert (more[key] == values).all()
    assert more["range_m"].std() == pytest.approx(0.1, rel=0.05)
    far = motion(p_n=np.array([[0.0, 0.0, -9.0]]))
    assert sensors(own, table={"range": Rangefinder}).sample(far)["range_m"] == [3.0]


def test_every_sensor_has_its_profile_keys_and_log_columns():
    keys = {name: field.annotation.model_fields for name, field in Sensors.model_fields.items()}
    assert set(keys) == set(SENSORS)
    log = columns(simulated=True)
    for name, sensor in SENSORS.items():
        assert set(keys[name]) - {"rate_hz"} <= {
            key for c in sensor.channels for key in (c.noise, c.bias, c.range) if key
        }
        for column in sensor.log_columns:
            assert any(each.startswith(f"{column}.") for each in log), column
