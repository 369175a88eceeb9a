"""Sensors: noise is as the profile says and seeded per vehicle; heading turns magnetometer and global position only."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from arena.flight_log.columns import columns
from arena.geometry import matrix_from_quat, quat_from_euler
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


def sensors(*vehicles, seed=1, heading_deg=0.0, origin=None, table=SENSORS, hz=250):
    return SensorSuite(
        table,
        [v["profile"] for v in vehicles],
        [v["id"] for v in vehicles],
        seed=seed,
        site=Site(heading_rad=np.radians(heading_deg), origin=origin),
        period_s=1 / hz,
    )


def motion(vehicles=1, **changes):
    """Vehicles that stand level and fall freely, with some values changed."""
    zero = np.zeros((vehicles, 3))
    level = np.tile(np.eye(3), (vehicles, 1, 1))
    rotors = {"spin": np.zeros((vehicles, 4)), "hover": np.full(vehicles, 0.5)}
    vectors = {"accel_b": zero, "omega_b": zero, "p_n": zero, "v_n": zero}
    return Motion(**{**vectors, **rotors, "r_nb": level, **changes})


def still(made, count, vehicles=1):
    """Return `count` samples of vehicles in free fall: nothing but noise and bias on the IMU."""
    samples = [copy.deepcopy(made.sample(motion(vehicles))) for _ in range(count)]
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


@pytest.mark.parametrize("hz", [50, 250, 1000])
def test_density_of_the_noise_does_not_depend_on_the_sensor_rate(hz):
    drawn = still(sensors(vehicle(), hz=hz), N)
    densities = {
        key: drawn[key].std(axis=0).mean() / hz**0.5 for key in ("accel_b", "gyro_b", "baro_alt_m", "mag_b")
    }
    at_250 = {"accel_b": 0.03, "gyro_b": 0.003, "baro_alt_m": 0.1, "mag_b": 0.004}
    assert densities == pytest.approx({key: sigma / 250**0.5 for key, sigma in at_250.items()}, rel=0.05)


@pytest.mark.parametrize("hz", [250, 1000])
def test_bias_walks_with_the_square_root_of_the_time(hz):
    walk = {"accel_bias_walk_m_s2_per_sqrt_s": 0.02, "gyro_bias_walk_rad_s_per_sqrt_s": 0.001}
    fleet = [vehicle(f"uav{k}", k, sensors=QUIET | {"imu": NO_IMU | walk}) for k in range(1, 101)]
    drawn = still(sensors(*fleet, hz=hz), 4 * hz, len(fleet))
    for key, each in (("accel_b", 0.02), ("gyro_b", 0.001)):
        assert drawn[key][-1].std() == pytest.approx(2.0 * each, rel=0.2)  # after 4 s
        assert drawn[key][hz - 1].std() == pytest.approx(each, rel=0.2)


def test_walking_bias_of_one_vehicle_changes_no_other_noise():
    walk = {"accel_bias_walk_m_s2_per_sqrt_s": 0.02}
    own = vehicle()["profile"]["sensors"]
    walking = vehicle(sensors=own | {"imu": own["imu"] | walk})
    quiet, walked = (still(sensors(v, vehicle("b", 2)), 600, 2) for v in (vehicle(), walking))
    for key in quiet:
        same = quiet[key] == walked[key]
        assert same[:, 1].all()
        assert same[:, 0].all() == (key != "accel_b")


def test_rotors_vibrate_with_the_square_of_their_speed():
    keys = {"accel_vibration_m_s2": 2.0, "gyro_vibration_rad_s": 0.1, "vibration_hz": 40.0}
    own = vehicle(sensors=QUIET | {"imu": NO_IMU | keys})
    rms = {}
    for share in (0.0, 1.0, 0.5):
        made, spin = sensors(own, hz=1000), np.full((1, 4), 0.5 * share)
        drawn = [copy.deepcopy(made.sample(motion(spin=spin))) for _ in range(1000)]
        accel, gyro = (np.array([d[key][0] for d in drawn]) for key in ("accel_b", "gyro_b"))
        rms[share] = [*accel.std(axis=0), *gyro.std(axis=0)]
        spectrum = np.abs(np.fft.rfft(accel[:, 0]))
        assert share == 0.0 or np.argmax(spectrum) == 40.0 * share  # Hz: the series is 1 s long
    assert rms[0.0] == [0.0] * 6
    assert rms[1.0] == pytest.approx([2.0] * 3 + [0.1] * 3, rel=1e-3)
    assert rms[0.5] == pytest.approx([0.5] * 3 + [0.025] * 3, rel=1e-3)


def test_biases_over_many_seeds_have_the_profiles_deviation():
    biases = np.array([sensors(vehicle(), seed=seed).biases()["imu"][0] for seed in range(300)])
    assert biases.std(axis=0) == pytest.approx([0.05] * 3 + [0.003] * 3, rel=0.2)


def test_another_vehicle_changes_no_noise():
    alone = still(sensors(vehicle("b", 7)), 600)
    among = still(sensors(vehicle("a", 2), vehicle("b", 7), vehicle("c", 9)), 600, 3)
    for key in alone:
        assert (alone[key][:, 0] == among[key][:, 1]).all()
        assert (among[key][:, 0] != among[key][:, 2]).any()


def test_sensors_of_a_sample_do_not_share_values_with_the_noise_of_the_next_one():
    made, again = sensors(vehicle()), sensors(vehicle())
    for _ in range(300):  # more than one block of noise
        made.sample(motion())["accel_b"][:] = np.nan  # a user of the readings changes them
        expected = again.sample(motion())
    assert np.isnan(made.sample(motion())["accel_b"]).sum() == 0
    assert (made.sample(motion())["gyro_b"] != expected["gyro_b"]).all()


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
    assert np.linalg.norm(mag_b) == pytest.approx(0.48, abs=1e-3)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0])
def test_magnetic_field_is_that_of_the_origin(heading_deg):
    """In Lisbon the field points 1.2 deg west of true north and 52.6 deg down, with 0.44 gauss; in Sydney up."""
    made = sensors(vehicle(sensors=QUIET), heading_deg=heading_deg, origin=LISBON)
    field = made.sample(motion())["mag_b"][0]
    declination = np.degrees(np.arctan2(field[1], field[0])) + heading_deg
    assert declination == pytest.approx(-1.15, abs=0.02)
    assert np.degrees(np.arctan2(field[2], np.hypot(*field[:2]))) == pytest.approx(52.6, abs=0.1)
    assert np.linalg.norm(field) == pytest.approx(0.440, abs=1e-3)
    sydney = GlobalOrigin(lat_deg=-33.9, lon_deg=151.2, alt_m=20.0)
    assert sensors(vehicle(sensors=QUIET), origin=sydney).sample(motion())["mag_b"][0, 2] < -0.5


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
    alt = np.array([made.sample(motion(40), ("gps",))["alt_m"].copy() for _ in range(1500)])
    assert alt.std() == pytest.approx(1.8, rel=0.2)  # a hundred times its correlation time
    assert np.diff(alt, axis=0).std() == pytest.approx(1.8 * np.sqrt(2 * 0.1 / 60), rel=0.03)


def test_without_an_origin_there_is_no_gps():
    assert "lat_deg" not in sensors(vehicle()).sample(motion(), ("gps",))


class Rangefinder(Sensor):
    """A sensor that this project does not have: height above the floor [m]."""

    stream = 5
    channels = (Channel(axes=1, noise="noise_m", default_noise=0.01, range="range_m", default_range=4.0),)
    readings = ("range_m",)
    on_request = False
    log_columns = ()
    hil = HilMessage(name="range", every=5, reading="range_m", pack=lambda *_: b"")

    def __init__(self, profiles, site, period_s):
        pass

    def views(self, values):
        return {"range_m": values[:, 0]}

    def measure(self, values, motion):
        values[:, 0] -= motion.p_n[:, 2]


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
        vibration = (
            {"accel_vibration_m_s2", "gyro_vibration_rad_s", "vibration_hz"} if name == "imu" else set()
        )
        assert set(keys[name]) - {"rate_hz"} - vibration <= {
            key for c in sensor.channels for key in (c.noise, c.bias, c.walk, c.range) if key
        }
        for column in sensor.log_columns:
            assert any(each.startswith(f"{column}.") for each in log), column
    assert len({sensor.stream for sensor in SENSORS.values()}) == len(SENSORS), "one random stream each"
