"""Times of the estimator are in seconds: its delays, timeouts and prediction period do not depend on the sensor rate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.estimation.prediction_period import samples_per_prediction
from arena.autopilot.param_table import Params
from arena.builtin_parameters import SPECS
from arena.constants import GRAVITY_M_S2

LEVEL = (1.0, 0.0, 0.0, 0.0)


def estimator(hz: float, **params: float) -> Estimator:
    table = Params(1)
    for name, value in {"EKF2_EV_CTRL": 15, **params}.items():
        table.set(0, name, value)
    return Estimator(table, 1, 1.0 / hz)


def predict(est: Estimator, accel_north: float = 0.0) -> None:
    est.predict(np.array([[accel_north, 0.0, -GRAVITY_M_S2]]), np.zeros((1, 3)))


def see(est: Estimator, now: float, north: float) -> None:
    """Fuse a pose with a noise of 1 mm and 1 mrad."""
    est.vision_input.receive(0, (north, 0.0, 0.0), LEVEL, (1e-6,) * 3, 1e-6)
    est.fuse_vision(now)


@pytest.mark.parametrize("hz", [50, 250, 1000])
@pytest.mark.parametrize("delay_ms", [20.0, SPECS["EKF2_EV_DELAY"].high])
def test_delay_of_poses_is_compensated_at_every_sensor_rate(hz, delay_ms):
    """A vehicle swings north and south by 0.2 m, at 0.6 m/s: poses taken as new would be 0.19 m off."""
    est = estimator(hz, EKF2_EV_DELAY=delay_ms, EKF2_EVP_NOISE=0.01)
    omega, amplitude, worst = math.pi, 0.2, 0.0

    def north(t: float) -> float:
        return amplitude * (1.0 - math.cos(omega * t)) if t > 0.0 else 0.0

    for k in range(8 * hz):
        t = k / hz - 2.0  # stands still for 2 s
        mean = amplitude * omega * (math.sin(omega * t) - math.sin(omega * max(t - 1 / hz, 0.0))) * hz
        predict(est, mean if t > 0.0 else 0.0)
        if k % max(1, hz // 50) == 0:
            # received at any time since the last step, on average half a period ago
            see(est, k / hz, north(t - 0.5 / hz - 1e-3 * delay_ms))
        if t > 2.0:
            worst = max(worst, abs(float(est.p_n[0, 0]) - north(t)))
    assert worst < 0.01
    assert est.rejected[0] == 0


@pytest.mark.parametrize(
    ("baro", "lost_after_s"), [("never", 1.0), ("ends with vision", 1.0), ("ends later", 3.0)]
)
def test_height_is_valid_until_the_last_fused_height_is_older_than_the_timeout(baro, lost_after_s):
    est = estimator(250, EKF2_NOAID_TOUT=1e6)
    valid_s = []
    for k in range(250 * 10):
        now = k / 250
        predict(est)
        if now < 4.0 and k % 5 == 0:
            see(est, now, 0.0)
        if k % 5 == 1:
            heard = {"never": False, "ends with vision": now < 4.0, "ends later": now < 6.0}[baro]
            est.fuse_baro(np.array([100.0 if heard else math.nan]), now)
        if est.z_valid(now)[0]:
            valid_s.append(now)
    assert valid_s[-1] == pytest.approx(4.0 + lost_after_s, abs=0.05)
    assert len(valid_s) == pytest.approx(250 * valid_s[-1], abs=3), "valid without a break"


def test_height_is_not_valid_for_ever_if_the_barometer_is_not_fused():
    est = estimator(250, EKF2_NOAID_TOUT=1e6, EKF2_BARO_CTRL=0)
    for k in range(250 * 8):
        now = k / 250
        predict(est)
        if now < 4.0 and k % 5 == 0:
            see(est, now, 0.0)
        if k % 5 == 1:
            est.fuse_baro(np.array([100.0]), now)
    assert not est.z_valid(8.0)[0]


@pytest.mark.parametrize(
    ("hz", "period_ms"), [(50, 20.0), (100, 10.0), (250, 8.0), (400, 10.0), (500, 10.0), (1000, 10.0)]
)
def test_prediction_period_is_that_of_px4(hz, period_ms):
    """`ImuDownSampler` of PX4 v1.16 with EKF2_PREDICT_US 10000, computed in 32-bit floats."""
    assert samples_per_prediction(1 / hz) / hz == pytest.approx(1e-3 * period_ms)
    single, average = np.float32, np.float32(0.005)
    for _ in range(5000):
        average = single(0.9) * average + single(0.1) * (single(1e6 / hz) * single(1e-6))
    wanted = max(1, math.floor(float(single(0.01) / average) + 0.5))
    assert samples_per_prediction(1 / hz) == wanted


def test_uncertainty_without_poses_grows_alike_at_every_sensor_rate():
    sigma = {}
    for hz in (50, 250, 500, 1000):
        est = estimator(hz, EKF2_ACC_NOISE=1.0)
        for k in range(5 * hz):
            predict(est)
            if k < 3 * hz and k % (hz // 50) == 0:
                see(est, k / hz, 0.0)
        sigma[hz] = float(np.sqrt(est.cov[0, 5, 5])) / math.sqrt(samples_per_prediction(1 / hz) / hz)
    # PX4 adds (noise * period)^2 in each period of 8 to 20 ms; the bias adds the rest.
    assert list(sigma.values()) == pytest.approx([sigma[250]] * 4, rel=0.2)


def test_mean_specific_force_settles_within_seconds_not_steps():
    settled = {}
    for hz in (50, 250, 1000):
        est = estimator(hz)
        for _ in range(hz // 5):
            predict(est, 5.0)
        settled[hz] = float(est._accel_mean[0, 0])
    assert list(settled.values()) == pytest.approx([5.0 * (1 - math.exp(-1.0))] * 3, rel=0.1)
