"""Values in the ULog records: formulas against numpy, and equal bytes of the compiled and the interpreted kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flight import PROFILE, Flight
from test_ulog_recorder import Memory, topic

from arena.autopilot import Autopilots
from arena.autopilot.navigation.mission_items import Origin
from arena.autopilot.ulog import layout, quantities
from arena.autopilot.ulog.message_formats import FORMATS
from arena.autopilot.ulog.recorder import UlogRecorder
from arena.geometry import globe_from_local, yaw_from_quat
from arena.kernels.standard_atmosphere import pressure_hpa
from arena.kernels.ulog_quantities import COLUMNS, GROUPS, SIZES
from arena.wire.ulog_messages import record_type
from tests.kernels.kernel_versions import interpreted_modules, needs_compiled

VEHICLES, STEPS = 3, 250
ORIGIN = Origin(38.7, -9.1, 100.0, 0.4)
POSITION, RATE = 3, 1


class Rig:
    """Autopilots of three vehicles, with 4, 6 and 14 rotors, in a random state. The first has no origin, the last is disarmed."""

    def __init__(self, seed: int = 1) -> None:
        settings = Flight(VEHICLES).settings
        for vehicle, count in zip(settings["vehicles"], (4, 6, 14), strict=True):
            rotors = [rotor(k, count) for k in range(count)]
            vehicle["profile"] = {**PROFILE, "num_rotors": count, "rotors": rotors}
            vehicle["params"]["SDLOG_MODE"] = 2
        self.pilots, self.rng, self.now = Autopilots(settings, 0.004), np.random.default_rng(seed), 5.0
        for v in self.pilots.vehicles:
            v.origin, v.commander.armed = (ORIGIN if v.row else None), v.row < 2
        self.sensors: dict[str, Any] = {}

    def recorder(self) -> tuple[UlogRecorder, Memory]:
        """Return a new recorder, with a log of each vehicle that has begun."""
        memory = Memory()
        recorder = UlogRecorder(self.pilots, memory)
        recorder.decide(self.now, range(len(self.pilots.vehicles)))
        return recorder, memory

    def change(self) -> None:
        """Set a new random state of all vehicles."""
        self.now += 0.004
        p, rng = self.pilots, self.rng
        est, sp, cascade = p.est, p.sp, p.cascade
        given = (
            est.p_n,
            est.v_n,
            est.a_n,
            est.omega_b,
            est.force_b,
            est.innovation,
            est.gyro_bias,
            est.accel_bias,
        )
        given += (est.sensed_accel_b, est.sensed_gyro_b, est.q_nb, est.r_nb, cascade.q_sp, cascade.omega_sp)
        given += (
            cascade.position.v_sp_n,
            cascade.position.a_sp_n,
            cascade.position.thrust_n,
            cascade.rate.integral,
        )
        given += (p.allocator.torque, p.allocator.thrust, p.motors, p.consumed_mah, est.test_ratio)
        for values in given:
            values[...] = rng.normal(0, 3, values.shape)
        for values in (sp.p_n, sp.v_n, sp.a_n, sp.yaw, sp.yaw_rate):
            values[...] = np.where(rng.random(values.shape) < 0.4, np.nan, rng.normal(0, 3, values.shape))
        for values in (est.cov, est.innovation_var):
            values[...] = rng.random(values.shape)
        for values in (est.last_xy, est.last_z, est.last_yaw, est.last_baro):
            values[...] = self.now - 0.4 * rng.random(VEHICLES)
        for mask in (est.aligned, p.land.landed, p.land.at_rest, p.takeoff.flying):
            mask[...] = rng.random(VEHICLES) < 0.5
        cascade.saturated[...] = rng.integers(-1, 2, (VEHICLES, 3)) * (rng.random((VEHICLES, 3)) < 0.2)
        est.reset_counter[...], sp.level[...] = rng.integers(0, 1000, VEHICLES), rng.integers(0, 4, VEHICLES)
        for v in p.vehicles:
            s = v.inputs
            s.aligned, s.xy_valid, s.z_valid, s.yaw_valid = (rng.random(4) < 0.5).tolist()
        names = ("baro_alt_m", "battery_v", "battery_current_a", "battery_remaining")
        self.sensors = {name: rng.random(VEHICLES) for name in names} | {"mag_b": rng.random((VEHICLES, 3))}


def rotor(k: int, count: int) -> dict[str, Any]:
    angle = 2.0 * math.pi * k / count
    return {
        "position_m": [0.3 * math.cos(angle), 0.3 * math.sin(angle), 0.0],
        "direction": "cw" if k % 2 else "ccw",
    }


@pytest.fixture(scope="module")
def logged() -> tuple[Rig, Memory]:
    """A second in which the state does not change, and its logs."""
    rig = Rig()
    rig.change()
    rig.pilots.sp.level[:] = POSITION, POSITION, RATE
    rig.pilots.sp.yaw[:] = np.nan
    recorder, memory = rig.recorder()
    for _ in range(STEPS):
        recorder.step(rig.now, rig.sensors)
    recorder.close()
    return rig, memory


def last(logged: tuple[Rig, Memory], i: int, name: str) -> dict[str, float]:
    """Return the fields of the last record of a topic of vehicle i."""
    return {field: values[-1] for field, values in topic(logged[1].read(f"uav{i + 1}"), name).items()}


def vector(record: dict[str, float], name: str, count: int) -> list[float]:
    return [record[f"{name}[{k}]"] for k in range(count)]


def test_global_position_is_that_of_the_origin(logged: tuple[Rig, Memory]) -> None:
    p_n = logged[0].pilots.est.p_n
    for i, v in enumerate(logged[0].pilots.vehicles):
        found, local = last(logged, i, "vehicle_global_position"), last(logged, i, "vehicle_local_position")
        assert found["lat_lon_valid"] == (i > 0 and v.inputs.xy_valid)
        assert local["xy_global"] == (i > 0) and local["xy_valid"] == v.inputs.xy_valid
        if i > 0:
            expected = globe_from_local(ORIGIN.lat, ORIGIN.lon, p_n[i, 0], p_n[i, 1], ORIGIN.heading)
            assert (found["lat"], found["lon"]) == expected
            assert found["alt"] == np.float32(ORIGIN.alt - p_n[i, 2])
            assert (local["ref_lat"], local["ref_lon"]) == (ORIGIN.lat, ORIGIN.lon)
        else:
            assert np.isnan(
                [found["lat"], found["lon"], found["alt"], local["ref_lat"], local["ref_alt"]]
            ).all()


def test_accuracies_are_roots_of_the_variances(logged: tuple[Rig, Memory]) -> None:
    for i in range(VEHICLES):
        variance = np.diag(logged[0].pilots.est.cov[i])
        record = last(logged, i, "vehicle_local_position")
        expected = (variance[:2].sum(), variance[2], variance[3:5].sum(), variance[5])
        assert [record[name] ** 2 for name in ("eph", "epv", "evh", "evv")] == pytest.approx(expected)
        assert (record["heading_var"], record["tilt_var"]) == pytest.approx(
            (variance[8], variance[6:8].sum())
        )
        states = last(logged, i, "estimator_states")
        order = (6, 7, 8, 3, 4, 5, 0, 1, 2, *range(9, 15))
        assert vector(states, "covariances", 15) == pytest.approx(variance[list(order)])


def test_position_controller_that_does_not_run_has_no_setpoint(logged: tuple[Rig, Memory]) -> None:
    cascade = logged[0].pilots.cascade
    for i in range(VEHICLES):
        record = last(logged, i, "vehicle_local_position_setpoint")
        found = [record["vx"], record["vy"], record["vz"], *vector(record, "acceleration", 3), record["yaw"]]
        expected = [
            *cascade.position.v_sp_n[i],
            *cascade.position.a_sp_n[i],
            float(yaw_from_quat(cascade.q_sp[i])),
        ]
        assert found == pytest.approx([math.nan] * 7 if i == 2 else expected, nan_ok=True)


def test_motors_are_nan_for_missing_rotors_and_disarmed_vehicles(logged: tuple[Rig, Memory]) -> None:
    motors = logged[0].pilots.motors.astype(np.float32)
    for i, shown in enumerate((4, 6, 0)):
        found = vector(last(logged, i, "actuator_motors"), "control", 12)
        assert found[:shown] == motors[i, :shown].tolist() and np.isnan(found[shown:]).all()


def test_measurements_and_warning_of_the_battery_are_logged(logged: tuple[Rig, Memory]) -> None:
    rig = logged[0]
    for i in range(VEHICLES):
        height, left = rig.sensors["baro_alt_m"][i], rig.sensors["battery_remaining"][i]
        air, battery = last(logged, i, "vehicle_air_data"), last(logged, i, "battery_status")
        assert air["baro_pressure_pa"] == np.float32(100.0 * pressure_hpa(height))
        assert air["rho"] == pytest.approx(1.225, abs=0.001)
        assert vector(last(logged, i, "vehicle_magnetometer"), "magnetometer_ga", 3) == pytest.approx(
            rig.sensors["mag_b"][i]
        )
        limits = [rig.pilots.params[name][i] for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")]
        assert battery["warning"] == sum(left <= limit for limit in limits)
        assert battery["discharged_mah"] == np.float32(rig.pilots.consumed_mah[i])


def test_flags_of_the_estimator_are_those_of_px4(logged: tuple[Rig, Memory]) -> None:
    rig, est = logged[0], logged[0].pilots.est
    lasts = {12: est.last_xy, 13: est.last_yaw, 14: est.last_z, 9: est.last_baro}
    for i, v in enumerate(rig.pilots.vehicles):
        record, s = last(logged, i, "estimator_status"), v.inputs
        bits = sum(1 << bit for bit, at in lasts.items() if est.aligned[i] and rig.now - at[i] < 0.2)
        bits += 3 * est.aligned[i] + (rig.pilots.land.at_rest[i] << 26)
        bits += (rig.pilots.takeoff.flying[i] & ~rig.pilots.land.landed[i]) << 7
        assert record["control_mode_flags"] == bits
        expected = s.aligned + (266 + 16 * (i > 0)) * s.xy_valid + 36 * s.z_valid
        assert record["solution_status_flags"] == expected
        flags = last(logged, i, "estimator_status_flags")
        assert flags["reject_yaw"] == (est.test_ratio[i, 1] > 1.0)
        assert flags["cs_ev_pos"] == bool(bits & 1 << 12)


def test_test_ratios_are_squares_divided_by_gates(logged: tuple[Rig, Memory]) -> None:
    est, params = logged[0].pilots.est, logged[0].pilots.params
    gates = params.columns("EKF2_EVP_GATE", "EKF2_EVP_GATE", "EKF2_EVP_GATE", "EKF2_HDG_GATE")
    expected = est.innovation**2 / (est.innovation_var * gates**2)
    for i in range(VEHICLES):
        record = last(logged, i, "estimator_innovation_test_ratios")
        found = [*vector(record, "ev_hpos", 2), record["ev_vpos"], record["heading"]]
        assert found == pytest.approx(np.where(np.isfinite(expected[i]), expected[i], math.nan), nan_ok=True)


def test_innovation_without_variance_has_the_ratio_nan_or_infinite() -> None:
    """So it is before the first pose."""
    rig = Rig()
    rig.pilots.est.innovation[:] = (0.0, 2.0, math.nan, 0.0)
    rig.pilots.est.innovation_var[:] = 0.0
    recorder, memory = rig.recorder()
    for _ in range(STEPS):
        recorder.step(rig.now, ZERO_SENSORS)
    recorder.close()
    found = topic(memory.read(), "estimator_innovation_test_ratios")
    assert np.isnan(found["ev_hpos[0]"]).all() and np.isinf(found["ev_hpos[1]"]).all()
    assert np.isnan(found["ev_vpos"]).all()


ZERO_SENSORS = {
    **{
        name: np.zeros(VEHICLES)
        for name in ("baro_alt_m", "battery_v", "battery_current_a", "battery_remaining")
    },
    "mag_b": np.zeros((VEHICLES, 3)),
}


def test_columns_of_the_quantities_do_not_overlap() -> None:
    assert sum(len(group) for group in GROUPS.values()) == len(SIZES)
    ends = [COLUMNS[name] + size for name, size in SIZES.items()]
    assert list(COLUMNS.values()) == [0, *ends[:-1]]


@pytest.mark.parametrize(("name", "count"), [("xyz", 2), ("xyz[1]", 3), ("timestamp", 2)])
def test_field_with_another_number_of_values_is_refused(name: str, count: int) -> None:
    kind = record_type(FORMATS["vehicle_acceleration"])
    assert layout._place_in_record(kind, "xyz", 3) == (21, 4, True)
    assert layout._place_in_record(kind, "xyz[1]", 1) == (25, 4, True)
    assert layout._place_in_record(kind, "timestamp", 1) == (5, 8, False)
    with pytest.raises(ValueError, match=f"expected {count}"):
        layout._place_in_record(kind, name, count)


@needs_compiled
def test_compiled_and_interpreted_kernels_write_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(seed=4)
    compiled, logs = rig.recorder()
    modules = interpreted_modules("ulog_quantities", "ulog_records")
    monkeypatch.setattr(quantities, "UlogQuantities", modules["ulog_quantities"].UlogQuantities)
    monkeypatch.setattr(layout, "UlogRecords", modules["ulog_records"].UlogRecords)
    interpreted, same = rig.recorder()
    for _ in range(STEPS + 50):
        rig.change()
        for recorder in (compiled, interpreted):
            recorder.step(rig.now, rig.sensors)
    for recorder in (compiled, interpreted):
        recorder.close()
    assert len(logs.logs["uav3"][0]) > 30_000
    assert logs.logs == same.logs
