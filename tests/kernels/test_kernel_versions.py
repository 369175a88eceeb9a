"""Compiled and interpreted kernels give the same results, bit for bit."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from tests.kernels.kernel_versions import arrays_of, compiled_modules, interpreted_modules, needs_compiled

VEHICLES = 7
ESTIMATION = ("strapdown", "error_covariance", "vision_fusion")
BODIES = ("free_flight", "clearance")
PERIOD = ("rotor_dynamics", "free_flight", "flight_period")
CAPTURE = ("truth_interpolation", "pose_measurement")
WATCH = ("battery_discharge", "flight_watch")
CONTROL = ("control_allocation", "position_control", "attitude_control", "rate_control", "cascade")
MOTORS = (
    *ESTIMATION,
    *CONTROL,
    "estimate_validity",
    "barometer_offset",
    "motor_outputs",
    "land_detection",
    "motor_release",
)


def fill(law: object, rng: np.random.Generator, **scales: float) -> None:
    """Fill the named arrays of a kernel with random numbers of these sizes; negative: only positive numbers."""
    for name, scale in scales.items():
        values = arrays_of(law)[name]
        random = rng.normal(size=values.shape)
        values[...] = scale * random if scale > 0 else np.abs(scale * random) + 0.1


@needs_compiled
def test_downwash_and_pressure_are_equal_compiled_and_interpreted() -> None:
    rng = np.random.default_rng(3)
    p_n, r_nb = rng.normal(size=(VEHICLES, 3)) * (0.4, 0.4, 2.0), rng.normal(size=(VEHICLES, 3, 3)) * 0.1
    r_nb[:, 2, 2] = 1.0
    given = [rng.random(VEHICLES) + 0.1 for _ in range(4)]
    given[0][0] = given[1][0] = 0.0  # a vehicle without a jet
    winds, pressures = [], []
    for modules in (compiled_modules, interpreted_modules):
        law = modules("downwash_wind")["downwash_wind"].DownwashWind(*map(memoryview, given))
        assert law.reaches(memoryview(p_n), memoryview(r_nb))
        law.compute(memoryview(p_n), memoryview(r_nb), memoryview(np.full(VEHICLES, 9.0)))
        winds.append(np.array(law.wind_n))
        upright = np.repeat(np.eye(3)[None], VEHICLES, 0)
        assert not law.reaches(memoryview(p_n * (9.0, 9.0, 0.0)), memoryview(upright))
        pressure = modules("standard_atmosphere")["standard_atmosphere"].pressure_hpa
        pressures.append([pressure(height) for height in (-300.0, 0.0, 0.1, 5000.0)])
    assert np.array_equal(*winds) and np.abs(winds[0]).max() > 0.2
    assert pressures[0] == pressures[1] and pressures[0][1] == 1013.25


def random_attitudes(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=(VEHICLES, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def fly_cascade(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Run all controllers and the allocation with random gains, estimates and setpoints. Return all arrays after each step."""
    rng, views = np.random.default_rng(5), modules["control_allocation"]
    position = modules["position_control"].PositionLaw(VEHICLES, 0.008)
    attitude = modules["attitude_control"].AttitudeLaw(VEHICLES)
    rate = modules["rate_control"].RateLaw(VEHICLES, 0.004)
    present = rng.random((VEHICLES, 6)) < 0.8
    weights = rng.normal(size=(VEHICLES, 6, 3)) * present[:, :, None]
    motors = views.ControlAllocation(weights, present)
    cascade = modules["cascade"].CascadeLaw(position, attitude, rate, views.floats(VEHICLES))
    level, given = np.zeros(VEHICLES, int), {n: np.zeros(VEHICLES) for n in ("thrust", "yaw_rate", "feed")}
    q_nb, omega_b = random_attitudes(rng), np.zeros((VEHICLES, 3))
    cascade.read_setpoints_from(level, q_nb, omega_b, given["thrust"], given["yaw_rate"], given["feed"])
    gains = (
        "p",
        "vp",
        "vi_dt",
        "vd",
        "hover",
        "thr_min",
        "thr_max",
        "margin",
        "xy_max",
        "up_max",
        "down_max",
    )
    fill(position, rng, **dict.fromkeys(gains, -0.5), tilt_air=-0.3, low_pass=-0.3)
    fill(attitude, rng, gain=-4.0, yaw_weight=-0.3, rate_limit=-3.0)
    fill(rate, rng, p=-0.1, i_dt=-0.001, d=-0.003, integral_limit=-0.1, low_pass=-0.3)
    seen = []
    for step in range(60):
        level[:] = rng.integers(0, 4, VEHICLES)
        fill(position, rng, sp_p_n=3.0, sp_v_n=3.0, sp_a_n=3.0, sp_yaw=2.0, p_n=2.0, v_n=2.0, tilt_max=-0.5)
        for name in ("sp_p_n", "sp_v_n", "sp_a_n", "sp_yaw"):
            values = arrays_of(position)[name]
            values[rng.random(values.shape) < 0.4] = np.nan
        fill(attitude, rng, r_nb=0.5)
        for values in (q_nb, arrays_of(position)["q_nb"], arrays_of(attitude)["q_nb"]):
            values[:] = random_attitudes(rng)
        fill(rate, rng, omega_b=3.0)
        given["yaw_rate"][:] = np.where(rng.random(VEHICLES) < 0.5, np.nan, 1.0)
        cascade.step(step % 2 == 0)
        arrays_of(motors)["torque"][:] = arrays_of(rate)["torque"]
        arrays_of(motors)["thrust"][:] = arrays_of(cascade)["selected_thrust"]
        motors.step()
        arrays_of(rate)["saturated"][:] = arrays_of(motors)["saturated"]
        for law in (position, attitude, rate, motors):
            seen += [values.copy() for values in arrays_of(law).values()]
    return seen


def fly_estimator(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Run the estimator with random inertial samples and poses, some rejected, some late. Return all arrays after each step."""
    rng = np.random.default_rng(6)
    state = modules["strapdown"].Strapdown(rng.random(VEHICLES) < 0.8, 0.004, 0.02, 20)
    covariance = modules["error_covariance"].ErrorCovariance(
        0.004, 2, state.r_nb, state.force_b, state.omega_b
    )
    control = rng.integers(0, 16, VEHICLES)
    vision = modules["vision_fusion"].VisionFusion(state, covariance, control, np.zeros(VEHICLES, int))
    attitudes = random_attitudes(rng)
    arrays_of(state)["q_nb"][:] = arrays_of(state)["ring_q"][:] = attitudes
    arrays_of(state)["bias_limit"][:] = 0.01
    arrays_of(covariance)["cov"][:] = 0.1 * np.eye(15)
    fill(covariance, rng, growth=-1e-4)
    fill(vision, rng, least_variance=-0.01, gate_squared=-9.0)
    arrays_of(vision)["delay_s"][:] = 0.06 * rng.random(VEHICLES)
    seen = []
    for step in range(100):
        fill(state, rng, sensed_accel_b=3.0, sensed_gyro_b=0.5)
        state.step()
        covariance.step()
        pose = rng.normal(size=(VEHICLES, 11)) * (0.3 if step % 5 else 30.0)
        pose[:, 3:7] = attitudes if step % 3 else np.nan
        for i in range(VEHICLES):
            vision.fuse(i, pose, i, 0.004 * step)
        for law in (state, covariance, vision):
            seen += [values.copy() for values in arrays_of(law).values()]
    return seen


def spin_rotors(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Run the rotors with random commands, airspeeds and heights. Return all arrays after each step."""
    rng = np.random.default_rng(7)
    law = modules["rotor_dynamics"].RotorDynamics(VEHICLES, 6, 64, 32)
    tables = dict.fromkeys(
        ("thrust_table", "speed_table", "ground_table", "ground_scale", "ground_reach"), -1.0
    )
    fill(law, rng, **tables, drag=-0.3, body_drag=-0.1, per_weight=-0.1, spin_up=0.01, wrench=0.5)
    fill(law, rng, rise=-0.2, fall=-0.1, speed_loss=-0.02, supply=-0.5)
    seen = []
    for _ in range(200):
        arrays_of(law)["motors"][:] = rng.random((VEHICLES, 6))
        fill(law, rng, air_b=5.0, height=-1.0)
        law.step()
        seen += [values.copy() for values in arrays_of(law).values()]
    return seen


def fly_freely(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Move bodies with random wrenches, and measure their distances. Return all arrays after each step."""
    rng, free = np.random.default_rng(8), np.ones(VEHICLES, bool)
    law = modules["free_flight"].FreeFlight(free, 0.002)
    fill(law, rng, mass=-1.0, inertia=-0.1, place_w=3.0, speed_w=5.0, rate_w=5.0, wind_n=2.0)
    arrays_of(law)["quat"][:] = random_attitudes(rng)
    boxes = np.array([[6.0, 0.0, 0.0, 0.5, 9.0, 9.0], [0.0, -7.0, 0.0, 9.0, 0.5, 9.0]])
    clearance = modules["clearance"].Clearance(
        free, law.place_w, law.speed_w, np.full(VEHICLES, 0.3), boxes, 0.004
    )
    seen = []
    for step in range(100):
        if step % 2 == 0:
            clearance.check()
            law.begin()
        fill(law, rng, force_b=10.0, torque_b=0.5)
        law.step()
        law.finish()
        seen += [values.copy() for values in arrays_of(law).values()]
    return seen


def watch_flights(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Discharge batteries, and watch random flights. Return all arrays after each step."""
    rng, spin, news = np.random.default_rng(9), np.zeros((VEHICLES, 6)), []
    battery = modules["battery_discharge"].BatteryDischarge(spin)
    fill(battery, rng, idle=-1.0, per_square=-5.0, used_per_a=-1e-4, empty=-10.0, span=-3.0, resistance=-0.1)
    fill(battery, rng, supply_per_volt=0.1, remaining=-0.5)
    arrays_of(battery)["override"][2] = 0.03
    p_n, v_n, r_nb = np.zeros((VEHICLES, 3)), np.zeros((VEHICLES, 3)), np.zeros((VEHICLES, 3, 3))
    floor = np.zeros(VEHICLES, bool)
    watch = modules["flight_watch"].FlightWatch(p_n, v_n, r_nb, floor, 0.004)
    arrays_of(watch)["min_cos_tilt"][:] = 0.5
    seen = []
    for step in range(60):
        spin[:], floor[:] = rng.random(spin.shape), (rng.random(VEHICLES) < 0.02) | (step < 5)
        p_n[:], v_n[:], r_nb[:] = rng.normal(size=p_n.shape), rng.normal(size=v_n.shape), 0.8
        r_nb[:, 2, 2] = 1.0 - 0.2 * rng.random(VEHICLES) ** 2 - 0.5 * (step == 30)
        news.append(np.array([battery.step(), watch.step()], float))
        watch.finish()
        for law in (battery, watch):
            seen += [values.copy() for values in arrays_of(law).values()]
    assert 0.0 < np.mean(news, axis=0)[1] < 1.0
    return seen + news


def detect_landings(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Run land detector and take-off ramp with random motion and setpoints. Return all arrays after each step."""
    rng = np.random.default_rng(10)
    masks = [rng.random(VEHICLES) < 0.5 for _ in range(9)]
    land = modules["land_detection"].LandDetection(*masks[:5])
    ramp = modules["land_detection"].RampLaw(masks[5], masks[0], masks[4], masks[6])
    estimates, setpoints = rng.normal(size=(2, VEHICLES, 3)), rng.normal(size=(2, VEHICLES, 3))
    climb = modules["land_detection"].ClimbRequest(*map(memoryview, estimates), masks[7], masks[8])
    level, thrust = rng.integers(0, 4, VEHICLES), rng.random(VEHICLES)
    climb.read_setpoints_from(*map(memoryview, (level, *setpoints, thrust)))
    fill(climb, rng, thr_min=-0.1, thr_hover=-0.5)
    fill(
        land,
        rng,
        z_vel_max=-0.5,
        xy_vel_max=-2.0,
        rot_max=-1.0,
        thr_min=-0.1,
        thr_hover=-0.5,
        land_speed=-0.5,
    )
    fill(ramp, rng, full=-2.0, full_offboard=-3.0, spoolup_s=-0.2, ramp_s=-0.3, start=2.0, begun=-3.0)
    seen = []
    for step in range(200):
        masks[3][:], masks[4][:] = rng.random((2, VEHICLES)) < 0.3
        fill(land, rng, v_n=0.3, omega_b=0.3, thrust=-0.2, sink=1.0, trigger_s=-0.05)
        arrays_of(land)["force"][:] = 9.8 + rng.normal(size=VEHICLES)
        arrays_of(ramp)["armed_since"][:] = 0.02 * step - rng.random(VEHICLES)
        level[:], thrust[:] = rng.integers(0, 4, VEHICLES), rng.random(VEHICLES)
        estimates[:], setpoints[:] = rng.normal(size=(2, 2, VEHICLES, 3))
        setpoints[rng.random(setpoints.shape) < 0.3] = np.nan
        climb.update()
        for law in (land.step, ramp.update, ramp.limit):
            law(0.02 * step)
        seen.append(masks[8].copy())
        for law in (land, ramp, climb):
            seen += [values.copy() for values in arrays_of(law).values()]
    return seen


def read_sensors(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Add random true values to noise, and limit the sums. Return all results."""
    rng, law = np.random.default_rng(12), modules["sensor_readings"]
    row, most = rng.normal(size=(VEHICLES, 10)), np.full((VEHICLES, 10), 2.0)
    row[2, 4], most[:, 6:] = np.nan, np.inf
    accel_b, omega_b, p_n = rng.normal(size=(3, VEHICLES, 3))
    motion = law.TrueMotion(accel_b, omega_b, rng.normal(size=(VEHICLES, 3, 3)), p_n)
    motion.add_inertial(row[:, 0:6])
    motion.add_field(row[:, 6:9], *rng.normal(size=3))
    motion.add_altitude(row[:, 9:], 100.0)
    law.ReadingLimits(most).limit(row, 10)
    assert np.nanmax(np.abs(row[:, :6])) == 2.0 and np.isnan(row[2, 4])
    return [row]


def fly_periods(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Fly rotors and bodies with random commands. Return all arrays after each sensor period."""
    rng = np.random.default_rng(13)
    rotors = modules["rotor_dynamics"].RotorDynamics(VEHICLES, 4, 64, 32)
    tables = dict.fromkeys(
        ("thrust_table", "speed_table", "ground_table", "ground_scale", "ground_reach"), -1.0
    )
    fill(rotors, rng, **tables, drag=-0.3, body_drag=-0.1, per_weight=-0.1, spin_up=0.01, wrench=0.5)
    fill(rotors, rng, rise=-0.2, fall=-0.1, speed_loss=-0.02)
    bodies = modules["free_flight"].FreeFlight(np.ones(VEHICLES, bool), 0.002)
    fill(bodies, rng, mass=-1.0, inertia=-0.1, place_w=3.0, speed_w=1.0, rate_w=1.0, wind_n=2.0)
    arrays_of(bodies)["quat"][:] = random_attitudes(rng)
    period, seen = modules["flight_period"].FlightPeriod(rotors, bodies), []
    for i in range(VEHICLES):
        bodies.publish(i)
    for _ in range(50):
        arrays_of(rotors)["motors"][:] = rng.random((VEHICLES, 4))
        bodies.begin()
        period.step(2)
        seen += [values.copy() for law in (rotors, bodies) for values in arrays_of(law).values()]
    return seen


def command_motors(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Compute motor commands and the validity of random estimates. Return all arrays after each step."""
    rng = np.random.default_rng(14)
    state = modules["strapdown"].Strapdown(rng.random(VEHICLES) < 0.8, 0.004, 0.02, 20)
    covariance = modules["error_covariance"].ErrorCovariance(
        0.004, 2, state.r_nb, state.force_b, state.omega_b
    )
    vision = modules["vision_fusion"].VisionFusion(
        state, covariance, rng.integers(0, 16, VEHICLES), np.zeros(VEHICLES, int)
    )
    masks = np.zeros((4, VEHICLES), bool)
    validity = modules["estimate_validity"].EstimateValidity(
        state, vision, covariance.cov, np.full(9, 1.5), 1.0, *masks
    )
    position = modules["position_control"].PositionLaw(VEHICLES, 0.008)
    attitude = modules["attitude_control"].AttitudeLaw(VEHICLES)
    rate = modules["rate_control"].RateLaw(VEHICLES, 0.004)
    fill(position, rng, p=-0.5, vp=-0.5, hover=-0.5, thr_max=-0.8, xy_max=-3.0, up_max=-3.0, down_max=-3.0)
    fill(attitude, rng, gain=-4.0, rate_limit=-3.0)
    fill(rate, rng, p=-0.1, d=-0.003, low_pass=-0.3)
    floats = modules["control_allocation"].floats
    cascade = modules["cascade"].CascadeLaw(position, attitude, rate, floats(VEHICLES))
    numbers = [rng.normal(size=VEHICLES) for _ in range(3)]
    level = rng.integers(0, 4, VEHICLES)
    cascade.read_setpoints_from(level, random_attitudes(rng), rng.normal(size=(VEHICLES, 3)), *numbers)
    allocation = modules["control_allocation"].ControlAllocation(
        rng.normal(size=(VEHICLES, 4, 3)), np.ones((VEHICLES, 4), bool)
    )
    outputs = modules["motor_outputs"].MotorOutputs(state, cascade, allocation, 4)
    fill(outputs, rng, idle=-0.1, up_from=-0.1)
    fill(vision, rng, last_xy=-1.0, last_z=-1.0, last_yaw=-1.0)
    fill(validity, rng, timeout_s=-1.0, aligned_at=-0.2, last_baro=-1.0)
    known = np.zeros((2, VEHICLES), bool)
    baro = modules["barometer_offset"].BarometerOffset(state, vision, *known)
    fill(baro, rng, after_s=-0.5)
    stands = rng.random((6, VEHICLES)) < 0.5
    ramp, since = modules["land_detection"].RampLaw(*stands[:4]), rng.random(VEHICLES)
    arrays_of(ramp)["begun"][::2] = np.inf
    release = modules["motor_release"].MotorRelease(
        outputs, ramp, memoryview(level), stands[4], memoryview(since), stands[5], known[0].copy()
    )
    fill(release, rng, spoolup_s=-1.0, tilt_landed=-0.2)
    seen = []
    for step in range(60):
        fill(state, rng, p_n=3.0, v_n=1.0, omega_b=1.0, r_nb=0.5)
        fill(position, rng, sp_p_n=3.0, sp_v_n=3.0, sp_yaw=2.0, tilt_max=-0.5)
        fill(covariance, rng, cov=1.0)
        arrays_of(state)["q_nb"][:] = random_attitudes(rng)
        outputs.step(0.04 * step, step % 2 == 0)
        validity.update(0.04 * step)
        arrays_of(baro)["altitude"][:] = np.where(
            rng.random(VEHICLES) < 0.2, np.nan, rng.normal(size=VEHICLES)
        )
        seen += [masks.copy().astype(float), np.array([baro.update(0.04 * step)], float), known.copy()]
        stands[:], level[:] = rng.random((6, VEHICLES)) < 0.5, rng.integers(0, 4, VEHICLES)
        if step % 3 == 2:
            release.update()
        for law in (outputs, allocation, rate, position, baro, release):
            seen += [values.copy() for values in arrays_of(law).values()]
    assert 0.0 < np.mean([each for each in seen if each.shape == (4, VEHICLES)]) < 1.0
    return seen


def capture_poses(modules: dict[str, ModuleType]) -> list[np.ndarray]:
    """Interpolate between random true states, slow and fast turns, and measure the poses. Return all results."""
    rng, width = np.random.default_rng(11), 24
    law = modules["pose_measurement"].PoseMeasurement((7, 3, 5), np.array([4, 0, 2]), 30, 0.001, 0.01, width)
    fill(law, rng, noise=1.0, offset_n=0.5)
    arrays_of(law)["rotation"][:] = random_attitudes(rng)[:3]
    seen = []
    for frame in range(30):
        before, after = rng.normal(size=(2, 1 + VEHICLES * width))
        before[0], after[0] = 0.004 * frame, 0.004 * (frame + 1)
        found = np.zeros(len(before))
        places = [row[1:].reshape(VEHICLES, width) for row in (before, after, found)]
        places[0][:, 3:7] = random_attitudes(rng)
        near = places[0][:, 3:7] + 0.01 * rng.normal(size=(VEHICLES, 4))
        places[1][:, 3:7] = (
            near / np.linalg.norm(near, axis=1, keepdims=True) if frame % 2 else random_attitudes(rng)
        )
        modules["truth_interpolation"].interpolate(before, after, 0.004 * (frame + 0.3), width, found)
        measured = law.measure(found, frame)
        assert [(body.number, body.tracked) for body in measured] == [(7, True), (3, True), (5, True)]
        seen += [found, np.array([body.position_w + body.quat_xyzw_wf for body in measured])]
    return seen


def assert_equal(first: list[np.ndarray], second: list[np.ndarray]) -> None:
    assert len(first) == len(second) > 0
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_compiled
def test_controllers_and_allocation_give_the_same_bits_compiled_and_interpreted() -> None:
    interpreted = interpreted_modules(*CONTROL)
    assert all(module.__file__.endswith(".py") for module in interpreted.values())
    compiled = compiled_modules(*CONTROL)
    assert all(module.__file__.endswith(".so") for module in compiled.values())
    assert_equal(fly_cascade(interpreted), fly_cascade(compiled))


@needs_compiled
def test_estimator_gives_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(
        fly_estimator(interpreted_modules(*ESTIMATION)), fly_estimator(compiled_modules(*ESTIMATION))
    )


@needs_compiled
def test_rotors_give_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(
        spin_rotors(interpreted_modules("rotor_dynamics")), spin_rotors(compiled_modules("rotor_dynamics"))
    )


@needs_compiled
def test_free_flight_gives_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(fly_freely(interpreted_modules(*BODIES)), fly_freely(compiled_modules(*BODIES)))


@needs_compiled
def test_batteries_and_flight_watch_give_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(watch_flights(interpreted_modules(*WATCH)), watch_flights(compiled_modules(*WATCH)))


@needs_compiled
def test_land_detector_gives_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(
        detect_landings(interpreted_modules("land_detection")),
        detect_landings(compiled_modules("land_detection")),
    )


@needs_compiled
def test_captured_poses_are_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(capture_poses(interpreted_modules(*CAPTURE)), capture_poses(compiled_modules(*CAPTURE)))


@needs_compiled
def test_sensor_readings_are_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(
        read_sensors(interpreted_modules("sensor_readings")),
        read_sensors(compiled_modules("sensor_readings")),
    )


@needs_compiled
def test_periods_of_free_flight_give_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(fly_periods(interpreted_modules(*PERIOD)), fly_periods(compiled_modules(*PERIOD)))


@needs_compiled
def test_motor_commands_and_validity_are_the_same_bits_compiled_and_interpreted() -> None:
    assert_equal(command_motors(interpreted_modules(*MOTORS)), command_motors(compiled_modules(*MOTORS)))


def test_interpreted_kernels_run() -> None:
    assert len(read_sensors(interpreted_modules("sensor_readings"))) == 1
    assert np.isfinite(fly_periods(interpreted_modules(*PERIOD))[-1]).all()
    assert len(command_motors(interpreted_modules(*MOTORS))) > 0
    assert np.isfinite(capture_poses(interpreted_modules(*CAPTURE))[-1]).all()
    assert len(detect_landings(interpreted_modules("land_detection"))) > 0
    assert len(watch_flights(interpreted_modules(*WATCH))) > 0
    assert np.isfinite(fly_freely(interpreted_modules(*BODIES))[-1]).all()
    assert np.isfinite(spin_rotors(interpreted_modules("rotor_dynamics"))[-1]).all()
    assert np.isfinite(fly_cascade(interpreted_modules(*CONTROL))[-1]).all()
    assert np.isfinite(fly_estimator(interpreted_modules(*ESTIMATION))[0]).all()


@needs_compiled
def test_wrong_row_of_a_compiled_kernel_is_an_index_error() -> None:
    """A kernel with a wrong array must not read foreign memory."""
    modules = compiled_modules(*CONTROL)
    law = modules["position_control"].PositionLaw(3, 0.008)
    for name in ("hover", "vp", "thr_max"):
        arrays_of(law)[name][...] = 1.0
    short = modules["control_allocation"].floats(2, 3)
    law.read_setpoints_from(short, short, short, modules["control_allocation"].floats(2))
    with pytest.raises(IndexError):
        law.step()


@needs_compiled
def test_array_that_is_not_set_is_an_index_error() -> None:
    """A compiled kernel does not check whether an array is set: the check of the index finds it."""
    store = compiled_modules("offboard_setpoints")["offboard_setpoints"].OffboardSetpoints(
        memoryview(np.zeros((2, 4)))
    )
    store.level[0] = 3
    with pytest.raises(IndexError):
        store.copy(0)
