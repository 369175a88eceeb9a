"""Captured attitude against accelerometer and gyroscope: wrong axes and wrong bodies are found. review fault 2"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from arena.constants import GRAVITY_M_S2
from arena.fcu_link.pose_consistency import PoseConsistency
from arena.geometry import quat_conj, quat_from_euler, quat_multiply, quat_rotate

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def turned(roll_deg: float = 0.0, pitch_deg: float = 0.0, yaw_deg: float = 0.0):
    return quat_from_euler(np.radians([roll_deg, pitch_deg, yaw_deg]))


def still(_: float):
    return turned(yaw_deg=20.0)


def carried(t: float):
    """Attitude of a vehicle that somebody tilts and turns by hand."""
    return turned(25.0 * math.sin(1.9 * t), 30.0 * math.sin(1.3 * t + 0.4), 40.0 * math.sin(0.8 * t))


class Bench:
    """A vehicle that moves as `truth`, captured as a body that moves as `body` and whose axes are turned by `axes`."""

    def __init__(self, truth=still, body=None, axes=LEVEL, *, required=True, late_s=0.02, noise_deg=0.05):
        self.checks = PoseConsistency(10.0, imu_required=required)
        self._truth, self._body, self._axes = truth, body or truth, axes
        self._late_s, self._noise = late_s, math.radians(noise_deg)
        self._rng = np.random.default_rng(1)
        self.now = 0.0

    def run(self, seconds: float, *, imu: bool = True):
        end = self.now + seconds
        while self.now < end:
            self.now += 1.0 / 60.0
            noise = quat_from_euler(self._rng.normal(0.0, self._noise, 3))
            q = quat_multiply(quat_multiply(self._body(self.now - self._late_s), self._axes), noise)
            self.checks.on_attitude(q, self.now)
            if imu and round(60.0 * self.now) % 2 == 0:
                self.checks.on_autopilot(self._imu(), self.now)
        return self.checks.reasons(self.now)

    def _imu(self):
        q, step = self._truth(self.now), 1e-3
        force = quat_rotate(quat_conj(q), np.array([0.0, 0.0, -GRAVITY_M_S2])) + self._rng.normal(
            0.0, 0.05, 3
        )
        after = quat_multiply(quat_conj(q), self._truth(self.now + step))
        gyro = 2.0 * after[1:] / step * math.copysign(1.0, after[0]) + self._rng.normal(0.0, 0.01, 3)
        (ax, ay, az), (gx, gy, gz) = force, gyro
        return SimpleNamespace(
            get_type=lambda: "HIGHRES_IMU", xacc=ax, yacc=ay, zacc=az, xgyro=gx, ygyro=gy, zgyro=gz
        )


@pytest.mark.parametrize("truth", [still, carried])
def test_a_right_body_passes(truth):
    bench = Bench(still)
    assert bench.run(3.0) == []
    bench._truth = bench._body = truth
    assert bench.run(8.0) == []


def test_a_rolled_body_is_found_at_rest():
    assert Bench(axes=turned(roll_deg=60.0)).run(3.0) == ["capture is 60 deg off gravity"]


@pytest.mark.parametrize(("tilt_deg", "found"), [(8.0, False), (13.0, True)])
def test_the_limit_of_the_tilt(tilt_deg, found):
    assert bool(Bench(axes=turned(pitch_deg=tilt_deg)).run(3.0)) is found


def test_a_body_turned_about_the_vertical_is_found_when_it_is_carried():
    bench = Bench(axes=turned(yaw_deg=90.0))
    assert bench.run(3.0) == [], "gravity cannot show it"
    bench._truth = bench._body = carried
    (reason,) = bench.run(8.0)
    assert reason.startswith("captured axes are not the gyro's")


def test_the_body_of_another_vehicle_is_found_when_one_is_carried():
    bench = Bench()
    assert bench.run(3.0) == []
    bench._truth = carried
    assert bench.run(8.0) == ["vehicle turned, its captured body did not"]
    bench._truth, bench._body = still, carried
    assert "captured body turned, the vehicle did not" in bench.run(8.0)


def test_a_wrong_body_stays_refused_after_the_motion():
    bench = Bench()
    bench.run(3.0)
    bench._truth = carried
    bench.run(8.0)
    bench._truth = still
    assert bench.run(5.0) == ["vehicle turned, its captured body did not"]


@pytest.mark.parametrize(
    ("required", "reasons"), [(True, ["no accelerometer data from the autopilot"]), (False, [])]
)
def test_missing_accelerometer_data(required, reasons):
    assert Bench(required=required).run(3.0, imu=False) == reasons


def test_poses_without_accelerometer_data_are_forgotten():
    bench = Bench(required=False)
    bench.run(20.0, imu=False)
    assert len(bench.checks._poses) <= 4.0 * 60 + 2


def test_a_vehicle_that_was_never_still_has_not_been_compared():
    assert Bench(carried).run(2.0) == ["hold the vehicle still to compare tilt"]


def test_each_reason_fits_in_one_statustext():
    for bench in (Bench(axes=turned(roll_deg=170.0)), Bench(required=True)):
        assert all(len(f"{reason}".encode()) <= 50 for reason in bench.run(1.0))
