"""Flights that stress the estimator: hard flight with bad vision, each vehicle with another defect.

Exposures are not synchronised with the sensors, and a pose arrives at the first step after its delay, as in the world's loop. The
exposure times vary by up to half a sensor period, because the filter assumes arrival times that are independent from pose to pose;
with regular exposures the errors average out and position errs by less than is claimed (NEES 0.7 to 0.8). Nothing here depends on
the inside of the estimator: it gets poses, and its outputs are read.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from flight import ARENA, PROFILE
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots
from arena.autopilot.estimation.prediction_period import samples_per_prediction
from arena.geometry import quat_conj, quat_exp, quat_from_euler, quat_log, quat_multiply
from arena.kernels.arrays import array
from arena.sim.world import World

Array = NDArray[np.float64]
Pose = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], float]
Fault = Callable[[Array, Array], tuple[Array, Array]]

APART_M = 12.0
VISION_HZ = 60.0
# What the simulated sensors of PROFILE draw, told to the filter as it is: its claims can then be held against chi-square
# from both sides. (PX4's defaults claim ten times the noise of a good IMU, and a centimetre of a camera system.)
# PX4's noise is that of the mean over a prediction period.
_MEAN = math.sqrt(samples_per_prediction(0.004))
MATCHED = {
    "EKF2_ACC_NOISE": 0.03 / _MEAN,
    "EKF2_GYR_NOISE": 0.003 / _MEAN,
    "EKF2_ACC_B_NOISE": 0.0,
    "EKF2_GYR_B_NOISE": 0.0,
}
AGILE = {"MPC_ACC_HOR_MAX": 10.0, "MPC_ACC_HOR": 5.0, "MPC_XY_P": 1.2, "MC_YAWRATE_MAX": 200.0}


@dataclass(frozen=True, kw_only=True)
class Stress:
    """Defects of one vehicle's vision.

    noise_m, noise_deg: standard deviation of a pose, for each axis [m] [deg]
    delay_ms: time from exposure to arrival [ms]
    lost: share of lost frames 0..1
    gap_s, gap_every_s: length and period of gaps without poses [s]
    matched: the filter assumes the simulated noise, else the parameters of an arena
    noaid_s: EKF2_NOAID_TOUT [s]
    """

    name: str
    noise_m: float = 0.001
    noise_deg: float = 0.1
    delay_ms: float = 20.0
    lost: float = 0.0
    gap_s: float = 0.0
    gap_every_s: float = 4.0
    matched: bool = True
    noaid_s: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Log:
    """Errors of V vehicles over T steps.

    e: truth minus estimate: position [m], velocity [m/s] [NED], yaw [rad] (T, V, 7)
    var: variances of e that the filter claims (T, V, 7)
    tilt: true tilt [rad] (T, V)
    innovations: for each vehicle, normalised north, east, down, yaw, one row for each pose [-] (N, 4)
    """

    e: Array
    var: Array
    tilt: Array
    innovations: list[Array]

    def series(self, i: int) -> dict[str, list[Array]]:
        """Return the normalised errors of vehicle i, one array for each axis, for `judge`."""
        z, y = self.e[:, i] / np.sqrt(self.var[:, i]), self.innovations[i]
        return {
            "position": [*z[:, :3].T],
            "velocity": [*z[:, 3:6].T],
            "yaw": [z[:, 6]],
            "innovation of position": [*y[:, :3].T],
            "innovation of yaw": [y[:, 3]],
        }

    def rms(self, i: int) -> tuple[float, float, float]:
        """Return the rms error of position [m], velocity [m/s] and yaw [rad] for each axis."""
        e = self.e[:, i]
        return tuple(float(np.sqrt(np.mean(x**2))) for x in (e[:, :3], e[:, 3:6], e[:, 6]))  # type: ignore[return-value]


STRESSES = [
    Stress(name="5 ms", delay_ms=5.0),
    Stress(name="20 ms"),
    Stress(name="40 ms", delay_ms=40.0),
    Stress(name="60 ms", delay_ms=60.0),
    Stress(name="5 mm, 0.5 deg", noise_m=0.005, noise_deg=0.5),
    Stress(name="10 % lost", lost=0.1),
    Stress(name="gaps of 0.3 s", gap_s=0.3),
    Stress(name="all of them", noise_m=0.005, noise_deg=0.5, delay_ms=60.0, lost=0.1, gap_s=0.3),
]
AS_ARENA = [replace(s, matched=False, name=f"{s.name}, as an arena") for s in (STRESSES[1], STRESSES[-1])]


# -- faults ------------------------------------------------------------------------------------------------------------


def shifted(*by_n: float) -> Callable[[], Fault]:
    return lambda: lambda p, q: (p + np.array(by_n), q)


def turned(deg: float) -> Callable[[], Fault]:
    turn = quat_from_euler((0.0, 0.0, math.radians(deg)))
    return lambda: lambda p, q: (p, quat_multiply(turn, q))


def frozen() -> Fault:
    first: list[tuple[Array, Array]] = []

    def see(p: Array, q: Array) -> tuple[Array, Array]:
        first.append((p, q))
        return first[0]

    return see


FAULTS: dict[str, Callable[[], Fault]] = {
    "0.5 m north": shifted(0.5, 0.0, 0.0),
    "2 m north": shifted(2.0, 0.0, 0.0),
    "0.5 m down": shifted(0.0, 0.0, 0.5),
    "0.5 m up": shifted(0.0, 0.0, -0.5),
    "90 deg": turned(90.0),
    "180 deg": turned(180.0),
    "frozen": frozen,
}


# -- chi-square --------------------------------------------------------------------------------------------------------


def freedom(z: Array) -> float:
    """Return the degrees of freedom of the mean of z^2. z: normalised errors of one series [-] (T,).

    Independent errors have T. By Bartlett's formula the mean of the squares of a Gaussian series with autocorrelation rho_k has
    the variance 2 / T * (1 + 2 sum rho_k^2), so the degrees of freedom are T over that bracket. The mean is not subtracted, so a
    constant error counts as few samples. The sum ends where the correlation disappears in its noise.
    """
    n = len(z)
    spectrum = np.abs(np.fft.rfft(z, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[:n] / max(float(z @ z), 1e-300)
    gone = np.flatnonzero(rho < 0.05)
    k = int(gone[0]) if len(gone) else n
    return float(n / (1.0 + 2.0 * (rho[1:k] ** 2).sum()))


def bounds(nu: float, alpha: float) -> tuple[float, float]:
    """Return the range of the mean square of nu independent normalised errors, with a chance of 1 - alpha (chi-square).

    Wilson and Hilferty's approximation (1931), accurate to 1 % from 3 degrees of freedom on.
    """
    deviation = NormalDist().inv_cdf(1.0 - alpha / 2.0) * math.sqrt(2.0 / (9.0 * nu))
    return max(0.0, 1.0 - 2.0 / (9.0 * nu) - deviation) ** 3, (1.0 - 2.0 / (9.0 * nu) + deviation) ** 3


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Mean of the squared normalised errors, and its allowed range. low is 0 for a filter that assumes too much noise."""

    what: str
    mean: float
    low: float
    high: float

    @property
    def holds(self) -> bool:
        return self.low <= self.mean <= self.high


def judge(series: dict[str, list[Array]], alpha: float, matched: bool = True) -> list[Verdict]:
    """Compare the normalised errors of each series, one array (T,) for each axis, with their bounds."""
    found = []
    for what, columns in series.items():
        low, high = bounds(sum(freedom(z) for z in columns), alpha)
        mean = float(np.mean(np.concatenate(columns) ** 2))
        found.append(Verdict(what=what, mean=mean, low=low if matched else 0.0, high=high))
    return found


def together(series: Sequence[dict[str, list[Array]]]) -> dict[str, list[Array]]:
    """Return the series of several vehicles as one, to find an error that they share."""
    return {what: [z for one in series for z in one[what]] for what in series[0]}


class StressFlight:
    """Flight with one vehicle for each stress, APART_M apart along east. hz: physics steps per second."""

    def __init__(self, stresses: Sequence[Stress], seed: int = 1, hz: int = 1000) -> None:
        self.stresses, v, self._hz = list(stresses), len(stresses), hz
        rows = [
            {
                "name": f"uav{i + 1}",
                "id": i + 1,
                "profile": PROFILE,
                "position": [0.0, APART_M * i, 0.0],
                "rpy": [0.0, 0.0, 0.0],
                "params": {
                    **ARENA,
                    **AGILE,
                    "EKF2_EV_DELAY": s.delay_ms,
                    "EKF2_NOAID_TOUT": s.noaid_s * 1e6,
                    **(MATCHED if s.matched else {}),
                },
            }
            for i, s in enumerate(stresses)
        ]
        size_m = [400.0, 100.0 + 2 * APART_M * v, 60.0]
        settings = {
            "name": "world",
            "seed": seed,
            "size_m": size_m,
            "heading_deg": 0.0,
            "origin": None,
            "physics_hz": hz,
            "sensor_hz": 250,
            "wind_m_s": [0.0, 0.0, 0.0],
            "vehicles": rows,
        }
        self.world = World(settings)
        self.pilots = Autopilots(settings, self.world.period_s)
        self.est = self.pilots.est
        for i, s in enumerate(stresses):
            if s.matched:  # below the floors that PX4 allows
                self.pilots.params["EKF2_EVP_NOISE"][i] = self.pilots.params["EKF2_EVA_NOISE"][i] = 1e-6
        self.est._read_params()
        self.rng = np.random.default_rng(seed)
        self.home = self.world.truth().p_n.copy()
        self.motors = np.zeros((v, 4))
        self.claimed = np.ones(v)  # variances in the messages, as a share of the true ones
        self.faults: list[Fault] = [lambda p, q: (p, q)] * v
        self._exposure = self.rng.uniform(0.0, 1.0 / VISION_HZ, v)
        self._on_the_way: list[deque[tuple[float, Pose]]] = [deque() for _ in stresses]
        self._gap_phase = self.rng.uniform(0.0, 4.0, v)
        self.v_n = np.zeros((v, 3))
        self._raw = np.zeros((v, 3)), np.zeros((v, 3)), self.world.truth().accel_b.copy()
        self._keep()

    def _keep(self) -> None:
        truth = self.world.truth()
        self._was = (truth.time_s, truth.p_n.copy(), self.v_n, truth.q_nb.copy())

    def _watch(self) -> None:
        """Correct velocities, which the physics reports half a step late.

        Put right here, in what is measured as in what is true, so that the filter is held against motion and not against that.
        """
        truth, late = self.world.truth(), 0.5 * 250.0 / self._hz
        self.v_n = truth.v_n + late * (truth.v_n - self._raw[0])
        self._newer = {
            "gyro_b": late * (truth.omega_b - self._raw[1]),
            "accel_b": late * (truth.accel_b - self._raw[2]),
        }
        self._raw = truth.v_n.copy(), truth.omega_b.copy(), truth.accel_b.copy()

    def _sense(self) -> dict[str, Array]:
        found = self.world.sense()
        return found | {name: found[name] + more for name, more in self._newer.items()}

    @property
    def now(self) -> float:
        return self.world.now

    def armed(self, i: int) -> bool:
        return bool(self.pilots.vehicles[i].commander.armed)

    def mode(self, i: int) -> str:
        return self.pilots.vehicles[i].commander.mode.label

    # -- flying --------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        self.world.step(self.motors)
        self._watch()
        self._expose()
        for i, queue in enumerate(self._on_the_way):
            while queue and queue[0][0] <= self.now:
                self.est.vision_input.receive(i, *queue.popleft()[1])
        self.motors = self.pilots.step(self.now, self._sense())

    def run(self, seconds: float, each: Callable[[StressFlight], None] | None = None) -> None:
        """Step for some seconds; call `each` before every tenth step."""
        for k in range(round(seconds * 250)):
            if each and k % 10 == 0:
                each(self)
            self.step()

    def setpoint(self, i: int, p_n: Any, yaw: float = 0.0) -> None:
        """Set a position setpoint, relative to the start of the vehicle [m] [NED]."""
        vectors = (*(self.home[i] + p_n).tolist(), 0, 0, 0, 0, 0, 0)
        offboard = self.pilots.vehicles[i].offboard
        array(offboard.target)[:] = (*vectors, yaw, 0.0)
        assert offboard.set_local_target(i, 0b100111111000, 1, self.now) is None

    def take_off(self, height_m: float = 4.0) -> None:
        """Take off until all vehicles hover in OFFBOARD."""
        vehicles = range(len(self.stresses))

        def hover(f: StressFlight) -> None:
            for i in vehicles:
                f.setpoint(i, [0.0, 0.0, -height_m])

        self.run(2.0, hover)
        for _ in range(4):  # a pose may be rejected at this very moment, which refuses arming
            for i in vehicles:
                self._request_offboard(i)
            self.run(0.25, hover)
        self.run(6.0, hover)
        low = [
            i for i in vehicles if self.mode(i) != "OFFBOARD" or self.world.truth().p_n[i, 2] > 0.3 - height_m
        ]
        assert not low, [(self.stresses[i].name, self.mode(i), self.world.truth().p_n[i]) for i in low]

    def _request_offboard(self, i: int) -> None:
        for command, p in ((176, (1, 6)), (400, (1, 0))):
            m = mavlink.MAVLink_command_long_message(i + 1, 1, command, 0, *p, 0, 0, 0, 0, 0)
            self.pilots.receive(i, "router", m.pack(mavlink.MAVLink(None, srcSystem=255)))

    def hover(self, height_m: float = 4.0, rows: Sequence[int] | None = None) -> None:
        """Send the setpoint of a hover to the vehicles in `rows`, None for all."""
        for i in range(len(self.stresses)) if rows is None else rows:
            self.setpoint(i, [0.0, 0.0, -height_m])

    def hard(self, height_m: float = 4.0, rows: Sequence[int] | None = None) -> None:
        """Send setpoints that reverse before they are reached, at another time for each vehicle, and steps of yaw."""
        for i in range(len(self.stresses)) if rows is None else rows:
            turn, yaw_turn = int(self.now / 1.3 + 0.37 * i), int(self.now / 2.9 + 0.61 * i)
            side = 1.0 if turn % 2 else -1.0
            p = [
                3.0 * side * math.cos(1.1 * (turn // 2)),
                3.0 * side * math.sin(1.1 * (turn // 2)),
                -height_m + 0.8 * side,
            ]
            self.setpoint(i, p, (0.0, 1.5, -1.5, 3.0)[yaw_turn % 4])

    # -- vision --------------------------------------------------------------------------------------------------------

    def _expose(self) -> None:
        t0, p0, v0, q0 = self._was
        truth, h = self.world.truth(), self.world.period_s
        for i in np.flatnonzero(self._exposure <= self.now):
            s, t = self.stresses[i], float(self._exposure[i])
            self._exposure[i] += 1.0 / VISION_HZ + self.rng.uniform(-0.5, 0.5) * h
            u = (t - t0) / h
            if self._hidden(i, t):
                continue
            # Between two steps: cubic in position, straight in attitude.
            p = _hermite(u, h, p0[i], v0[i], truth.p_n[i], self.v_n[i])
            q = (1 - u) * q0[i] + u * truth.q_nb[i] * np.sign(q0[i] @ truth.q_nb[i])
            sigma = math.radians(s.noise_deg)
            p = p + self.rng.normal(0.0, s.noise_m, 3)
            q = quat_multiply(q / np.linalg.norm(q), quat_exp(self.rng.normal(0.0, sigma, 3)))
            p, q = self.faults[i](p, q)
            var_p, var_yaw = float(self.claimed[i]) * s.noise_m**2, float(self.claimed[i]) * sigma**2
            pose = (tuple(p.tolist()), tuple(q.tolist()), (var_p,) * 3, var_yaw)
            self._on_the_way[i].append((t + s.delay_ms * 1e-3, pose))
        self._keep()

    def _hidden(self, i: int, t: float) -> bool:
        s = self.stresses[i]
        in_gap = s.gap_s > 0 and (t + self._gap_phase[i]) % s.gap_every_s < s.gap_s
        return bool(self.rng.random() < s.lost or in_gap)

    # -- what is held against the truth --------------------------------------------------------------------------------

    def log(self, seconds: float, each: Callable[[StressFlight], None]) -> Log:
        n, v = round(seconds * 250), len(self.stresses)
        e, var, tilt = np.zeros((n, v, 7)), np.zeros((n, v, 7)), np.zeros((n, v))
        nis: list[list[Array]] = [[] for _ in range(v)]
        est = self.est
        for k in range(n):
            if k % 10 == 0:
                each(self)
            est.innovation[:] = np.nan
            self.step()
            truth = self.world.truth()
            e[k, :, :3], e[k, :, 3:6] = truth.p_n - est.p_n, self.v_n - est.v_n
            e[k, :, 6] = quat_log(quat_multiply(truth.q_nb, quat_conj(est.q_nb)))[:, 2]
            d = np.einsum("vii->vi", est.cov)
            var[k, :, :6] = d[:, :6]
            down = est.r_nb[:, 2, :]
            var[k, :, 6] = np.einsum("vi,vij,vj->v", down, est.cov[:, 6:9, 6:9], down)
            tilt[k] = np.arccos(np.clip(1 - 2 * (truth.q_nb[:, 1] ** 2 + truth.q_nb[:, 2] ** 2), -1, 1))
            for i in np.flatnonzero(np.isfinite(est.innovation[:, 0])):
                nis[i].append(est.innovation[i] / np.sqrt(est.innovation_var[i]))
        return Log(e=e, var=var, tilt=tilt, innovations=[np.array(x) for x in nis])


def _hermite(u: float, h: float, p0: Array, v0: Array, p1: Array, v1: Array) -> Array:
    a, b = 1 - u, u
    return (1 + 2 * u) * a * a * p0 + b * b * (3 - 2 * u) * p1 + h * (u * a * a * v0 - b * b * a * v1)


@dataclass(kw_only=True)
class Fate:
    """Result of a false pose for one vehicle.

    declared_s: time until the failsafe [s], NaN for never
    astray_m, sigma_m, drawn_m: until the failsafe, the largest error of the estimate, its claimed sigma, and the largest distance
        from the start [m]
    landed_off_m: horizontal distance of the landing from the start [m]
    tilt_deg: largest tilt until disarming [deg]
    """

    declared_s: float = math.nan
    astray_m: float = 0.0
    sigma_m: float = 0.0
    drawn_m: float = 0.0
    landed_off_m: float = 0.0
    tilt_deg: float = 0.0
    disarmed: bool = False


def misled(f: StressFlight, seconds: float, each: Callable[[StressFlight], None]) -> list[Fate]:
    """Fly for some seconds with the present faults, and return the result of each vehicle."""
    fates = [Fate() for _ in f.stresses]
    begin, p0 = f.now, f.world.truth().p_n.copy()
    for k in range(round(seconds * 250)):
        if k % 10 == 0:
            each(f)
        f.step()
        if k % 5:
            continue
        truth = f.world.truth()
        astray, moved = np.linalg.norm(truth.p_n - f.est.p_n, axis=1), np.linalg.norm(truth.p_n - p0, axis=1)
        tilt = np.degrees(np.arccos(np.clip(1 - 2 * (truth.q_nb[:, 1] ** 2 + truth.q_nb[:, 2] ** 2), -1, 1)))
        for i, fate in enumerate(fates):
            if math.isnan(fate.declared_s) and f.mode(i) != "OFFBOARD":
                fate.declared_s = f.now - begin
            if math.isnan(fate.declared_s):
                fate.astray_m, fate.drawn_m = (
                    max(fate.astray_m, float(astray[i])),
                    max(fate.drawn_m, float(moved[i])),
                )
                fate.sigma_m = max(fate.sigma_m, float(np.sqrt(np.trace(f.est.cov[i, :3, :3]))))
            if f.armed(i):
                fate.tilt_deg = max(fate.tilt_deg, float(tilt[i]))
            fate.landed_off_m, fate.disarmed = float(np.hypot(*(truth.p_n - p0)[i, :2])), not f.armed(i)
    return fates
